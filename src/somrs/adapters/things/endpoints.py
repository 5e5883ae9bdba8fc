"""Where the entries of a mapping lead: to a topic, a path or a register at one of the connections."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msgspec import Struct

from somrs.adapters.things.mapping import KeyPath
from somrs.adapters.things.model import Connection
from somrs.adapters.things.registers import Register, parse_register
from somrs.entish.parse import nearest
from somrs.errors import InputError

_KEYS = {"mqtt": ("topic",), "http": ("path", "put", "post"), "modbus": ("register",)}
"""The keys under which places are written, by the kinds of connections."""


class Endpoint(Struct, frozen=True, kw_only=True):
    """A place at a connection. `key`: under which it is written. `register`: it, if it is one."""

    connection: Connection
    key: str
    place: str
    register: Register | None = None


class Endpoints:
    """Finds the endpoints of entries. `default`: the connection of entries that name none; None: the only one, if there is one.
    `report`: is told what is wrong, with the path of the entry's key."""

    def __init__(self, connections: Mapping[str, Connection], default: str | None, report: Callable[[KeyPath, str], None]) -> None:
        self._connections, self._report = connections, report
        self.default = default or (next(iter(connections)) if len(connections) == 1 else None)

    def find(self, path: KeyPath, name: str | None, places: Mapping[str, str | None], encoding: str | None = None) -> Endpoint | None:
        """The only place of an entry; None after a problem. `name`: of its connection; `places`: what it has, by the keys."""
        connection = self._connection(path, name or self.default)
        if connection is None:
            return None
        filled = {key: place for key, place in places.items() if place is not None}
        allowed = [key for key in _KEYS[connection.kind] if key in places]
        if not allowed:
            text = f"{connection.name} speaks {connection.kind.upper()}, which has no {path[0]}; name a broker or a server"
            self._report(path, text)
            return None
        if len(filled) != 1 or next(iter(filled)) not in allowed:
            expected = " or ".join(f"{key}:" for key in allowed)
            self._report(path, f"needs {expected}, and only this, because {connection.name} speaks {connection.kind.upper()}")
            return None
        [(key, place)] = filled.items()
        if connection.kind == "mqtt" and {"#", "+"} & {*place}:
            self._report((*path, key), "a topic of one thing has no wildcards + and #")
        register = self._register(path, place, encoding) if connection.kind == "modbus" else None
        return Endpoint(connection=connection, key=key, place=place, register=register)

    def _connection(self, path: KeyPath, name: str | None) -> Connection | None:
        if name is None:
            choice = ", ".join(self._connections) or "those under connections:"
            self._report(path, f"says no connection; write connection: and one of {choice}")
            return None
        if name not in self._connections:
            hint = nearest(name, self._connections) or "name it under connections:"
            self._report((*path, "connection"), f"there is no connection {name}; {hint}")
        return self._connections.get(name)

    def _register(self, path: KeyPath, text: str, encoding: str | None) -> Register | None:
        try:
            return parse_register(text, encoding)
        except InputError as error:
            self._report((*path, "register"), str(error))
            return None
