"""Names of objects on the maps of others.

On its own map, an object has its plain name (`Jar9`). On the map of a neighbour, the name is qualified with that of its home (`Barn:Jar9`),
so that the names of different owners cannot clash.
"""

from __future__ import annotations

SEPARATOR = ":"


def home_of(name: str) -> str:
    """The map that owns an object, given its name on another map; empty for the own objects of a map."""
    return name.partition(SEPARATOR)[0] if SEPARATOR in name else ""


def plain_name(name: str) -> str:
    """The name of an object on its own map."""
    return name.rpartition(SEPARATOR)[2]


def translated(name: str, from_map: str, to_map: str) -> str:
    """The name on `to_map` of an object that has this name on `from_map`."""
    qualified_name = name if home_of(name) else f"{from_map}{SEPARATOR}{name}"
    return plain_name(name) if home_of(qualified_name) == to_map else qualified_name
