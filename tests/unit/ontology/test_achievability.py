"""What no service could ever bring about, by the effects of services alone."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.achievability import Achievability
from somrs.ontology.files.loading import load_text
from somrs.ontology.services import ServiceKind, ServiceType
from tests.support.laboratory import MAP, OPEN, TRANSFER, WASH, laboratory

LOOK = ServiceType(name="Look", effect="?Thing isOn ?Place", kind=ServiceKind.COGNITIVE)


@pytest.mark.parametrize(
    ("goal", "parts"),
    [
        ("Jar001 isOn Platform001", []),
        (
            "Shelf1 isOn Platform001",
            [("Shelf1 isOn Platform001", "TransferObject takes only a Graspable as its Object, and Shelf1 is a Shelf")],
        ),
        ("Jar001.Clean = TRUE AND DoorAB.Open = TRUE", [("Jar001.Clean = TRUE", "")]),
        ("NOT (Jar001 isOn Shelf1 OR connects(DoorAB, RoomA, RoomB))", [("NOT connects(DoorAB, RoomA, RoomB)", "")]),
        ("Jar001.Clean = TRUE OR Jar001 isOn Platform001", []),
        ("connects(DoorAB, RoomA, RoomB)", []),  # it holds
        (
            "FORALL ?Shelf: Shelf (?Shelf isOn Platform001)",
            [("?Shelf: Shelf isOn Platform001", "")],
        ),
        ("FORALL ?Jar: Jar (NOT ?Jar isOn Shelf2 OR ?Jar isOn Platform001)", []),
        ("EXISTS ?Jar: Jar (?Jar isOn Platform001 AND ?Jar.Clean = TRUE)", [("?Jar: Jar.Clean = TRUE", "")]),
    ],
)
def test_the_parts_that_no_service_brings_about(goal: str, parts: list[tuple[str, str]]) -> None:
    unachievable = Achievability([TRANSFER, OPEN], laboratory(), MAP, {}).unachievable_parts(parse(goal))
    assert [(str(part.literal), part.reason) for part in unachievable] == parts


def test_a_service_that_only_tells_gives_no_reason() -> None:
    unachievable = Achievability([LOOK, WASH], laboratory(), MAP, {}).unachievable_parts(parse("Shelf1 isOn Platform001"))
    assert [part.reason for part in unachievable] == [""]


SITE = """
map: House
types:
  Rack: {parent: Furniture}
  Stool: {parent: Obstacle}
  Cart: {parent: MobileRobot}
services:
  Weld:
    inputs: {Object: Jar}
    precondition: "?Object.Weight <= ?Provider.Payload AND ?Object isIn ?Cupboard"
    effect: "?Object.Color = Red"
  Paint: {inputs: {Object: Jar}, precondition: "?Object.Color = Red", effect: "?Object.Color = Blue"}
objects:
  House: {type: Building, parts: {Level: {type: Storey}}}
  Ground: {type: Floor, at: [0, 0, 0], Shape: {Form: Box, Width: 9, Depth: 9, Height: 0.1}}
  Rack1: {type: Rack, at: [1, 0, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}}
  Stool1: {type: Stool, at: [2, 0, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}}
  Stool2: {type: Stool, at: [3, 0, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}, Supporting: true}
  Box1: {type: Cupboard, at: [6, 0, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}, Open: true}
  Wall1: {type: Wall, at: [4, 0, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 1}}
  Cart1: {type: Cart, at: [5, 0], Payload: 1}
  Jar1: {type: Jar, at: [1, 0, 1]}
  Jar2: {type: Jar, at: [1, 0.2, 1], Weight: 3}
facts:
  - Ground isPartOf Level
  - Jar1 isOn Rack1
  - Jar2 isOn Rack1
"""


@pytest.mark.parametrize(
    ("goal", "reason", "remedy"),
    [
        (
            "Jar1 isOn Stool1",
            "TransferObject needs Stool1.Supporting = TRUE, and it is FALSE, by default for a Stool"
            " (Supporting: whether things can be put on it)",
            "it holds for Rack1, Ground, Stool2 and 2 more; if it holds for Stool1, too, correct the map",
        ),
        ("Jar1 isOn Wall1", "TransferObject needs Wall1.Supporting = TRUE", "it holds for Rack1"),
        ("Jar1 isOn House", "TransferObject needs House.Supporting = TRUE", "it holds for Rack1"),
        ("Jar1 isOn Jar2", "TransferObject needs Jar2.Supporting = TRUE", "it holds for Rack1"),
        ("Jar1 isOn Stool2", None, ""),  # as the object itself states
        ("Jar1 isOn Rack1 AND Jar1 isOn Cart1", None, ""),
        ("Jar1 isOn Stool1 OR Jar1 isOn Ground", None, ""),
        ("FORALL ?Jar: Jar (?Jar isOn Stool1)", "TransferObject needs Stool1.Supporting = TRUE", "it holds for Rack1"),
        ("EXISTS ?Stool: Stool (Jar1 isOn ?Stool)", None, ""),
        ("FORALL ?Person: Person (Jar1 isHeldBy ?Person)", None, ""),  # there is none, so it holds
        ("EXISTS ?Wall: Wall (Jar1 isOn ?Wall)", "TransferObject needs ?Wall.Supporting = TRUE, and that holds for no Wall", ""),
        ("?Source isOn Ground", None, ""),  # its name is that of a variable of the precondition
        ("Jar1.Color = Red", None, ""),
        ("Jar2.Color = Red", "Weld needs Jar2.Weight <= ?.Payload, and it is 3 kg", ""),
        ("Jar2.Color = Blue", "Paint needs Jar2.Color = Red", ""),
    ],
)
def test_a_condition_that_nobody_can_bring_about(goal: str, reason: str | None, remedy: str) -> None:
    loaded = load_text(SITE)
    assert loaded.map is not None
    services = [service for service in loaded.ontology.services.values() if service.name in ("TransferObject", "PutInto", "Weld", "Paint")]
    providers = {"Weld": ["Cart1"]}
    unachievable = [*Achievability(services, loaded.ontology, loaded.map, providers).unachievable_parts(parse(goal))]
    assert bool(unachievable) == (reason is not None)
    for part in unachievable:
        assert part.reason.startswith(reason or "")
        assert part.remedy.startswith(remedy)
