"""Imports buildings from files of Open-RMF's traffic editor (`.building.yaml`)."""

from somrs.sites.openrmf.importing import import_building, import_text

__all__ = ["import_building", "import_text"]
