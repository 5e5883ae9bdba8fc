"""A field for saying where a thing is, by choosing the place from a list."""

from __future__ import annotations

from collections.abc import Callable

from somrs.devices.person.wording import words
from somrs.gui.components.fields.picker import Choice, Picker
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.types import Ontology

PLACES = {"Cupboard": ("isOn", "isIn"), "Support": ("isOn",), "Place": ("isOn",), "Floor": ("isOn",)}
"""Types of objects on which or in which people put things, and the relations; the first that fits counts."""


class PlacePicker(Picker):
    """Where `thing` is. `on_choice` receives it as a formula."""

    def __init__(self, thing: str, map: Map, ontology: Ontology, on_choice: Callable[[str], None]) -> None:
        label = f"Where is {thing}?"
        super().__init__(label, placeholder="Choose the place", options=place_choices(thing, map, ontology), on_pick=on_choice)


def place_choices(thing: str, map: Map, ontology: Ontology) -> list[Choice]:
    """The places of the map, the named ones first; the values are formulas."""
    choices: list[Choice] = []
    for name in sorted(map.objects):
        object = map.objects[name]
        relations = next((PLACES[type] for type in PLACES if ontology.is_subtype(object.type, type)), ())
        if name != thing:
            choices += [_choice(thing, relation, object) for relation in relations]
    return choices


def _choice(thing: str, relation: str, place: Object) -> Choice:
    color, label = place.values.get("Color"), place.values.get("Label")
    detail = " ".join(str(part).lower() for part in (color, words(place.type)) if part is not None)
    return {"value": f"{thing} {relation} {place.name}", "text": f"{words(relation)[3:]} {label or place.name}", "detail": detail}
