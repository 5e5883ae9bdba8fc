"""Reads the settings of an adapter, and names every mistake in them, with what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel

from somrs.errors import Mistake, SettingsError
from somrs.ontology.files.documents import follows, read_document

M = TypeVar("M", bound=BaseModel)


def no_mistakes(_: object) -> Iterator[Mistake]:
    """For settings of which all that fit the model are right."""
    yield from ()


def valid_settings(adapter: str, settings: Mapping[str, Any], model: type[M], check: Callable[[M], Iterable[Mistake]] = no_mistakes) -> M:
    """The settings of an adapter. Raises SettingsError with all mistakes. `check`: what else is wrong with settings that fit the model; it
    gets what fits of those that do not."""
    content, mistakes = checked(settings, model, check)
    if content is None or mistakes:
        raise SettingsError(adapter, mistakes)
    return content


def checked(data: Mapping[str, Any], model: type[M], check: Callable[[M], Iterable[Mistake]]) -> tuple[M | None, list[Mistake]]:
    """What fits the model, and all mistakes. `check`: as of `valid_settings`."""
    document = read_document(data, model)
    mistakes = [(path, message) for path, _, message in document.misfits]
    if document.content is not None:
        mistakes += [mistake for mistake in check(document.content) if not follows(mistake[0], document)]
    return document.content, mistakes
