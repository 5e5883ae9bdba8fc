"""The furniture models of Open-RMF's worlds, with their types and real sizes.

The x axis of a model is the long side of tables and cabinets. The sizes fit the poses in Open-RMF's demo worlds: neighbouring models do not
overlap, and objects on a table are at the height of its top.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Model:
    """A furniture model as a box: the parent of its type, and width, depth and height in metres."""

    parent: str
    width: float
    depth: float
    height: float
    color: str = "Grey"


MODELS: dict[str, Model] = {
    "AdjTable": Model("Table", 1.2, 0.65, 0.8, "Brown"),
    "BigCubicle": Model("Table", 1.4, 0.8, 0.74, "Grey"),
    "BookShelf": Model("Shelf", 0.8, 0.35, 1.0, "Brown"),
    "CoffeeTable": Model("Table", 0.6, 0.6, 0.45, "Brown"),
    "ConfTable": Model("Table", 3.6, 1.2, 0.8, "Brown"),
    "Drawer": Model("Cupboard", 0.4, 0.55, 0.63, "White"),
    "Fridge": Model("Obstacle", 0.62, 0.6, 1.8, "White"),
    "MetalCabinet": Model("Cupboard", 0.88, 0.45, 1.0, "Grey"),
    "MetalCabinetYellow": Model("Cupboard", 0.88, 0.45, 1.0, "Yellow"),
    "OfficeChairBlack": Model("Chair", 0.5, 0.5, 0.95, "Black"),
    "OfficeChairBlue": Model("Chair", 0.5, 0.5, 0.95, "Blue"),
    "OfficeChairGrey": Model("Chair", 0.5, 0.5, 0.95, "Grey"),
    "PotatoChipChair": Model("Chair", 0.5, 0.5, 0.8, "Red"),
    "SmallCubicle": Model("Table", 1.3, 0.75, 0.74, "Grey"),
    "Sofa": Model("Chair", 1.8, 0.85, 0.75, "Blue"),
    "SquareShelf": Model("Shelf", 0.8, 0.4, 0.8, "White"),
    "Table": Model("Table", 1.2, 0.8, 0.75, "Brown"),
    "TrashBin": Model("Bin", 0.34, 0.34, 0.6, "Black"),
    "WhiteCabinet": Model("Cupboard", 0.9, 0.45, 1.08, "White"),
}

THINGS: dict[str, str] = {"Coke": "Can", "BeerCan": "Can", "CokeCan": "Can", "Bottle": "Bottle", "CoffeeCup": "Cup", "Cup": "Cup"}
"""Models that robots can carry, with the type of the upper ontology that has their size."""

UNKNOWN = Model("Obstacle", 0.5, 0.5, 0.5)
