"""The first page: which rows it has, and which goal it proposes."""

from __future__ import annotations

import msgspec
import pytest

from somrs.api.assignments import Assignment
from somrs.api.device_state import DeviceState
from somrs.api.fleet import DeviceView, Presence
from somrs.api.simulator_gateway import SimulatedDeviceView
from somrs.api.system import PartView
from somrs.devices.simulator.link.commands import Fault
from somrs.entish.parse import parse
from somrs.gui.pages.start.example_goal import example_goal, is_achieved
from somrs.gui.pages.start.rows import (
    FAILED_TIME,
    MOST_NAMES,
    Row,
    device_rows,
    failed_rows,
    order_rows,
    outage_rows,
    part_rows,
    running_rows,
    unready_rows,
)
from somrs.ontology.files.loading import load
from somrs.ontology.map import Map
from somrs.ontology.matching import can_achieve
from somrs.ontology.objects import Fact, FactAdded, FactRemoved, ObjectRemoved
from somrs.ontology.types import Ontology
from somrs.protocol.messages.directory import NeighbourView
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.neighbours import MapNeighbourView, Neighbour
from somrs.protocol.messages.orders import Every, Run, RunState, StandingOrder
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase, TaskRow
from tests.support.paths import SCENARIO_1

NOW = 1_000_000.0


def device(name: str, state: DeviceState, **values: object) -> DeviceView:
    view = DeviceView(name=name, type="Robot", lineage=("Robot",), presence=Presence.OFFERS, state=state)
    return msgspec.structs.replace(view, **values)


def task(name: str, effect: str, outcome: Outcome | None = None, ended_at: float | None = None, **values: object) -> TaskRow:
    phase = Phase.EXECUTING if outcome is None else Phase.ENDED
    row = TaskRow(task=f"urn:uuid:{name}", effect=effect, phase=phase, submitted_at=NOW - 100, outcome=outcome, ended_at=ended_at)
    return msgspec.structs.replace(row, **values)


def texts(rows: list[Row]) -> list[tuple[str, str, str, str]]:
    return [(row.sign.text, row.text, row.note, row.target) for row in rows]


# Rows


def test_a_thing_that_only_reports_needs_nobody_and_faults_come_first() -> None:
    sensor = ("Sensor", "Thing", "StationaryDevice")
    rows = unready_rows(
        [
            device("Robot1", DeviceState.NOTHING_ON_OFFER),
            device("Temp1", DeviceState.NOTHING_ON_OFFER, lineage=sensor),
            device("Heater1", DeviceState.NOTHING_ON_OFFER, lineage=("Heater", *sensor[1:]), reason="expired", departed_at=NOW),
            device("Temp2", DeviceState.NOT_WORKING, lineage=sensor),
        ]
    )
    assert [row.text for row in rows] == ["Temp2", "Robot1", "Heater1"]


def test_parts_by_whether_they_respond_and_outages_with_their_reason() -> None:
    parts = [
        PartView(name="Repository", address="a", milliseconds=1.0),
        PartView(name="Scheduler", address="b", problem="no answer within 2 s"),
        PartView(name="API", address="c", milliseconds=0.0),
    ]
    assert texts(part_rows(parts)) == [("No response", "Scheduler", "1 part", ""), ("Responds", "Repository, API", "2 parts", "")]
    assert texts(outage_rows(parts)) == [("No response", "Scheduler", "no answer within 2 s", "")]
    assert part_rows([]) == outage_rows([]) == []


def test_neighbours_that_are_away_need_attention() -> None:
    near = NeighbourView(name="Harbour", address="d", services=2)
    away = NeighbourView(name="Airport", address="e", services=0, away_since=NOW, problem="Airport gives nothing")
    responding, silent = (text for text in texts(part_rows([], [near, away])))
    assert responding == ("Responds", "Neighbour Harbour", "2 of its services are listed", "")
    assert silent[:2] == ("No response", "Neighbour Airport")
    assert silent[2].endswith("its services are left out; it says: Airport gives nothing")
    assert texts(outage_rows([], [near, away])) == [silent]


