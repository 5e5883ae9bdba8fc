"""Measures loading, checking, querying and changing maps of 5,000 objects, beside the minimum of such work.

Run it as `python benchmarks/maps.py`.
"""

from __future__ import annotations

import pint
import yaml
from timing import side_by_side

from somrs.api.formulas import check_text
from somrs.entish.parse import parse
from somrs.ontology import units
from somrs.ontology.completion import complete
from somrs.ontology.conformance import violations
from somrs.ontology.files.dump import dump_map
from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.truth import bindings
from somrs.ontology.types import Ontology, Value
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.update import update_outcome

TABLES = 2500
SHAPE: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 1.2, "Shape.Depth": 0.7, "Shape.Height": 0.75, "RotationZ": 1.0}


def hall() -> Map:
    """Return a storey with many tables, and a jar on each."""
    floor: dict[str, Value] = {"PositionX": 1250.0, "PositionY": 0.0, "PositionZ": -0.1, "Shape.Form": "Box", "Shape.Height": 0.1}
    objects = [
        Object(name="Building1", type="Building"),
        Object(name="Storey1", type="Storey"),
        Object(name="Floor1", type="Floor", values={**floor, "Shape.Width": 2600.0, "Shape.Depth": 20.0}),
    ]
    facts = [Fact("isPartOf", ("Storey1", "Building1")), Fact("isPartOf", ("Floor1", "Storey1"))]
    for n in range(TABLES):
        position: dict[str, Value] = {"PositionX": float(n), "PositionY": 0.5, "PositionZ": 0.0}
        color = "Blue" if n % 100 else "Red"
        objects += [
            Object(name=f"Table{n}", type="Table", values={**position, **SHAPE}),
            Object(name=f"Jar{n}", type="Jar", values={**position, "PositionZ": 0.75, "Color": color}),
        ]
        facts.append(Fact("isOn", (f"Jar{n}", f"Table{n}")))
    return Map(objects, facts)


def load(text: str, map: Map) -> None:
    assert load_text(text).map == map
    ways = {
        "yaml.CSafeLoader, the bare text": lambda: yaml.load(text, yaml.CSafeLoader),
        "load_text: checked, with positions for errors": lambda: load_text(text),
    }
    side_by_side(f"loading {len(map.objects)} objects, {len(text) // 1000} kB", ways, rounds=3)


def check(map: Map, ontology: Ontology) -> None:
    assert violations(map, ontology) == []
    ways = {
        "one access to each value and fact": lambda: (
            sum(value is not None for item in map.objects.values() for value in item.values.values()) + sum(1 for _ in map.facts())
        ),
        "violations: does the map conform to its types": lambda: violations(map, ontology),
    }
    side_by_side("checking", ways, rounds=5)


def ask(map: Map, ontology: Ontology) -> None:
    def plain_red() -> list[str]:
        return [name for name, item in map.objects.items() if item.values.get("Color") == "Red"]

    def count_matches(text: str) -> int:
        return len(list(bindings(parse(text), map, ontology)))

    red = len(plain_red())
    assert count_matches("?j: Jar.Color = Red AND ?j isOn ?t") == red
    ways = {
        "a loop over all objects: which are red": plain_red,
        "Jar7 isOn ?t": lambda: count_matches("Jar7 isOn ?t"),
        "?j: Jar.Color = Red AND ?j isOn ?t": lambda: count_matches("?j: Jar.Color = Red AND ?j isOn ?t"),
        "?j: Jar isOn ?t (all)": lambda: count_matches("?j: Jar isOn ?t"),
        "?j: Jar.PositionX < 2000 cm (pint)": lambda: count_matches("?j: Jar.PositionX < 2000 cm"),
        "distance(?j: Jar, Table7) < 150 cm (pint)": lambda: count_matches("distance(?j: Jar, Table7) < 150 cm"),
    }
    side_by_side("asking", ways)


def convert() -> None:
    registry: pint.UnitRegistry[float] = pint.UnitRegistry()
    numbers = iter(range(10**9))
    ways = {
        "a multiplication": lambda: next(numbers) * 0.01,
        "pint, cm to m": lambda: registry.convert(float(next(numbers)), "cm", "m"),
        "units.converted, a new number": lambda: units.convert_unit(float(next(numbers)), "cm", "m"),
        "units.converted, a number again": lambda: units.convert_unit(150.0, "cm", "m"),
    }
    side_by_side("converting a number's unit", ways)


def change(map: Map, ontology: Ontology) -> None:
    moved = UpdateMap(situation="Jar7 isOn Table9 AND Jar7.PositionX = 9.1")
    bulk_update = UpdateMap(situation=" AND ".join(f"Jar{n}.PositionX = {n}.1" for n in range(100)))
    assert not update_outcome(map, ontology, moved).broken
    assert not update_outcome(map, ontology, bulk_update).broken
    ways = {
        "a copy of the dict of objects": lambda: dict(map.objects),
        "one jar moved": lambda: update_outcome(map, ontology, moved),
        "a hundred values set": lambda: update_outcome(map, ontology, bulk_update),
    }
    side_by_side("changing, as the Repository does", ways)


def write(map: Map, ontology: Ontology) -> None:
    numbers = iter(range(10**9))

    def typed(rest: str) -> str:
        """Return a new text each time, as when a user types."""
        return f"Jar7 isOn ?Where: Platform AND Jar7.PositionX < {next(numbers)} AND Jar7.Color = {rest}"

    assert check_text(typed("Red"), ontology, map, {}).ok
    ways = {
        "parse: the text alone": lambda: parse(typed("Red")),
        "checked: does it conform to ontology and map": lambda: check_text(typed("Red"), ontology, map, {}),
        "complete: proposals for its end": lambda: complete(text := typed(""), len(text), ontology, map),
    }
    side_by_side("writing a formula, as the windows do after each key", ways)


def main() -> None:
    ontology, map = upper(), hall()
    load(dump_map(map, ontology), map)
    check(map, ontology)
    ask(map, ontology)
    convert()
    change(map, ontology)
    write(map, ontology)


if __name__ == "__main__":
    main()
