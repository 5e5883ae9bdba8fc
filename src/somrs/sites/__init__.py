"""Imports existing buildings: one importer for each file format, chosen by the ending of the file name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from somrs.sites.openrmf import import_building
from somrs.sites.site import Site

IMPORTERS: dict[str, Callable[[str | Path], Site]] = {".building.yaml": import_building}

__all__ = ["IMPORTERS", "Site"]
