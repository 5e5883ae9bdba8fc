"""Serialize the states and inputs of components as msgpack, and read them back, including those of earlier versions.

Ontologies, maps and offers are stored as lists of their elements, because rebuilding their indexes is faster than reading them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Generic, TypeVar

import msgspec
from msgspec import Struct

from somrs.errors import UsageError
from somrs.kernel.component import ErrorAnswer, Input, Stateful
from somrs.kernel.offers import Offers
from somrs.kernel.parts import MapDocument, PartsReader, PartsWriter
from somrs.ontology.map import Map
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, FunctionType, ObjectType, Ontology, RelationType
from somrs.protocol.messages.directory import Offer

T = TypeVar("T")


class _Definitions(Struct, frozen=True, array_like=True):
    """The stored form of an ontology."""

    attributes: list[AttributeType]
    relations: list[RelationType]
    functions: list[FunctionType]
    types: list[ObjectType]
    services: list[ServiceType]


def _encode_hook(value: object, parts: PartsWriter | None = None) -> object:
    match value:
        case Ontology():
            sections = (value.attributes, value.relations, value.functions, value.types, value.services)
            return _Definitions(*([*section.values()] for section in sections))
        case Map():
            if parts is not None:
                return parts.document(value)
            return MapDocument([*value.objects.values()], [*value.facts()], name=value.name, complete=sorted(value.complete))
        case Offers():
            return [*value]
    raise NotImplementedError(f"{type(value).__name__} cannot be serialized: it is not data")


def _decode_hook(kind: type, value: Any, parts: PartsReader) -> object:
    if kind is Ontology:
        definitions = msgspec.convert(value, _Definitions)
        return Ontology(
            [*definitions.attributes, *definitions.relations, *definitions.functions, *definitions.types, *definitions.services]
        )
    if kind is Map:
        return parts.map(msgspec.convert(value, MapDocument))
    if kind is Offers:
        return Offers(msgspec.convert(value, list[Offer]))
    raise NotImplementedError(f"{kind.__name__} cannot be deserialized: it is not data")


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encode_hook)


def encode(value: object, parts: PartsWriter | None = None) -> bytes:
    """The value as msgpack, without the `parts` that are put aside.

    Raises TypeError or NotImplementedError for a value that is not data.
    """
    encoder = _ENCODER if parts is None else msgspec.msgpack.Encoder(enc_hook=partial(_encode_hook, parts=parts))
    return encoder.encode(value)


class Codec(Generic[T]):
    """Decodes values of one type, with the parts of their maps. Raises msgspec.ValidationError or DecodeError for other input."""

    def __init__(self, kind: Any, parts: PartsReader | None = None) -> None:
        self._kind = kind
        self._hook = partial(_decode_hook, parts=parts if parts is not None else PartsReader({}))
        self._decoder: msgspec.msgpack.Decoder[T] = msgspec.msgpack.Decoder(kind, dec_hook=self._hook)

    def decode(self, document: bytes) -> T:
        return self._decoder.decode(document)

    def convert(self, value: object) -> T:
        """Convert the result of `decode_untyped` to the type."""
        converted: T = msgspec.convert(value, self._kind, dec_hook=self._hook)
        return converted


def decode_untyped(document: bytes) -> Any:
    """Decode msgpack without a type, to dictionaries, lists, texts and numbers."""
    return msgspec.msgpack.decode(document)


class Migration(Struct, frozen=True, kw_only=True):
    """Converts a component's data from one version to the next: a `snapshot`, and an `entry` of its journal.

    Both functions take and return values of `decode_untyped`, which they may change in place.
    """

    snapshot: Callable[[Any], Any] = lambda snapshot: snapshot
    entry: Callable[[Any], Any] = lambda entry: entry


def to_error_answer(error: BaseException) -> ErrorAnswer:
    """Convert an exception to an answer, for components without a more specific conversion."""
    return ErrorAnswer(str(error) or type(error).__name__)


class Schema(Struct, frozen=True, kw_only=True):
    """The types of a component's state and inputs, and how its journal is read.

    `version` increases with each change of a type; `migrations` lead from each version to the next. `timers`, `questions`, `tasks`,
    `answers` and `notices` are the types of the values in `SetTimer`, `Ask`, `Answered` and `Notified`. `restore` creates the component
    from a state. `error_to_answer` converts an exception to an answer.

    `volatile`: tasks that are lost with the process; after a restart, `AnswerLost` answers their questions. `relocatable`: the component
    can continue at another address. `irreplaceable`: its state exists nowhere else, so an empty state never replaces one that cannot be
    continued. `is_read_only`: inputs that the journal leaves out, because they do not change the state and their effects may be lost with
    the process. `snapshot_after`: inputs between snapshots; a restart replays so many in about a second.
    """

    component: str
    version: int
    state: Any
    timers: Any
    questions: Any
    tasks: Any
    answers: Any
    notices: Any = None
    restore: Callable[[Any], Stateful]
    volatile: tuple[type, ...] = ()
    error_to_answer: Callable[[BaseException], object] = to_error_answer
    relocatable: bool = False
    irreplaceable: bool = False
    is_read_only: Callable[[Input], bool] = lambda event: False
    snapshot_after: int = 5000
    migrations: Mapping[int, Migration] = {}

    def can_read(self, version: int) -> bool:
        """Whether this program can read data of that version."""
        return version <= self.version and all(step in self.migrations for step in range(version, self.version))

    def migrate_snapshot(self, value: Any, version: int) -> Any:
        """Convert a snapshot of that version to the current version. Raises UsageError for a version that cannot be read."""
        for step in self._steps(version):
            value = step.snapshot(value)
        return value

    def migrate_entry(self, value: Any, version: int) -> Any:
        """Convert a journal entry of that version to the current version. Raises UsageError for a version that cannot be read."""
        for step in self._steps(version):
            value = step.entry(value)
        return value

    def _steps(self, version: int) -> list[Migration]:
        if not self.can_read(version):
            raise UsageError(f"its data have version {version}, and this program reads up to {self.version}")
        return [self.migrations[step] for step in range(version, self.version)]
