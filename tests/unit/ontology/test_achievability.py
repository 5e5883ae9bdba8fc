"""What no service could ever bring about, by the effects of services alone."""

from __future__ import annotations

import pytest

from somrs.entish.parse import parse
from somrs.ontology.achievability import unachievable_parts
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
    unachievable = unachievable_parts(parse(goal), [TRANSFER, OPEN], laboratory(), MAP)
    assert [(str(part.literal), part.reason) for part in unachievable] == parts


def test_a_service_that_only_tells_gives_no_reason() -> None:
    unachievable = unachievable_parts(parse("Shelf1 isOn Platform001"), [LOOK, WASH], laboratory(), MAP)
    assert [part.reason for part in unachievable] == [""]
