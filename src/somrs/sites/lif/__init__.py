"""Reads and writes the Layout Interchange Format (LIF 1.0.0, VDMA): the tracks of driverless vehicles, for exchange with other systems."""

from somrs.sites.lif.reading import import_layouts
from somrs.sites.lif.writing import export_layouts

__all__ = ["export_layouts", "import_layouts"]
