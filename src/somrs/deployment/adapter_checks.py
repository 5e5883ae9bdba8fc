"""Checks the settings of a site's adapters without starting anything."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from somrs.deployment.adapters import BUS_BROKER, OWN_BROKER, AdapterSettings
from somrs.errors import InputError, ModelError, Problem, SettingsError
from somrs.ontology.files.loaded import AdapterEntry
from somrs.ontology.map import Map
from somrs.ports import host_and_port

RULE = "adapter"
ANY_BROKER = "mqtt://127.0.0.1"
"""In place of a broker whose address is not known before the system is started."""


def adapter_problems(entries: Mapping[str, AdapterEntry], map: Map | None) -> list[Problem]:
    """What is wrong with the adapters of site files. `map`: the one of the site, if it has one."""
    return [problem for entry in entries.values() for problem in sorted(_problems(entry, map), key=lambda problem: problem.line or 0)]


def misfits_of(name: str, adapter: object, map: Map) -> SettingsError | None:
    """What of the settings of an adapter does not fit the map; None: all does, or it does not say."""
    misfits = getattr(adapter, "misfits", None)
    mistakes = [*misfits(map)] if misfits is not None else []
    return SettingsError(name, mistakes) if mistakes else None


def _problems(entry: AdapterEntry, map: Map | None) -> Iterator[Problem]:
    settings = AdapterSettings(entry.name, dict(entry.settings), str(entry.folder.resolve()))
    try:
        if place := settings.own_broker():
            host_and_port(place)
        for broker in (OWN_BROKER, BUS_BROKER):
            settings = settings.with_broker(broker, ANY_BROKER)
        adapter = settings.make()
        if map is not None and (misfits := misfits_of(entry.name, adapter, map)) is not None:
            raise misfits
    except SettingsError as error:
        for path, message in error.mistakes:
            file, line = entry.written(path)
            yield Problem(
                file=file, line=line, subject=".".join(str(step) for step in ("adapters", entry.name, *path)), rule=RULE, message=message
            )
    except ModelError as error:
        yield from error.problems
    except InputError as error:
        file, line = entry.written(())
        prefix = re.compile(rf"adapters(: |\.){re.escape(entry.name)}(: |\.)|adapters: ")
        for text in str(error).splitlines():
            yield Problem(file=file, line=line, subject=f"adapters.{entry.name}", rule=RULE, message=prefix.sub("", text, count=1))