def test_maps_of_neighbours_that_are_away_need_attention() -> None:
    def map_neighbour(name: str, heard_at: float | None, *problems: str) -> MapNeighbourView:
        return MapNeighbourView(neighbour=Neighbour(map=name, address="a"), objects=1, heard_at=heard_at, problems=problems)

    maps = [map_neighbour("Barn", NOW - 10, "Jar1: the type Pot is not defined here", "Jar2: so"), map_neighbour("Mill", NOW - 1000)]
    odd, silent, unheard = texts(part_rows([], [], [*maps, map_neighbour("Farm", None)], NOW))
    assert odd == ("Problems", "Map Barn", "1 object of Barn on the map; Jar1: the type Pot is not defined here (and 1 more)", "")
    assert silent[:2] == ("No response", "Map Mill")
    assert silent[2].endswith("1 object of Mill on the map, as it was then")
    assert unheard[2].startswith("its Repository has never answered")
    assert texts(outage_rows([], [], maps, NOW)) == [silent]


def test_running_tasks_have_phase_and_progress_and_lead_to_their_pages() -> None:
    rows = running_rows(
        [
            task("a", "A isOn B", submitted_at=1.0, steps=4, done=1, fraction=0.3, setbacks=2),
            task("b", "C isOn D", submitted_at=2.0, phase=Phase.PLANNING),
            task("c", "E isOn F", Outcome.FAILED, NOW),
        ]
    )
    assert texts(rows) == [("Planning", "C isOn D", "", "/tasks/b"), ("At work", "A isOn B", "2 setbacks", "/tasks/a")]
    assert [row.progress for row in rows] == [None, (0.3, "1 of 4 steps")]


def test_a_failed_task_needs_attention_until_its_goal_is_accomplished_or_a_day_is_over() -> None:
    failed = task("a", "A isOn B", Outcome.FAILED, NOW - 50, reasons=("no service is left",))
    other = task("b", "C isOn D", Outcome.FAILED, NOW - 10)
    old = task("c", "E isOn F", Outcome.FAILED, NOW - FAILED_TIME - 1)
    (latest, first) = texts(failed_rows([failed, other, old, task("d", "G isOn H", Outcome.CANCELLED, NOW)], NOW))
    assert (latest[1], first[:2], first[3]) == ("C isOn D", ("Failed", "A isOn B"), "/tasks/a")
    assert first[2].endswith(" · No service is left")
    earlier_success, later_success = (task("e", "A isOn B", Outcome.ACCOMPLISHED, ended_at) for ended_at in (NOW - 60, NOW - 40))
    assert len(failed_rows([failed, earlier_success], NOW)) == 1
    assert failed_rows([failed, later_success], NOW) == []


def test_devices_are_listed_by_state_and_those_at_work_with_what_they_do() -> None:
    work = Assignment(
        task="t", effect="A isOn B", step="s", service="R2.Carry", service_type="Carry", inputs={"Object": "A"}, state=State.EXECUTING
    )
    ready = [device(f"R{number:02}", DeviceState.READY) for number in range(MOST_NAMES + 3)]
    rows = device_rows([*ready, device("S1", DeviceState.BUSY, assignments=(work,)), device("S2", DeviceState.NOT_WORKING)])
    assert [row.sign.text for row in rows] == ["Ready", "Busy", "Not working"]
    assert rows[0].text.endswith(", R11 and 3 more")
    assert rows[0].note == "15 devices"
    assert (rows[1].text, rows[1].note) == ("S1", "Carry: A for A isOn B")
    assert device_rows([]) == []


