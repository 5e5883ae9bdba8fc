"""Imports existing buildings: one importer for each file format, chosen by the ending of the file name, or by what is in the file."""

from __future__ import annotations

from pathlib import Path

from somrs.errors import UsageError
from somrs.sites.lif import import_layouts
from somrs.sites.occupancy import is_occupancy_map
from somrs.sites.openrmf import import_building
from somrs.sites.site import Importer, ImportOptions, Site

IMPORTERS: dict[str, Importer] = {".building.yaml": import_building, ".lif": import_layouts, ".lif.json": import_layouts}
"""By the ending of the file name."""


def importer_of(path: Path) -> Importer | None:
    """What imports this file; None for map and ontology files."""
    by_name = next((importer for ending, importer in IMPORTERS.items() if path.name.endswith(ending)), None)
    if by_name is not None:
        return by_name
    return _import_occupancy_map if path.suffix in (".yaml", ".yml") and is_occupancy_map(path) else None


def _import_occupancy_map(path: Path, options: ImportOptions) -> Site:
    try:
        from somrs.sites.occupancy.importing import import_occupancy_map
    except ModuleNotFoundError as error:
        raise UsageError(f"occupancy maps need {error.name}: pip install 'somrs[mapping]'") from None
    return import_occupancy_map(path)


__all__ = ["IMPORTERS", "ImportOptions", "Importer", "Site", "importer_of"]
