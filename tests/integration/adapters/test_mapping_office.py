"""A robot of the simulator maps the building of Scenario 1, of which it knows nothing, and its map is compared with the building."""

from __future__ import annotations

import os
from pathlib import Path

from somrs.ontology.conformance import violations
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from tests.support.explored_floor import ExploredFloor
from tests.support.map_comparison import draw
from tests.support.paths import ROOT

EXAMPLE = ROOT / "examples" / "unknown_floor"


def test_the_map_that_a_robot_makes_is_the_building(tmp_path: Path) -> None:
    world, site = load([EXAMPLE / "world.yaml"]), load([EXAMPLE / "site.yaml"])
    assert world.map is not None
    assert site.map is not None

    def check(map: Map) -> None:
        assert list(violations(map, site.ontology)) == []

    floor = ExploredFloor(true=world.map, ontology=world.ontology, made=site.map)
    floor.explore(follow_every=6, followed=check)
    comparison = floor.compare()
    picture = Path(os.environ.get("PICTURE", tmp_path / "office.png"))
    draw(floor.survey.grid(), floor.with_things, floor.true, floor.ontology, picture)
    assert comparison.walls >= 0.95
    assert comparison.invented <= 0.05
    assert comparison.rooms == (2, 2)
    assert comparison.furniture == (8, 8)
    assert comparison.things == (3, 3)
    assert [object.type for object in floor.made.objects.values()].count("Door") == 1
    assert floor.mistakes == []
