"""Modbus registers and coils: how mappings address them, and how values are encoded in them (Modbus Application Protocol 1.1b3)."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from enum import StrEnum

from msgspec import Struct

from somrs.errors import InputError

_ADDRESS = re.compile(r"(coil|discrete|input|holding)\s+(\d+)")
_BIT = re.compile(r"bit ([0-9]|1[0-5])")
_FORMATS = {
    "int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "int64": ">q", "uint64": ">Q", "float32": ">f", "float64": ">d",
}  # fmt: skip
LAST_ADDRESS = 0xFFFF


class Table(StrEnum):
    """The four tables of a Modbus device."""

    COIL = "coil"
    """Bits that can be read and written."""
    DISCRETE = "discrete"
    """Bits that can be read."""
    INPUT = "input"
    """Registers of 16 bits that can be read."""
    HOLDING = "holding"
    """Registers of 16 bits that can be read and written."""

    @property
    def has_bits(self) -> bool:
        return self in (Table.COIL, Table.DISCRETE)

    @property
    def is_writable(self) -> bool:
        return self in (Table.COIL, Table.HOLDING)


class Register(Struct, frozen=True, kw_only=True):
    """A value in a Modbus device. `address`: of its first register or coil, as in the protocol, from 0. `encoding`: of registers.

    `swapped`: the register with the lowest address has the lowest bits.
    """

    table: Table
    address: int
    encoding: str = "uint16"
    swapped: bool = False

    @property
    def count(self) -> int:
        """How many registers, or coils, it takes."""
        return 1 if self.table.has_bits or _BIT.fullmatch(self.encoding) else struct.calcsize(_FORMATS[self.encoding]) // 2

    def decode(self, words: Sequence[int]) -> float | bool:
        """The value of its registers, or of its bit."""
        if self.table.has_bits:
            return bool(words[0])
        if (bit := _BIT.fullmatch(self.encoding)) is not None:
            return bool(words[0] >> int(bit[1]) & 1)
        ordered = words[::-1] if self.swapped else words
        number: float = struct.unpack(_FORMATS[self.encoding], struct.pack(f">{len(ordered)}H", *ordered))[0]
        return number

    def encode(self, value: float | bool) -> list[int]:
        """The registers, or the bit, for a value. Integers are rounded. Raises ValueError when the value does not fit."""
        if self.table.has_bits:
            return [int(bool(value))]
        if not math.isfinite(value):
            raise ValueError(f"{value} cannot be written to registers")
        number = float(value) if self.encoding.startswith("float") else round(value)
        try:
            data = struct.pack(_FORMATS[self.encoding], number)
        except (struct.error, OverflowError):
            raise ValueError(f"{value:g} does not fit into {self.encoding}") from None
        words = [*struct.unpack(f">{len(data) // 2}H", data)]
        return words[::-1] if self.swapped else words


def parse_register(text: str, encoding: str | None) -> Register:
    """The register that a mapping names: `holding 40`, with `float32` or `int32 swapped`. Raises InputError."""
    match = _ADDRESS.fullmatch(text.strip())
    if match is None or int(match[2]) > LAST_ADDRESS:
        tables = ", ".join(Table)
        raise InputError(f"{text!r} is not a register: write one of {tables} and the address from 0 to {LAST_ADDRESS}, such as holding 40")
    table = Table(match[1])
    name, swapped = (encoding or "uint16").removesuffix(" swapped"), (encoding or "").endswith(" swapped")
    if table.has_bits:
        if encoding is not None:
            raise InputError(f"{text} is one bit: leave out as: {encoding}")
    elif name not in _FORMATS and _BIT.fullmatch(name) is None:
        raise InputError(f"{encoding!r} is not an encoding: there are {', '.join(_FORMATS)}, bit 0 to bit 15, and each with swapped")
    register = Register(table=table, address=int(match[2]), encoding=name, swapped=swapped)
    if register.address + register.count - 1 > LAST_ADDRESS:
        raise InputError(f"{text} as {name} has {register.count} registers, and the last address is {LAST_ADDRESS}")
    return register
