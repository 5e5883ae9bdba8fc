"""States and inputs of components as bytes, in msgpack, and back: those of earlier versions, too.

Ontologies and maps are written as what they are made of; their indexes are sooner made than read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

import msgspec
from msgspec import Struct

from somrs.errors import UsageError
from somrs.kernel.component import ErrorAnswer, Input, Stateful
from somrs.ontology.objects import Fact, Map, Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, FunctionType, ObjectType, Ontology, RelationType

T = TypeVar("T")


class _Definitions(Struct, frozen=True, array_like=True):
    """An ontology on its way."""

    attributes: list[AttributeType]
    relations: list[RelationType]
    functions: list[FunctionType]
    types: list[ObjectType]
    services: list[ServiceType]


class _Contents(Struct, frozen=True, array_like=True):
    """A map on its way."""

    objects: list[Object]
    facts: list[Fact]


def _encode_hook(value: object) -> object:
    match value:
        case Ontology():
            sections = (value.attributes, value.relations, value.functions, value.types, value.services)
            return _Definitions(*([*section.values()] for section in sections))
        case Map():
            return _Contents([*value.objects.values()], [*value.facts()])
    raise NotImplementedError(f"{type(value).__name__} cannot be written: it is no data")


def _decode_hook(kind: type, value: Any) -> object:
    if kind is Ontology:
        definitions = msgspec.convert(value, _Definitions)
        return Ontology(
            [*definitions.attributes, *definitions.relations, *definitions.functions, *definitions.types, *definitions.services]
        )
    if kind is Map:
        contents = msgspec.convert(value, _Contents)
        return Map(contents.objects, contents.facts)
    raise NotImplementedError(f"{kind.__name__} cannot be read: it is no data")


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encode_hook)


def encode(value: object) -> bytes:
    """The value in msgpack. Raises TypeError or NotImplementedError for what is no data."""
    return _ENCODER.encode(value)


class Codec(Generic[T]):
    """Reads values of one type. Raises msgspec.ValidationError or DecodeError for anything else."""

    def __init__(self, kind: Any) -> None:
        self._kind = kind
        self._decoder: msgspec.msgpack.Decoder[T] = msgspec.msgpack.Decoder(kind, dec_hook=_decode_hook)

    def decode(self, document: bytes) -> T:
        return self._decoder.decode(document)

    def convert(self, value: object) -> T:
        """The same from what `decode_untyped` gives."""
        converted: T = msgspec.convert(value, self._kind, dec_hook=_decode_hook)
        return converted


def decode_untyped(document: bytes) -> Any:
    """What is written there, whatever its type: dictionaries, lists, texts and numbers."""
    return msgspec.msgpack.decode(document)


class Migration(Struct, frozen=True, kw_only=True):
    """From one version of a component's data to the next, as `decode_untyped` values, which may be changed in place: of a `snapshot` and of
    an `entry` of its journal."""

    snapshot: Callable[[Any], Any] = lambda snapshot: snapshot
    entry: Callable[[Any], Any] = lambda entry: entry


def to_error_answer(error: BaseException) -> ErrorAnswer:
    """An exception as an answer, where its component has no better one."""
    return ErrorAnswer(str(error) or type(error).__name__)


class Schema(Struct, frozen=True, kw_only=True):
    """What a component's state and inputs are made of. `version` counts up with each change of any of it, and `migrations` lead from each
    version to the next. `timers`, `questions`, `tasks`, `answers` and `notices` are types: of what it sets, asks, and hears; `restore`
    makes the component that has a state.

    `volatile`: tasks that end with the process; after a restart their questions are answered by `AnswerLost`. `error_to_answer` makes an
    answer of an exception. `relocatable`: it can go on at another address than before. `irreplaceable`: what it knows is nowhere else, so
    that it is never begun anew instead of being gone on with. `is_read_only`: inputs that need not be kept, because they leave the state as
    it is, and nothing that comes of them is owed to anybody when the process has ended. `snapshot_after`: so many inputs are handled again
    in about a second."""

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
        """Whether data of that version can be read."""
        return version <= self.version and all(step in self.migrations for step in range(version, self.version))

    def migrate_snapshot(self, value: Any, version: int) -> Any:
        """A snapshot of that version as one of today. Raises UsageError for a version that cannot be read."""
        for step in self._steps(version):
            value = step.snapshot(value)
        return value

    def migrate_entry(self, value: Any, version: int) -> Any:
        """A journal's entry of that version as one of today."""
        for step in self._steps(version):
            value = step.entry(value)
        return value

    def _steps(self, version: int) -> list[Migration]:
        if not self.can_read(version):
            raise UsageError(f"its data have version {version}, and this program reads up to {self.version}")
        return [self.migrations[step] for step in range(version, self.version)]
