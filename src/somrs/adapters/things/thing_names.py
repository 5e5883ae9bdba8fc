"""The names on the map of things that announce or describe themselves. They are stored: names for people can be alike, and a name that
meant another thing after a restart would have its tasks go on with that one."""

from __future__ import annotations

import logging
from collections.abc import Collection
from pathlib import Path

import msgspec

from somrs.adapters.things.naming import object_name
from somrs.atomic_files import write_atomically

log = logging.getLogger(__name__)


class ThingNames:
    """Names, each given once. `file`: where they are stored; None: they are not."""

    def __init__(self, file: Path | None = None) -> None:
        self._file = file
        self._names = _load(file) if file is not None else {}
        """By what tells the things apart."""

    def name(self, identity: str, text: str, taken_names: Collection[str] = ()) -> str:
        """The name of the thing with this identity, which stays as it is unless it is one of the `taken_names`. A new one is made of the
        text."""
        if self._names.get(identity, "") in ("", *taken_names):
            self._names[identity] = object_name(text, {*taken_names, *self._names.values()})
            self._store()
        return self._names[identity]

    def _store(self) -> None:
        """Store the names. A failure is logged: names are only at stake when the program starts again."""
        if self._file is None:
            return
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._file, msgspec.json.encode(self._names))
        except OSError as error:
            log.warning(
                "%s cannot be written: %s; after a restart, things whose names are alike may be called otherwise", self._file, error
            )


def _load(file: Path) -> dict[str, str]:
    try:
        return msgspec.json.decode(file.read_bytes(), type=dict[str, str])
    except FileNotFoundError:
        return {}
    except (OSError, msgspec.DecodeError) as error:
        log.warning("%s cannot be read: %s; things whose names are alike may be called otherwise", file, error)
        return {}
