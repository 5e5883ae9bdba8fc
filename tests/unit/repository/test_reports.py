"""Reports of objects that come and go, and of when they were observed."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved, ValueSet
from somrs.ontology.types import UNKNOWN, Value
from somrs.protocol.messages.knowledge import Rejected, RenameObject, Updated, UpdateMap
from somrs.protocol.messages.observations import Observation, Reception
from somrs.repository.reports import free_name, things_at
from tests.support.examples import examples
from tests.support.reporting import RED_JAR, Reporting


@pytest.fixture
def lab() -> Reporting:
    return Reporting()


# What comes


def test_what_the_map_does_not_have_is_added(lab: Reporting) -> None:
    assert lab.reception(RED_JAR) == Reception(names={"It": "Jar003"}, added=("Jar003",))
    assert lab.map.objects["Jar003"].values == {"Color": "Red", "PositionX": 8.0, "PositionY": 8.1, "PositionZ": 0.7}
    assert lab.place("Jar003") == "Table2"
    (event,) = lab.events
    assert (event.author, event.reception) == ("Camera1", Reception(names={"It": "Jar003"}, added=("Jar003",)))
    assert lab.repository.contents.provenance.discoveries["Jar003"].author == "Camera1"
    assert lab.reception(RED_JAR, 101.0) == Reception(names={"It": "Jar003"}), "the same again is the same jar"
    assert len(lab.events) == 1


def test_what_is_on_the_map_has_moved(lab: Reporting) -> None:
    moved = "?It: Graspable isOn Table1 AND ?It.PositionX = 1.3 AND ?It.PositionY = 1.1 AND ?It.PositionZ = 0.7 AND ?It.Color = Blue"
    assert lab.reception(moved) == Reception(names={"It": "Jar2"})
    assert (lab.map.objects["Jar2"].type, lab.map.objects["Jar2"].values["PositionX"]) == ("Jar", 1.3)


def test_sighted_objects_may_be_related_to_each_other(lab: Reporting) -> None:
    held = "?Jar: Jar isHeldBy ?Robot: PioneerP3DX AND " + " AND ".join(
        f"?{seen}.Position{axis} = 5" for seen in ("Robot", "Jar") for axis in "XY"
    )
    assert lab.reception(held, sought=("Jar1",)).names == {"Jar": "Jar1", "Robot": "Robot1"}
    assert [str(fact) for fact in lab.map.facts("isHeldBy")] == ["Jar1 isHeldBy Robot1"]


def test_a_device_is_not_added_by_a_sighting(lab: Reporting) -> None:
    assert lab.reception("?Robot: PatrolRobot isAdjacentTo Table1") == Reception(unidentified=("Robot",))
    assert not any(object.type == "PatrolRobot" for object in lab.map.objects.values())


@pytest.mark.parametrize(
    ("situation", "problem"),
    [
        ("?It isOn Table1", "?It is not bound"),
        ("?It: Jarr isOn Table1", "there is no type Jarr"),
        ("?It: AbstractObject isPartOf Room1", "only physical objects are seen"),
        ("?It: Jar isOn Table9", "there is no object Table9 on the map"),
        ("?It: Jar.Speed = 3", "a Jar has no attribute Speed"),
        ("?It: Jar isOn Table2", "PositionX"),
    ],
)
def test_a_report_that_cannot_be_understood_is_rejected(lab: Reporting, situation: str, problem: str) -> None:
    answer = lab.report(situation)
    assert isinstance(answer, Rejected)
    assert problem in answer.problems[0]
    assert not lab.events


def test_new_names_are_never_those_of_other_objects() -> None:
    assert free_name("Jar", ["Jar1", "Jar009", "JarX", "Cup77"]) == "Jar010"
    assert free_name("Cup", []) == "Cup001"


def test_a_name_is_not_given_twice(lab: Reporting) -> None:
    lab.reception(RED_JAR)
    lab.reception(now=101.0, gone=("Jar003",))
    assert lab.reception(RED_JAR, now=102.0).added == ("Jar004",), "the history of Jar003 is that of another jar"


# What goes


def test_what_is_gone_leaves_the_map(lab: Reporting) -> None:
    assert lab.reception(gone=("Jar1",)) == Reception()
    assert "Jar1" not in lab.map.objects
    assert lab.reception(gone=("Jar1",), now=101.0) == Reception(), "it is known already"
    assert isinstance(lab.report(gone=("Jarr",)), Rejected)
    answer = lab.report(gone=("Robot1",))
    assert isinstance(answer, Rejected)
    assert answer.broken[0].rule == "device"


def test_what_was_searched_in_vain_is_unknown(lab: Reporting) -> None:
    seen = "?It: Jar isOn Table1 AND ?It.PositionX = 1 AND ?It.PositionY = 1 AND ?It.PositionZ = 0.7"
    reception = lab.reception(seen, searched=("Table1",))
    assert (reception.names, reception.missing) == ({"It": "Jar1"}, ("Jar2",))
    assert (lab.map.objects["Jar2"].values[UNKNOWN], lab.place("Jar2"), lab.place("Jar1")) == (True, None, "Table1")
    # It turns up elsewhere, and is no new jar.
    assert lab.reception(RED_JAR.replace("Red", "Blue"), now=101.0).names == {"It": "Jar2"}
    assert (lab.map.objects["Jar2"].values.get(UNKNOWN), lab.place("Jar2")) == (None, "Table2")


def test_what_is_not_where_it_was_may_be_what_is_seen_elsewhere(lab: Reporting) -> None:
    assert lab.reception(RED_JAR.replace("Red", "Blue"), searched=("Table1",)) == Reception(names={"It": "Jar2"}, missing=("Jar1",))


def test_what_was_missed_in_full_view_is_unknown_or_seen_elsewhere(lab: Reporting) -> None:
    assert lab.reception(missed=("Jar1",)).missing == ("Jar1",)
    assert (lab.map.objects["Jar1"].values[UNKNOWN], lab.place("Jar1"), lab.place("Jar2")) == (True, None, "Table1")
    reception = lab.reception(RED_JAR.replace("Red", "Blue"), missed=("Jar2",), now=101.0)
    assert (reception.names, reception.missing) == ({"It": "Jar2"}, ()), "it was moved"
    assert isinstance(lab.report(missed=("Jarr",), now=102.0), Rejected)


def test_things_at_an_area_are_those_on_its_parts_too(lab: Reporting) -> None:
    lab.report("Table1 isOn Floor1")
    ontology = lab.repository.contents.ontology
    assert {*things_at("Storey1", lab.map, ontology)} == {"Table1", "Jar1", "Jar2"}


# When it was


def test_older_news_does_not_replace_newer(lab: Reporting) -> None:
    lab.report("Jar1 isOn Table2 AND Jar1.Color = Red", as_of=50.0)
    late = lab.reception("Jar1 isOn Floor1 AND Jar1.Weight = 0.5 AND NOT Jar1 isOn Table2", as_of=40.0)
    assert late.superseded == ("Jar1 isOn Floor1", "NOT Jar1 isOn Table2")
    assert (lab.place("Jar1"), lab.map.objects["Jar1"].values["Weight"]) == ("Table2", 0.5)
    assert lab.events[-1].reception == late, "the history tells what was left out"
    assert lab.reception("Jar1 isOn Floor1", as_of=60.0).superseded == ()
    assert lab.place("Jar1") == "Floor1"


def test_older_news_that_the_map_has_anyway_is_not_old_news(lab: Reporting) -> None:
    lab.report("Jar1.Color = Red", as_of=50.0)
    assert lab.reception("Jar1.Color = Red", as_of=40.0).superseded == ()
    assert lab.reception("Jar1.Color = Blue", as_of=40.0).superseded == ("Jar1.Color = Blue",)


def test_a_report_without_a_time_holds_when_it_arrives(lab: Reporting) -> None:
    lab.report("Jar1 isOn Table2", now=50.0)
    assert lab.reception("Jar1 isOn Floor1", now=60.0, as_of=49.0).superseded == ("Jar1 isOn Floor1",)
    lab.report("Jar1 isOn Floor1", now=61.0, as_of=1e9)  # of a clock that is fast
    assert lab.reception("Jar1 isOn Table1", now=62.0).superseded == ()
    assert lab.place("Jar1") == "Table1"


def test_news_that_confirms_the_map_counts_too(lab: Reporting) -> None:
    version = lab.repository.contents.version
    lab.report("Jar1 isOn Table1", as_of=50.0)
    assert lab.repository.contents.version == version
    assert lab.reception("Jar1 isOn Table2", as_of=40.0).superseded == ("Jar1 isOn Table2",)


def test_a_late_report_of_an_object_that_is_gone_does_not_bring_it_back(lab: Reporting) -> None:
    lab.report(gone=("Jar2",), as_of=50.0)
    late = "?It: Jar isOn Table1 AND ?It.PositionX = 1.2 AND ?It.PositionY = 1.6 AND ?It.PositionZ = 0.7 AND ?It.Color = Blue"
    assert lab.reception(late, as_of=40.0, now=101.0).names == {}
    assert lab.reception("Jar2 isOn Table2", as_of=40.0, now=102.0).superseded == ("Jar2 isOn Table2",)
    assert isinstance(lab.report("Jar2 isOn Table2", as_of=60.0, now=103.0), Rejected)
    lab.report("Jar1 isOn Table2", as_of=60.0, now=104.0)
    assert lab.reception(gone=("Jar1",), as_of=55.0, now=105.0).superseded == ("Jar1 is gone",)


def test_a_late_sighting_of_an_object_that_was_moved_since_adds_none(lab: Reporting) -> None:
    lab.report("Jar2 isOn Table2 AND Jar2.PositionX = 8 AND Jar2.PositionY = 8", as_of=50.0)
    late = "?It: Jar isOn Floor1 AND ?It.PositionX = 5 AND ?It.PositionY = 5 AND ?It.PositionZ = 0 AND ?It.Color = Blue"
    assert lab.reception(late, as_of=40.0) == Reception(as_of=40.0, unidentified=("It",))
    assert lab.reception(late, as_of=60.0, now=101.0).added == ("Jar003",)


def test_a_changed_value_is_marked_by_its_time_too(lab: Reporting) -> None:
    red = UpdateMap(changes=(ValueSet("Jar1", "Color", "Red"),), observation=Observation(as_of=50.0))
    blue = UpdateMap(changes=(ValueSet("Jar1", "Color", "Blue"), ObjectRemoved("Jar1")), observation=Observation(as_of=40.0))
    lab.update(red)
    answer = lab.update(blue)
    assert isinstance(answer, Updated)
    assert answer.reception == Reception(as_of=40.0, superseded=("Jar1.Color = Blue", "Jar1 is gone"))


@pytest.mark.parametrize("confirmed", ["Jar2 isOn Table2", "Jar2.PositionX = 8 AND Jar2 isOn Table2"])
def test_news_that_changes_nothing_is_newer_than_that_nothing_was_known_before(lab: Reporting, confirmed: str) -> None:
    lab.reception("Jar2 isOn Table2 AND Jar2.PositionX = 8 AND Jar2.PositionY = 8", as_of=20.0)
    event_count = len(lab.events)
    lab.reception(confirmed, as_of=50.0)
    assert len(lab.events) == event_count, "the map has it already"
    fact = Fact("isOn", ("Jar2", "Table2"))
    changes = (FactRemoved(fact), ValueSet("Jar2", UNKNOWN, True))
    answer = lab.update(UpdateMap(changes=changes, observation=Observation(as_of=40.0)))
    assert isinstance(answer, Updated)
    assert answer.reception == Reception(as_of=40.0, superseded=("NOT Jar2 isOn Table2", "Jar2.Unknown = True"))
    assert (lab.place("Jar2"), lab.map.objects["Jar2"].values.get(UNKNOWN)) == ("Table2", None)
    lab.update(UpdateMap(changes=changes, observation=Observation(as_of=60.0)))
    assert (lab.place("Jar2"), lab.map.objects["Jar2"].values.get(UNKNOWN)) == (None, True)


@pytest.mark.parametrize("seen_first", [True, False])
def test_what_a_service_did_is_newer_than_what_was_seen_at_the_same_time(lab: Reporting, seen_first: bool) -> None:
    reports = [("Jar1 isHeldBy Robot1 AND Jar1.Unknown = FALSE", False), ("Jar1 isOn Table2", True)]
    for situation, caused in reports if seen_first else reversed(reports):
        lab.report(situation, as_of=50.0, caused=caused)
    assert (lab.place("Jar1"), [*lab.map.facts("isHeldBy")]) == ("Table2", [])
    lab.report("Jar1 isOn Table1", as_of=50.001)
    assert lab.place("Jar1") == "Table1"


def test_a_fact_that_is_older_than_its_end_is_not_added(lab: Reporting) -> None:
    """News of facts as changes, in any order, leads to the same map as news of them in formulas."""
    on_table2, adjacent = Fact("isOn", ("Jar1", "Table2")), Fact("isAdjacentTo", ("Room1", "Room2"))
    for fact in (on_table2, adjacent):
        lab.update(UpdateMap(changes=(FactRemoved(fact),), observation=Observation(as_of=50.0)))
    on_table1 = Fact("isOn", ("Jar1", "Table1"))
    late = UpdateMap(changes=(FactRemoved(on_table1), FactAdded(on_table2), FactAdded(adjacent)), observation=Observation(as_of=40.0))
    answer = lab.update(late)
    assert isinstance(answer, Updated)
    assert answer.reception == Reception(as_of=40.0, superseded=("Jar1 isOn Table2", "Room1 isAdjacentTo Room2"))
    assert (lab.place("Jar1"), [*lab.map.facts("isAdjacentTo")]) == (None, [])
    assert lab.reception("Jar1 isOn Table1", as_of=30.0).superseded == ("Jar1 isOn Table1",), "it was on Table2 after that"
    assert lab.reception("Jar1 isOn Table1", as_of=45.0).superseded == ()


def test_a_renamed_object_keeps_its_times(lab: Reporting) -> None:
    lab.report("Jar1 isOn Table2", as_of=50.0)
    lab.update(RenameObject(name="Jar1", to="Pot1"))
    assert lab.reception("Pot1 isOn Table1", as_of=40.0).superseded == ("Pot1 isOn Table1",)


def test_an_object_that_a_person_adds_is_no_discovery(lab: Reporting) -> None:
    values: dict[str, Value] = {"PositionX": 8.0, "PositionY": 8.0, "PositionZ": 0.7}
    lab.update(UpdateMap(changes=(ObjectAdded(Object(name="Jar9", type="Jar", values=values)),)))
    assert not lab.repository.contents.provenance.discoveries


parts = st.sampled_from(
    [
        "Jar1 isOn Table1", "Jar1 isOn Table2", "Jar1 isOn Floor1", "NOT Jar1 isOn Table1", "NOT Jar1 isOn Table2", "Jar1 isHeldBy Robot1",
        "Jar1.Color = Red", "Jar1.Color = Blue", "Jar2 isOn Table2", "Jar2 isOn Floor1", "Jar1.Unknown = TRUE", "Jar1.Unknown = FALSE",
        "Room1 isAdjacentTo Room2", "NOT Room2 isAdjacentTo Room1",
    ]
)  # fmt: skip


@examples(150)
@given(st.lists(parts, min_size=1, max_size=7), st.integers())
def test_reports_in_any_order_lead_to_the_newest_facts(situations: list[str], seed: int) -> None:
    reports = [*zip(itertools.count(10.0), situations)]
    in_order, shuffled = Reporting(), Reporting()
    for as_of, situation in reports:
        in_order.report(situation, as_of=as_of)
    for as_of, situation in random.Random(seed).sample(reports, len(reports)):
        shuffled.report(situation, as_of=as_of)
    assert known(shuffled.map) == known(in_order.map)


def known(map: Map) -> tuple[dict[str, Object], set[str]]:
    """The objects and facts. An object that is not unknown is known, whether or not the map says so."""
    objects = {
        name: structs.replace(o, values={p: v for p, v in o.values.items() if (p, v) != (UNKNOWN, False)})
        for name, o in map.objects.items()
    }
    return objects, {str(fact) for fact in map.facts()}
