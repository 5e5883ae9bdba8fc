"""Renders what is sent to things: the payloads of topics and requests, and the values of registers."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

from somrs.adapters.things.conversion import Raw, raw_text
from somrs.adapters.things.model import Command
from somrs.entish.formula import Number, Text, Truth
from somrs.errors import InputError
from somrs.ontology.types import Value
from somrs.ontology.units import convert_unit
from somrs.service_manager.sdk.values import term

PLACEHOLDER = re.compile(r"\?([^\W\d]\w*)")


def render(command: Command, inputs: Mapping[str, str]) -> Raw:
    """The payload of a command, with the inputs of the order, which are Entish terms. Raises InputError when one cannot be written."""
    if not isinstance(command.payload, str):
        return command.payload
    raws = {name: _raw(command, name, inputs[name]) for name in PLACEHOLDER.findall(command.payload)}
    if (placeholder := PLACEHOLDER.fullmatch(command.payload.strip())) is not None:
        return raws[placeholder[1]]
    return PLACEHOLDER.sub(lambda match: _in_text(raws[match[1]]), command.payload)


def check_message(command: Command, inputs: Mapping[str, str]) -> None:
    """Check that a command can be written with these inputs. Raises InputError."""
    raw = render(command, inputs)
    if command.register is not None:
        register_words(command, raw)


def payload_text(raw: Raw) -> str:
    """The payload of a topic or a request."""
    return raw if isinstance(raw, str) else raw_text(raw)


def register_words(command: Command, raw: Raw) -> list[int]:
    """The registers, or the bit, that are written. Raises InputError."""
    assert command.register is not None, "commands to Modbus devices have a register"
    try:
        number = {"true": True, "false": False}.get(raw.strip().lower(), raw) if isinstance(raw, str) else raw
        return command.register.encode(number if isinstance(number, bool) else float(number))
    except ValueError as error:
        raise InputError(f"{command.place}: {error}") from None


def _raw(command: Command, name: str, text: str) -> Raw:
    conversion = command.conversions.get(name)
    value: Value
    match term(text):
        case Number(number, None) | Text(number) | Truth(number):
            value = number
        case Number(number, unit) if unit is not None:
            own_unit = conversion.attribute.unit if conversion is not None else None
            converted = convert_unit(number, unit, own_unit) if own_unit is not None else None
            if converted is None:
                raise InputError(f"{name} is {text}, and it is not known how many {own_unit or 'of which unit'} this is")
            value = converted
        case named:
            value = str(named)
    try:
        return conversion.write(value) if conversion is not None else value
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None


def _in_text(raw: Raw) -> str:
    """A value within a payload, which may be JSON: a text without its quotes."""
    return json.dumps(raw, ensure_ascii=False)[1:-1] if isinstance(raw, str) else raw_text(raw)
