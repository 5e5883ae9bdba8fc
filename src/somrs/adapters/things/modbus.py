"""The connection to a Modbus device over TCP, whose registers are read again and again."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable, Sequence

from msgspec import Struct
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ModbusPDU

from somrs.adapters.things.connector import FIRST_PAUSE, LONGEST_PAUSE, ConnectionNotes, Listener, Rejection
from somrs.adapters.things.conversion import Raw
from somrs.adapters.things.messages import register_words
from somrs.adapters.things.model import Command, Connection, Source
from somrs.adapters.things.registers import Register, Table

logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)  # `ConnectionNotes` says how a connection is, once

LONGEST_BLOCK = 120
"""Registers, or coils, that are read at once; the protocol has 125."""


class Block(Struct, frozen=True, kw_only=True):
    """Registers in a row that are read together."""

    table: Table
    address: int
    count: int
    sources: tuple[Source, ...]


def blocks_of(sources: Iterable[Source]) -> list[Block]:
    """The fewest readings for the sources: of registers that follow each other without a gap, because those between may not exist."""
    blocks: list[Block] = []
    for source in sorted(sources, key=lambda source: (_register(source).table, _register(source).address)):
        register, block = _register(source), blocks[-1] if blocks else None
        end = max(register.address + register.count, block.address + block.count) if block is not None else 0
        if (
            block is not None
            and block.table is register.table
            and register.address <= block.address + block.count
            and end - block.address <= LONGEST_BLOCK
        ):
            blocks[-1] = Block(table=block.table, address=block.address, count=end - block.address, sources=(*block.sources, source))
        else:
            blocks.append(Block(table=register.table, address=register.address, count=register.count, sources=(source,)))
    return blocks


class ModbusConnector:
    """A Modbus device, or a gateway with several: `connection.unit` says which."""

    def __init__(self, connection: Connection, listener: Listener) -> None:
        self._connection, self._listener = connection, listener
        self._notes = ConnectionNotes(connection)
        self._block_notes: dict[Block, ConnectionNotes] = {}
        """Of those that the device refuses to read."""
        self._sources: dict[tuple[str, Register], Source] = {}
        self._changed, self._prompt = asyncio.Event(), asyncio.Event()
        self._client: AsyncModbusTcpClient | None = None
        self._connected = asyncio.Event()
        self._turn = asyncio.Lock()  # many devices answer one request at a time

    def follow(self, source: Source) -> None:
        self._sources[source.place, _register(source)] = source
        self._changed.set()

    def unfollow(self, source: Source) -> None:
        self._sources.pop((source.place, _register(source)), None)
        self._changed.set()

    async def run(self) -> None:
        pause = FIRST_PAUSE
        while True:
            client = AsyncModbusTcpClient(self._connection.host, port=self._connection.port, reconnect_delay=0, retries=1)
            try:
                if await client.connect():
                    self._notes.note("is connected", is_bad=False)
                    self._client = client
                    self._connected.set()
                    pause = FIRST_PAUSE
                    await self._serve(client)
                else:
                    self._notes.note("is not there; it is tried again")
            except (ConnectionException, OSError) as error:
                self._notes.note(f"is not there ({error}); it is tried again")
            finally:
                self._connected.clear()
                self._client = None
                client.close()
            self._listener.reached(self._connection.name, False)
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    async def send(self, command: Command, raw: Raw) -> None:
        register, words = command.register, register_words(command, raw)
        assert register is not None, "commands to Modbus devices have a register"
        await self._connected.wait()
        client, unit = self._client, self._connection.unit
        assert client is not None, "a connection has a client"
        try:
            async with self._turn:
                if register.table is Table.COIL:
                    answer = await client.write_coil(register.address, bool(words[0]), device_id=unit)
                elif len(words) == 1:
                    answer = await client.write_register(register.address, words[0], device_id=unit)
                else:
                    answer = await client.write_registers(register.address, words, device_id=unit)
        except ModbusException as error:
            raise Rejection(f"{command.place} of {self._connection.name} could not be written: {error}", is_received=True) from error
        if answer.isError():
            raise Rejection(f"{self._connection.name} refuses to write {command.place}: {_reason(answer)}", is_received=True)
        self._prompt.set()

    async def _serve(self, client: AsyncModbusTcpClient) -> None:
        """Read the registers until the connection ends."""
        loop = asyncio.get_running_loop()
        due: dict[float, float] = {}
        while True:
            self._changed.clear()
            if self._prompt.is_set():
                self._prompt.clear()
                due.clear()
            polls = {source.poll for source in self._sources.values()}
            for poll in polls:
                if due.get(poll, 0.0) <= loop.time():
                    for block in blocks_of(source for source in self._sources.values() if source.poll == poll):
                        await self._read(client, block)
                    due[poll] = loop.time() + poll
            next_time = min((due[poll] for poll in polls), default=None)
            await self._wait(next_time - loop.time() if next_time is not None else None)

    async def _wait(self, seconds: float | None) -> None:
        """Wait until something is due, is to be read at once, or other registers are to be read."""
        waiters = [asyncio.create_task(event.wait()) for event in (self._changed, self._prompt)]
        try:
            await asyncio.wait(waiters, timeout=max(seconds, 0.0) if seconds is not None else None, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for waiter in waiters:
                waiter.cancel()

    async def _read(self, client: AsyncModbusTcpClient, block: Block) -> None:
        async with self._turn:
            try:
                answer = await _request(client, block, self._connection.unit)
            except ConnectionException:
                raise
            except ModbusException as error:
                self._notes.note(f"does not answer ({error}); it is tried again")  # which says nothing of the thing
                if not client.connected:
                    raise ConnectionException(str(error)) from error
                return
        if answer.isError():
            problem = f"refuses to read {block.table} {block.address} to {block.address + block.count - 1}: {_reason(answer)}"
            self._block_notes.setdefault(block, ConnectionNotes(self._connection)).note(problem)
            for source in block.sources:
                self._listener.unreadable((self._connection.name, source.place, _register(source)), f"{self._connection.name} {problem}")
            return
        self._block_notes.pop(block, None)
        self._listener.reached(self._connection.name, True)
        values: Sequence[int] = answer.bits if block.table.has_bits else answer.registers
        for source in block.sources:
            register = _register(source)
            start = register.address - block.address
            self._listener.received(
                (self._connection.name, source.place, register), register.decode(values[start : start + register.count])
            )


_REASONS = {
    1: "it does not know this table",
    2: "it has no such register; correct the address, which counts from 0",
    3: "it does not read so many registers at once",
    4: "it has failed",
    5: "it is busy",
    6: "it is busy",
    10: "the gateway has no way to the unit; correct the number of the unit in the url",
    11: "the unit does not answer behind the gateway; correct its number in the url, or switch it on",
}
"""What exceptions of a device mean (MODBUS Application Protocol 1.1b3, chapter 7)."""


def _reason(answer: ModbusPDU) -> str:
    code = answer.exception_code
    return f"{_REASONS.get(code, 'for a reason of its own')} (exception {code})"


async def _request(client: AsyncModbusTcpClient, block: Block, unit: int) -> ModbusPDU:
    match block.table:
        case Table.COIL:
            return await client.read_coils(block.address, count=block.count, device_id=unit)
        case Table.DISCRETE:
            return await client.read_discrete_inputs(block.address, count=block.count, device_id=unit)
        case Table.INPUT:
            return await client.read_input_registers(block.address, count=block.count, device_id=unit)
    return await client.read_holding_registers(block.address, count=block.count, device_id=unit)


def _register(source: Source) -> Register:
    assert source.register is not None, "sources of Modbus devices have a register"
    return source.register
