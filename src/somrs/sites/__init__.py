"""Imports existing buildings: one importer for each file format, chosen by the ending of the file name."""

from __future__ import annotations

from somrs.sites.lif import import_layouts
from somrs.sites.openrmf import import_building
from somrs.sites.site import Importer, ImportOptions, Site

IMPORTERS: dict[str, Importer] = {".building.yaml": import_building, ".lif": import_layouts, ".lif.json": import_layouts}

__all__ = ["IMPORTERS", "ImportOptions", "Importer", "Site"]
