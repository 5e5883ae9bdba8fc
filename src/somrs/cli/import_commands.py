"""Import of buildings, and of planning problems in PDDL, as map files."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from somrs.cli import import_report
from somrs.cli.geometry import geometry_problems
from somrs.client import terminal
from somrs.errors import UsageError
from somrs.ontology.files.loading import load
from somrs.ontology.files.site import dump_site

if TYPE_CHECKING:
    from somrs.sites import Importer, Site
    from somrs.sites.pddl import ImportedProblem

_PDDL = ".pddl"


def import_site(
    sources: Sequence[Path], output: Path | None, *, sizes: Path | None = None, crowds: bool = False, details: bool = False
) -> None:
    """Import a building or a planning problem, write it as a map file, and check that file."""
    if any(source.suffix == _PDDL for source in sources):
        _import_problem(sources, output)
        return
    if len(sources) != 1:
        raise UsageError("import one building at a time; only a planning problem in PDDL has two files")
    source = sources[0]
    from somrs.sites import IMPORTERS, ImportOptions
    from somrs.sites.models import shipped_models

    if (reader := importer(source)) is None:
        endings = ", ".join(f"*{ending}" for ending in IMPORTERS)
        kinds = f"{endings}, the map.yaml of an occupancy map, and a domain and a problem, *{_PDDL}"
        raise UsageError(f"{source}: files of this kind cannot be imported; the kinds are {kinds}")
    models = shipped_models() if sizes is None else shipped_models().extended(sizes)
    site = reader(source, ImportOptions(models=models, crowds=crowds))
    target = output or _target_of(source)
    target.write_text(dump_site(site.ontology, site.map), encoding="utf-8")
    terminal.console().print(import_report.report(site, details=details))
    quoted, loaded = shlex.quote(str(target)), load([target])
    mistakes = geometry_problems(loaded)
    found = f"{len(mistakes)} mistake{'s' if len(mistakes) != 1 else ''} in its geometry" if mistakes else "no problems"
    print(f"{target}: {len(site.map.objects)} objects, {found}. Next: somrs check {quoted}, somrs up {quoted}")


def _import_problem(sources: Sequence[Path], output: Path | None) -> None:
    imported = problem_of(sources)
    target = output or _target_of(sources[-1])
    target.write_text(dump_site(imported.ontology, imported.map, imported.name), encoding="utf-8")
    for note in imported.notes:
        print(f"note: {note}")
    summary = f"{_count(target)} objects, {len(imported.agents)} devices, {len(imported.services)} service types"
    print(f"{target}: {summary}, no problems. Next: somrs up {shlex.quote(str(target))}")
    print(f"and in another terminal: somrs do {shlex.quote(imported.task)}")


def problem_of(sources: Sequence[Path]) -> ImportedProblem:
    """Read a planning problem from its two files. Raises UsageError or ModelError."""
    from somrs.sites.pddl import read

    if len(sources) != 2 or any(source.suffix != _PDDL for source in sources):
        raise UsageError("a problem in PDDL has two files, first the domain, then the problem: somrs import domain.pddl problem.pddl")
    domain, problem = sources
    return read(domain, problem)


def _count(target: Path) -> int:
    """Check the file, and return its number of objects. Raises ModelError if it has errors."""
    loaded = load([target])
    return len(loaded.map.objects) if loaded.map is not None else 0


def importer(source: Path) -> Importer | None:
    """The importer for a file of this name; None for map and ontology files."""
    from somrs.sites import importer_of

    return importer_of(source)


def _target_of(source: Path) -> Path:
    """The default name of the map file, in the current folder."""
    return Path(source.name.split(".")[0] + ".map.yaml")


def write_import(reader: Importer, source: Path, target: Path) -> Site:
    """Import `source` as it is by default, and write it to `target`."""
    from somrs.sites import ImportOptions

    site = reader(source, ImportOptions())
    target.write_text(dump_site(site.ontology, site.map), encoding="utf-8")
    return site


def import_sources(site: Sequence[Path], data: Path) -> list[Path]:
    """The map and ontology files of a site. Buildings and planning problems are first imported to the data folder, with a report."""
    files: list[Path] = []
    for file in site:
        if (reader := importer(file)) is not None:
            files.append(data / _target_of(file))
            terminal.console().print(import_report.report(write_import(reader, file, files[-1]), details=False))
        elif file.suffix != _PDDL:
            files.append(file)
    if stated := [file for file in site if file.suffix == _PDDL]:
        imported = problem_of(stated)
        files.append(data / _target_of(stated[-1]))
        files[-1].write_text(dump_site(imported.ontology, imported.map, imported.name), encoding="utf-8")
    return files
