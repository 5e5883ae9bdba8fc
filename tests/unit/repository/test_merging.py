"""Objects that turn out to be others."""

from __future__ import annotations

import pytest

from somrs.ontology.objects import Fact, FactAdded, Object, ObjectAdded, ValueSet
from somrs.ontology.types import UNKNOWN, Value
from somrs.protocol.messages.knowledge import MergeObject, Merging, Rejected, RenameObject, Updated, UpdateMap
from somrs.protocol.messages.observations import Discovery, Reception
from somrs.repository.provenance import Provenance
from somrs.repository.rollback import rewind_map
from tests.support.reporting import RED_JAR, Reporting


@pytest.fixture
def lab() -> Reporting:
    """A laboratory in which a camera has discovered Jar003 on Table2, 50 s after 1970."""
    reporting = Reporting()
    assert reporting.reception(RED_JAR, as_of=50.0).added == ("Jar003",)
    return reporting


def merge(lab: Reporting, name: str = "Jar003", into: str = "Jar1") -> None:
    answer = lab.update(MergeObject(name=name, into=into, author="Ann"), 100.0)
    assert isinstance(answer, Updated), answer


def put(lab: Reporting, name: str, type: str, support: str) -> None:
    """A person puts a new object on the map, in the middle of its support."""
    middle = lab.map.objects[support].values
    values: dict[str, Value] = {
        "PositionX": middle["PositionX"],
        "PositionY": middle["PositionY"],
        "PositionZ": 0.0,
        "Shape.Form": "Cylinder",
        "Shape.Radius": 0.04,
        "Shape.Height": 0.14,
    }
    added = ObjectAdded(Object(name=name, type=type, values=values))
    answer = lab.update(UpdateMap(changes=(added, FactAdded(Fact("isOn", (name, support))))))
    assert isinstance(answer, Updated), answer


def provenance(lab: Reporting) -> Provenance:
    return lab.repository.contents.provenance


def test_the_object_has_what_is_known_under_both_names(lab: Reporting) -> None:
    put(lab, "Jar9", "Jar", "Jar003")
    merge(lab)
    assert "Jar003" not in lab.map.objects
    jar = lab.map.objects["Jar1"].values
    assert (jar["PositionX"], jar["PositionY"], jar["Color"], lab.place("Jar1")) == (8.0, 8.1, "Red", "Table2"), "the newer news counts"
    assert lab.place("Jar9") == "Jar1", "what is on it stays there"
    assert lab.events[-1].merged == (Merging(name="Jar003", into="Jar1"),)
    assert lab.events[-1].author == "Ann"


def test_newer_news_of_the_place_stays(lab: Reporting) -> None:
    lab.report("Jar1 isOn Floor1 AND Jar1.PositionX = 4", as_of=60.0)
    merge(lab)
    assert (lab.place("Jar1"), lab.map.objects["Jar1"].values["PositionX"]) == ("Floor1", 4.0)


def test_what_is_missed_is_where_it_was_discovered(lab: Reporting) -> None:
    assert lab.reception(searched=("Table1",), as_of=70.0).missing == ("Jar1", "Jar2")
    merge(lab)
    assert (lab.place("Jar1"), lab.map.objects["Jar1"].values.get(UNKNOWN)) == ("Table2", None)


def test_what_was_missed_where_it_was_discovered_is_missed(lab: Reporting) -> None:
    assert lab.reception(searched=("Table2",), as_of=70.0).missing == ("Jar003",)
    merge(lab)
    assert (lab.place("Jar1"), lab.map.objects["Jar1"].values.get(UNKNOWN)) == (None, True)


def test_attributes_that_an_object_is_recognised_by_stay(lab: Reporting) -> None:
    merge(lab, into="Jar2")
    assert (lab.map.objects["Jar2"].values["Color"], lab.place("Jar2")) == ("Blue", "Table2"), "a camera may err, and a person decides"


def test_the_more_special_type_counts(lab: Reporting) -> None:
    put(lab, "Thing1", "Graspable", "Floor1")
    merge(lab, into="Thing1")
    assert lab.map.objects["Thing1"].type == "Jar"


@pytest.mark.parametrize(
    ("name", "into", "rule"),
    [
        ("Jar003", "Jar003", "duplicate"),
        ("Jar009", "Jar1", "unknown-object"),
        ("Jar003", "Jar9", "unknown-object"),
        ("Jar003", "Table1", "type"),
        ("Jar003", "Robot1", "device"),
        ("Jar1", "Table1", "related"),
    ],
)
def test_what_cannot_be_one_object_is_refused(lab: Reporting, name: str, into: str, rule: str) -> None:
    answer = lab.update(MergeObject(name=name, into=into), 100.0)
    assert isinstance(answer, Rejected)
    assert rule in [broken.rule for broken in answer.broken]


def test_what_is_known_already_is_said(lab: Reporting) -> None:
    merge(lab)
    answer = lab.update(MergeObject(name="Jar003", into="Jar1"))
    assert isinstance(answer, Rejected)
    assert answer.problems == ("Jar003: is known to be Jar1 already [duplicate]",)


def test_an_expected_version_covers_both_objects(lab: Reporting) -> None:
    version = lab.repository.contents.version
    lab.report("Jar1.Weight = 0.5")
    answer = lab.update(MergeObject(name="Jar003", into="Jar1", expected_version=version))
    assert isinstance(answer, Rejected)
    assert answer.broken[0].rule == "overtaken"