def test_devices_that_are_not_ready_say_why() -> None:
    robot = SimulatedDeviceView(x=0.0, y=0.0, yaw=0.0, faults=(Fault.DRIVE, Fault.LINK))
    rows = unready_rows(
        [
            device("Ready", DeviceState.READY),
            device("Broken", DeviceState.NOT_WORKING, simulated=robot),
            device("Marked", DeviceState.NOT_WORKING),
            device("Pressed", DeviceState.NOT_WORKING, problem="cannot drive: is its stop pressed?"),
            device("Silent", DeviceState.NOTHING_ON_OFFER),
            device("Stopped", DeviceState.NOTHING_ON_OFFER, departed_at=NOW, reason="expired"),
            device("Lost", DeviceState.DEPARTED, departed_at=NOW, reason="expired"),
            device("Visitor", DeviceState.DEPARTED, departed_at=NOW, reason="retracted"),
        ]
    )
    assert [row.text for row in rows] == ["Broken", "Marked", "Pressed", "Silent", "Stopped", "Lost"], "who left in order needs nobody"
    notes = {row.text: row.note for row in rows}
    assert notes["Broken"] == "Faults: drive broken, link cut."
    assert notes["Pressed"] == "It cannot drive: is its stop pressed?"
    assert notes["Silent"] == "It offers no service: check its program."
    assert notes["Stopped"].startswith("It stopped responding at ")
    assert notes["Lost"].startswith("It stopped responding at ")


@pytest.mark.parametrize(
    ("last_run", "enabled", "expected"),
    [
        (None, True, None),
        (Run(due=NOW, state=RunState.SUBMITTED, at=NOW, task="urn:uuid:a", outcome=Outcome.FAILED), True, ("Failed", "/tasks/a")),
        (Run(due=NOW, state=RunState.SUBMITTED, at=NOW, task="urn:uuid:a", outcome=Outcome.FAILED), False, None),
        (Run(due=NOW, state=RunState.SUBMITTED, at=NOW, task="urn:uuid:a", outcome=Outcome.ACCOMPLISHED), True, None),
        (Run(due=NOW, state=RunState.REFUSED, at=NOW, note="there is no Jar9"), True, ("Refused", "/define")),
        (Run(due=NOW, state=RunState.SKIPPED, at=NOW), True, None),
    ],
)
def test_standing_orders_whose_last_run_failed(last_run: Run | None, enabled: bool, expected: tuple[str, str] | None) -> None:
    order = StandingOrder(id="1", name="Tidy", when=Every(minutes=5), task=Submit(effect="A isOn B"), enabled=enabled, last=last_run)
    rows = texts(order_rows([order]))
    assert [(sign, target) for sign, _, _, target in rows] == ([expected] if expected else [])
    if last_run is not None and last_run.note and expected:
        assert rows[0][2].endswith(": there is no Jar9")


# The task to try


@pytest.fixture(scope="module")
def site() -> tuple[Ontology, Map]:
    loaded = load([SCENARIO_1])
    assert loaded.map is not None
    return loaded.ontology, loaded.map


def test_the_example_is_a_thing_of_the_map_at_another_place_that_a_service_can_bring_about(site: tuple[Ontology, Map]) -> None:
    ontology, map = site
    goal = example_goal({"TransferObject", "RecognizeSituation", "Unheard"}, ontology, map)
    assert goal is not None
    thing, relation, place = goal.split(" ")
    assert relation == "isOn"
    assert ontology.is_subtype(map.objects[thing].type, "Graspable")
    assert place in ("Cupboard001", "Table002")
    assert can_achieve(ontology.services["TransferObject"], parse(goal), ontology, map)
    assert not is_achieved(goal, map)
    (current_place,) = (fact.arguments[1] for fact in map.facts("isOn") if fact.arguments[0] == thing)
    achieved_map = map.changed([FactRemoved(Fact("isOn", (thing, current_place))), FactAdded(Fact("isOn", (thing, place)))])
    assert is_achieved(goal, achieved_map)
    assert example_goal({"TransferObject"}, ontology, achieved_map) not in (goal, None), "then another one"
    assert is_achieved(goal, map.changed([FactRemoved(Fact("isOn", (thing, current_place))), ObjectRemoved(thing)]))


def test_with_one_place_the_example_is_another_of_its_type_and_without_services_or_things_there_is_none(site: tuple[Ontology, Map]) -> None:
    ontology, map = site
    jars = [FactRemoved(Fact("isOn", (name, "Cupboard001"))) for name in ("Jar002", "Jar003")]
    assert example_goal({"TransferObject"}, ontology, map.changed(jars)) == "Carton001 isOn Table001"
    assert example_goal({"RecognizeSituation"}, ontology, map) is None
    assert example_goal((), ontology, map) is None
    assert example_goal({"TransferObject"}, ontology, Map()) is None
