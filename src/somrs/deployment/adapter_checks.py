"""Checks the settings of a site's adapters without starting anything."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping

from somrs.deployment.adapters import BUS_BROKER, OWN_BROKER, AdapterSettings
from somrs.errors import InputError, Mistake, ModelError, Problem, SettingsError, UsageError
from somrs.ontology.files.loaded import AdapterEntry
from somrs.ontology.files.nodes import Path
from somrs.ports import host_and_port
from somrs.sites.references import Site

RULE = "adapter"
ANY_BROKER = "mqtt://127.0.0.1"
"""In place of a broker whose address is not known before the system is started."""


def adapter_problems(entries: Mapping[str, AdapterEntry], site: Site | None) -> list[Problem]:
    """What is wrong with the adapters of site files. `site`: its map, if it has one."""
    problems: list[Problem] = []
    owners: dict[str, str] = {}
    for entry in entries.values():
        problems += sorted(_problems(entry, site, owners), key=lambda problem: problem.line or 0)
    return problems


def misfits_of(name: str, adapter: object, site: Site) -> SettingsError | None:
    """What of the settings of an adapter does not fit the map; None: all does, or it does not say."""
    misfits = getattr(adapter, "misfits", None)
    mistakes = [*misfits(site)] if misfits is not None else []
    return SettingsError(name, mistakes) if mistakes else None


def _problems(entry: AdapterEntry, site: Site | None, owners: dict[str, str]) -> Iterator[Problem]:
    """`owners`: the adapters by the objects that they serve, and the place of the own broker; those of this one are added."""
    settings = AdapterSettings(entry.name, dict(entry.settings), str(entry.folder.resolve()))
    try:
        if place := settings.own_broker():
            try:
                host_and_port(place)
            except UsageError as error:
                raise SettingsError(entry.name, [(("broker",), str(error))]) from None
            if (earlier := owners.setdefault("the broker of the system", place)) != place:
                text = f"there is one broker of the system, and another adapter has it at {earlier}; write the same place, or `own`"
                raise SettingsError(entry.name, [(("broker",), text)])
        for broker in (OWN_BROKER, BUS_BROKER):
            settings = settings.with_broker(broker, ANY_BROKER)
        adapter = settings.make()
        yield from (_problem(entry, path, message) for path, message in _served_twice(entry, adapter.names, owners))
        if site is not None and (misfits := misfits_of(entry.name, adapter, site)) is not None:
            raise misfits
    except SettingsError as error:
        yield from (_problem(entry, path, message) for path, message in error.mistakes)
    except ModelError as error:
        yield from error.problems
    except InputError as error:
        prefix = re.compile(rf"adapters(: |\.){re.escape(entry.name)}(: |\.)|adapters: ")
        yield from (_problem(entry, (), prefix.sub("", text, count=1)) for text in str(error).splitlines())


def _served_twice(entry: AdapterEntry, names: Collection[str], owners: dict[str, str]) -> Iterator[Mistake]:
    for name in names:
        if (owner := owners.setdefault(name, entry.name)) != entry.name:
            sections = (section for section, entries in entry.settings.items() if isinstance(entries, dict) and name in entries)
            yield (*sections, name), f"{name} is served by the adapter {owner}, too; name it in one of them"


def _problem(entry: AdapterEntry, path: Path, message: str) -> Problem:
    file, line = entry.written(path)
    subject = ".".join(str(step) for step in ("adapters", entry.name, *path))
    return Problem(file=file, line=line, subject=subject, rule=RULE, message=message)
