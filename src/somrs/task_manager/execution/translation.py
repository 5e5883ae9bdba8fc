"""Messages to and from devices of other maps: on the wire, names are those of the device's map (`qualified_names.py`).

A device that is on the map as `Barn:Robot1` knows itself as `Robot1`, and an own object `Truck` of the map `Yard` as `Yard:Truck`. Its
messages are translated as they come, and those to it as they go, so that nothing else has to know.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from msgspec import Struct, structs

from somrs.errors import FormulaError
from somrs.ontology.homes import text_with_names
from somrs.ontology.map import Map
from somrs.ontology.qualified_names import home_of, translated
from somrs.ontology.types import Ontology
from somrs.protocol.messages.envelope import Message

_FORMULAS = ("effect", "precondition", "situation", "condition", "invariant")
_TERMS = ("inputs", "outputs")
_OBJECTS = ("gone", "searched", "sought", "missed")

S = TypeVar("S", bound=Struct)


class Translation:
    """Translates between a map and that of the device `provider`, by its name on the map."""

    def __init__(self, provider: str, map: Map, ontology: Ontology) -> None:
        self._home, self._map, self._ontology = home_of(provider), map, ontology

    def outgoing(self, message: Message) -> Message:
        """The message as the device understands it."""
        if not self._home:
            return message
        return structs.replace(message, body=self._body(message.body, lambda name: translated(name, self._map.name, self._home)))

    def incoming(self, message: Message) -> Message:
        """The message of the device as it is understood here."""
        if not self._home:
            return message
        return structs.replace(message, body=self._body(message.body, lambda name: translated(name, self._home, self._map.name)))

    def _body(self, body: S, new_name: Callable[[str], str]) -> S:
        changes: dict[str, Any] = {}
        for field in body.__struct_fields__:
            value = getattr(body, field)
            if field in _FORMULAS and isinstance(value, str):
                changes[field] = self._formula(value, new_name)
            elif field in _TERMS:
                changes[field] = {name: self._term(term, new_name) if isinstance(term, str) else term for name, term in value.items()}
            elif field in _OBJECTS:
                changes[field] = tuple(map(new_name, value))
            elif field == "observation" and value is not None:
                changes[field] = self._body(value, new_name)
        return structs.replace(body, **changes) if changes else body

    def _term(self, text: str, new_name: Callable[[str], str]) -> str:
        """The value of an input or output: an object, or something else that is the same everywhere."""
        is_object = text in self._map.objects or new_name(text) in self._map.objects
        return new_name(text) if is_object else text

    def _formula(self, text: str, new_name: Callable[[str], str]) -> str:
        try:
            return text_with_names(text, new_name, self._ontology)
        except FormulaError:
            return text