def test_late_reports_under_the_lost_name_are_about_the_object(lab: Reporting) -> None:
    merge(lab)
    assert lab.reception("Jar003 isOn Floor1 AND Jar003.Weight = 0.5", as_of=90.0) == Reception(as_of=90.0)
    assert (lab.place("Jar1"), lab.map.objects["Jar1"].values["Weight"]) == ("Floor1", 0.5)
    assert lab.reception("Jar003 isOn Table2", as_of=80.0).superseded == ("Jar1 isOn Table2",), "older news is still older"
    lab.update(UpdateMap(changes=(ValueSet("Jar003", "Color", "Green"),)))
    assert lab.map.objects["Jar1"].values["Color"] == "Green"
    lab.report(gone=("Jar003",), now=120.0)
    assert "Jar1" not in lab.map.objects


def test_late_reports_under_an_earlier_name_are_about_the_object(lab: Reporting) -> None:
    lab.update(RenameObject(name="Jar003", to="RedJar"))
    merge(lab, "RedJar", "Jar1")
    lab.update(RenameObject(name="Jar1", to="TheJar"))
    lab.report("Jar003 isOn Floor1 AND RedJar.Weight = 0.5", as_of=101.0, now=102.0)
    assert (lab.place("TheJar"), lab.map.objects["TheJar"].values["Weight"]) == ("Floor1", 0.5)


def test_a_new_object_may_have_the_lost_name(lab: Reporting) -> None:
    merge(lab)
    put(lab, "Jar003", "Jar", "Floor1")
    assert (lab.place("Jar003"), lab.place("Jar1")) == ("Floor1", "Table2")
    lab.report("Jar003 isOn Table1", now=110.0)
    assert (lab.place("Jar003"), lab.place("Jar1")) == ("Table1", "Table2")


def test_a_merge_can_be_undone(lab: Reporting) -> None:
    before, event_count = lab.map, len(lab.events)
    merge(lab)
    (event,) = lab.events[event_count:]
    assert rewind_map(lab.map, [event.before]) == before
    lab.update(UpdateMap(changes=event.before), 101.0)
    assert provenance(lab).discoveries["Jar003"] == Discovery(author="Camera1", at=50.0), "it is known from a sighting again"
    assert lab.map == before
    lab.report("Jar003 isOn Floor1", now=102.0)
    assert (lab.place("Jar003"), lab.place("Jar1")) == ("Floor1", "Table1")


def test_it_can_be_considered_first(lab: Reporting) -> None:
    before = lab.map
    considered = lab.consider(MergeObject(name="Jar003", into="Jar1"))
    merge(lab)
    assert not considered.broken
    assert considered.changes == lab.events[-1].changes
    assert before.changed(considered.changes) == lab.map


def test_a_person_who_names_an_object_confirms_it(lab: Reporting) -> None:
    lab.update(RenameObject(name="Jar003", to="RedJar"))
    assert provenance(lab).discoveries == {"RedJar": Discovery(author="Camera1", at=50.0, confirmed=True)}
    assert provenance(lab).provisional == []


def test_of_two_discovered_objects_the_other_one_stays_discovered(lab: Reporting) -> None:
    assert lab.reception(RED_JAR.replace("8.1", "6.1").replace("Table2", "Floor1"), as_of=60.0).added == ("Jar004",)
    merge(lab, "Jar004", "Jar003")
    assert provenance(lab).provisional == ["Jar003"]
    assert lab.place("Jar003") == "Floor1"


def test_a_known_object_confirms_the_discovered_one_that_keeps_its_name(lab: Reporting) -> None:
    merge(lab, "Jar1", "Jar003")
    assert provenance(lab).discoveries["Jar003"].confirmed
    assert lab.place("Jar003") == "Table2"


def test_a_report_may_show_that_two_objects_are_one(lab: Reporting) -> None:
    put(lab, "Jar9", "Jar", "Jar003")
    assert lab.reception(RED_JAR, sought=("Jar1",), as_of=90.0).names == {"It": "Jar1"}
    assert "Jar003" not in lab.map.objects
    assert lab.events[-1].merged == (Merging(name="Jar003", into="Jar1"),)
    assert (lab.place("Jar1"), lab.place("Jar9")) == ("Table2", "Jar1")
    lab.report("Jar003 isOn Floor1", as_of=95.0)
    assert lab.place("Jar1") == "Floor1"


PUT_DOWN = "Jar1 isOn Table2 AND Jar1.PositionX = 8.03 AND Jar1.PositionY = {y} AND Jar1.PositionZ = 0.7"


def test_what_a_camera_saw_before_the_robot_said_what_it_put_there_is_one_object(lab: Reporting) -> None:
    lab.report(PUT_DOWN.format(y=8.1), as_of=49.0, now=101.0)
    assert "Jar003" not in lab.map.objects
    assert lab.events[-1].merged == (Merging(name="Jar003", into="Jar1"),)
    assert (lab.place("Jar1"), lab.map.objects["Jar1"].values["Color"]) == ("Table2", "Red")


def test_what_stands_beside_it_or_looks_different_is_another_object(lab: Reporting) -> None:
    lab.report(PUT_DOWN.format(y=7.9), as_of=60.0)
    lab.report(PUT_DOWN.format(y=8.1).replace("Jar1", "Jar2"), as_of=61.0)
    assert "Jar003" in lab.map.objects, "Jar1 stands 20 cm away, and Jar2 is blue"


def test_what_a_person_has_named_stays(lab: Reporting) -> None:
    lab.update(RenameObject(name="Jar003", to="RedJar"))
    lab.report(PUT_DOWN.format(y=8.1), as_of=60.0)
    assert "RedJar" in lab.map.objects
