"""Repositories that are neighbours: each has a map of its own, and sees what the other shows."""

from __future__ import annotations

import pytest

from somrs.ontology.files.loading import load_text, upper
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ObjectRemoved
from somrs.ontology.types import PART_OF, AttributeType, Kind, ObjectType, Value
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import (
    Define,
    Defined,
    MapPage,
    QueryMap,
    ReadMap,
    Rejected,
    RenameObject,
    Rows,
    Updated,
    UpdateMap,
    by_kind,
)
from somrs.protocol.messages.neighbours import Neighbour, Neighbours, ReadNeighbours
from somrs.protocol.messages.observations import Observation
from somrs.protocol.messages.reservations import (
    RESERVED,
    ClaimReservations,
    Release,
    ReservationDenied,
    ReservationLost,
    ReservationMode,
    Reserve,
    Reserved,
    UnderReservation,
)
from somrs.protocol.soap import soap
from somrs.protocol.soap.document import MOST_BYTES
from somrs.repository.component import SCHEMA, Repository
from somrs.repository.neighbouring import NeighboursConfigured
from somrs.repository.provenance import FormerName
from somrs.repository.state import Contents, RepetitionDue
from somrs.runtime.virtual_time import World
from tests.support.answer_client import AnswerClient
from tests.support.building import building
from tests.support.lab import request

BARN, YARD, MILL = "http://barn/repository", "http://yard/repository", "http://mill/repository"

SITE = """
  {Table1}: {{type: Table, at: [1, 1, 0], Shape: {{Form: Box, Width: 1, Depth: 1, Height: 0.7}}}}
  {Table2}: {{type: Table, at: [8, 8, 0], Shape: {{Form: Box, Width: 1, Depth: 1, Height: 0.7}}}}
  Jar1: {{type: Jar, at: [1, 1, 0.7]}}
  Robot1: {{type: PioneerP3DX, at: [3, 3, 0]}}
facts:
  - Jar1 isOn {Table1}
"""


def repository(name: str, address: str, **tables: str) -> Repository:
    loaded = load_text(building(name, 10, 10, "Room1: {type: Room}") + SITE.format(**tables), base=upper())
    assert loaded.map is not None
    return Repository(address, Contents(ontology=loaded.ontology, map=loaded.map))


class Neighbourhood:
    """A barn and a yard."""

    def __init__(self, *, shows: tuple[str, ...] | None = None, may_change: bool = True) -> None:
        self.world = World()
        self.ask = AnswerClient(self.world).ask
        self.world.add(BARN, repository("Barn", BARN, Table1="Bench1", Table2="Bench2"), journaled=SCHEMA)
        self.world.add(YARD, repository("Yard", YARD, Table1="Ramp1", Table2="Ramp2"), journaled=SCHEMA)
        self.configure(YARD, "Yard", Neighbour(map="Barn", address=BARN, shows_all=True))
        self.configure(BARN, "Barn", Neighbour(map="Yard", address=YARD, shows=shows or (), shows_all=shows is None, may_change=may_change))
        self.settle()

    def configure(self, address: str, map: str, *neighbours: Neighbour) -> None:
        self.world.notify(address, NeighboursConfigured(map=map, neighbours=neighbours))

    def update(self, address: str, *changes: Change, situation: str | None = None) -> Updated:
        return self.ask(address, UpdateMap(changes=changes, situation=situation, author="test"), Updated)

    def tell(self, address: str, situation: str, as_of: float) -> tuple[str, ...]:
        """Returns what is superseded of it."""
        updated = self.ask(address, UpdateMap(situation=situation, observation=Observation(as_of=as_of), author="test"), Updated)
        return updated.reception.superseded if updated.reception is not None else ()

    def holds(self, address: str, formula: str) -> bool:
        return bool(self.ask(address, QueryMap(formula=formula), Rows).rows)

    def names(self, address: str) -> set[str]:
        return {*self.at(address).contents.map.objects}

    def at(self, address: str) -> Repository:
        repository = self.world.components[address]
        assert isinstance(repository, Repository)
        return repository

    def settle(self) -> None:
        self.world.run(90.0)

    def add_mill(self) -> None:
        """A third map, which all others show everything."""
        self.world.add(MILL, repository("Mill", MILL, Table1="Shelf1", Table2="Shelf2"), journaled=SCHEMA)
        addresses = {"Barn": BARN, "Yard": YARD, "Mill": MILL}
        for map, address in addresses.items():
            neighbours = (Neighbour(map=name, address=addresses[name], shows_all=True) for name in addresses if name != map)
            self.configure(address, map, *neighbours)
        self.settle()

    def reserved_for(self) -> set[str]:
        """The tasks that have, or wait for, objects of any map."""
        repositories = [self.at(address).contents for address in (BARN, YARD, MILL) if address in self.world.components]
        return {task for contents in repositories for task in (*contents.reservations.claimants, *contents.shared_reservations)}


def test_a_neighbour_s_objects_are_on_the_map_under_qualified_names() -> None:
    two = Neighbourhood()
    assert {"Barn:Jar1", "Barn:Bench1", "Barn:Robot1", "Jar1", "Ramp1"} <= two.names(YARD)
    assert {"Yard:Jar1", "Yard:Ramp1", "Jar1", "Bench1"} <= two.names(BARN)
    assert not any(name.count(":") > 1 or name.startswith("Yard:") for name in two.names(YARD))
    assert two.holds(YARD, "Barn:Jar1 isOn Barn:Bench1 AND Jar1 isOn Ramp1")


def test_a_name_that_only_one_map_has_needs_no_qualification() -> None:
    two = Neighbourhood()
    assert two.holds(YARD, "Barn:Jar1 isOn Bench1")
    assert two.holds(YARD, "Yard:Jar1 isOn Yard:Ramp1")


def test_what_a_neighbour_changes_is_seen_at_once() -> None:
    two = Neighbourhood()
    two.update(BARN, situation="Jar1 isOn Bench2")
    two.update(BARN, ObjectAdded(Object(name="Jar7", type="Jar", values=POSITION)), FactAdded(Fact("isOn", ("Jar7", "Bench1"))))
    two.update(BARN, ObjectRemoved("Robot1"))
    two.ask(BARN, RenameObject(name="Bench1", to="Bench9"), Updated)
    two.settle()
    assert two.holds(YARD, "Barn:Jar1 isOn Barn:Bench2 AND Barn:Jar7 isOn Barn:Bench9")
    assert {"Barn:Robot1", "Barn:Bench1"}.isdisjoint(two.names(YARD))


def test_a_change_of_a_neighbour_s_object_is_made_at_its_home_and_then_answered() -> None:
    two = Neighbourhood()
    two.update(YARD, situation="Bench2.Color = Blue AND Ramp2.Color = Red")
    assert two.at(BARN).contents.map.objects["Bench2"].values["Color"] == "Blue"
    assert two.at(YARD).contents.map.objects["Barn:Bench2"].values["Color"] == "Blue"
    assert two.at(YARD).contents.map.objects["Ramp2"].values["Color"] == "Red"
    two.settle()
    assert two.at(BARN).contents.map.objects["Yard:Ramp2"].values["Color"] == "Red"


def test_what_the_home_refuses_is_refused_with_its_reason() -> None:
    two = Neighbourhood(may_change=False)
    rejected = two.ask(YARD, UpdateMap(situation="Bench2.Color = Blue AND Ramp2.Color = Red"), Rejected)
    assert "Barn refuses: Bench2: is not for Yard to change" in rejected.problems[0]
    assert "Color" not in two.at(YARD).contents.map.objects["Ramp2"].values


def test_other_changes_of_a_neighbour_s_objects_are_to_be_made_there() -> None:
    two = Neighbourhood()
    rejected = two.ask(YARD, RenameObject(name="Barn:Jar1", to="Pot"), Rejected)
    assert "belongs to the map Barn; change it there" in rejected.problems[0]
    rejected = two.ask(YARD, UpdateMap(changes=(ObjectAdded(Object(name="Mill:Jar1", type="Jar", values=POSITION)),)), Rejected)
    assert "there is no neighbour Mill" in rejected.problems[0]


def test_a_neighbour_sees_only_what_is_in_the_places_that_are_shown() -> None:
    two = Neighbourhood(shows=("Bench1",))
    assert {name for name in two.names(YARD) if name.startswith("Barn:")} == {"Barn:Bench1", "Barn:Jar1"}
    two.update(BARN, situation="Jar1 isOn Bench2")
    two.settle()
    assert "Barn:Jar1" not in two.names(YARD)
    two.update(BARN, situation="Jar1 isOn Bench1")
    two.settle()
    assert two.holds(YARD, "Barn:Jar1 isOn Barn:Bench1")


def test_what_a_neighbour_shows_from_now_on_is_seen_and_what_it_hides_is_gone() -> None:
    two = Neighbourhood()
    for places, seen in ((("Bench1",), {"Barn:Bench1", "Barn:Jar1"}), (("Bench2",), {"Barn:Bench2"}), (None, two.names(BARN))):
        yard = Neighbour(map="Yard", address=YARD, shows=places or (), shows_all=places is None)
        two.configure(BARN, "Barn", yard)
        two.settle()
        names = {name for name in two.names(YARD) if name.startswith("Barn:")}
        assert names == ({f"Barn:{name}" for name in seen if ":" not in name} if places is None else seen)


def test_an_edit_that_names_what_a_neighbour_does_not_have_is_refused() -> None:
    two = Neighbourhood()
    rejected = two.ask(YARD, UpdateMap(situation="Jar1 isOn Barn:Bench7"), Rejected)
    assert "there is no object Bench7 on the map Barn" in rejected.problems[0]
    assert "Barn:Bench1" in rejected.problems[0], "the similar name"
    assert two.holds(YARD, "Jar1 isOn Ramp1")
    assert two.tell(YARD, "Jar1 isOn Barn:Bench7", as_of=two.world.now) == (), "news of it may still be on its way"


def test_an_edit_that_names_what_a_neighbour_may_hide_says_what_is_seen_of_it() -> None:
    two = Neighbourhood(shows=("Bench1",))
    two.update(YARD, situation="Jar1 isOn Barn:Bench2")
    assert not two.holds(YARD, "Jar1 isOn ?Anything")


def test_what_does_not_fit_the_ontology_here_is_not_said_to_be_missing_there() -> None:
    two = Neighbourhood()
    number, word = (AttributeType(name="Stickiness", kind=kind) for kind in (Kind.NUMBER, Kind.TEXT))
    for address, attribute in ((BARN, word), (YARD, number)):
        crate = ObjectType(name="Crate", parent="Jar", attributes=("Stickiness",))
        two.ask(address, Define(definitions=by_kind([attribute, crate])), Defined)
    crate7 = Object(name="Crate7", type="Crate", values={**POSITION, "Stickiness": "high"})
    two.update(BARN, ObjectAdded(crate7), FactAdded(Fact("isOn", ("Crate7", "Bench1"))))
    two.settle()
    assert "Barn:Crate7" not in two.names(YARD)
    two.update(YARD, situation="Barn:Crate7 isOn Ramp1")


def test_what_is_put_at_a_neighbour_s_place_gets_its_home_there() -> None:
    two = Neighbourhood()
    two.update(BARN, situation="Jar1 isOn Yard:Ramp2")
    two.settle()
    (moved,) = {name for name in two.names(YARD) if two.at(YARD).contents.map.has_fact("isOn", (name, "Ramp2"))}
    assert moved not in ("Jar1", "Barn:Jar1")
    assert two.holds(BARN, f"Yard:{moved} isOn Yard:Ramp2")
    assert "Jar1" not in two.names(BARN)
    assert "Barn:Jar1" not in two.names(YARD)
    two.update(BARN, situation=f"Yard:{moved} isOn Bench1")
    two.settle()
    assert two.holds(BARN, f"{moved} isOn Bench1")
    assert two.holds(YARD, f"Barn:{moved} isOn Barn:Bench1")


def test_a_neighbour_that_is_removed_leaves_nothing_behind() -> None:
    two = Neighbourhood()
    two.configure(YARD, "Yard")
    assert not any(":" in name for name in two.names(YARD))
    assert two.ask(YARD, ReadNeighbours(), Neighbours).neighbours == ()


POSITION: dict[str, Value] = {"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.0}


@pytest.mark.parametrize("shows", [(), ("Bench1",)])
def test_a_neighbour_that_is_shown_something_else_now_sees_that(shows: tuple[str, ...]) -> None:
    two = Neighbourhood()
    two.configure(BARN, "Barn", Neighbour(map="Yard", address=YARD, shows=shows, shows_all=False))
    two.settle()
    seen = {name for name in two.names(YARD) if name.startswith("Barn:")}
    assert seen == ({"Barn:Bench1", "Barn:Jar1"} if shows else set())
    two.configure(BARN, "Barn", Neighbour(map="Yard", address=YARD, shows_all=True))
    two.settle()
    assert {"Barn:Bench1", "Barn:Bench2"} <= two.names(YARD)


def test_a_neighbour_to_which_nothing_is_shown_sees_nothing() -> None:
    two = Neighbourhood(shows=())
    assert not any(name.startswith("Barn:") for name in two.names(YARD))
    assert "Yard:Jar1" in two.names(BARN)


def test_what_is_wrong_with_a_neighbour_is_said() -> None:
    two = Neighbourhood()
    two.configure(YARD, "Yard", Neighbour(map="Farm", address=BARN, shows=("Attic",)))
    two.settle()
    (neighbour,) = two.ask(YARD, ReadNeighbours(), Neighbours).neighbours
    assert neighbour.problems[0] == f"the map at {BARN} has the name Barn, and not Farm"
    assert "there is no place Attic on the map Yard that could be shown" in neighbour.problems


def test_what_waits_for_a_neighbour_that_is_away_is_said() -> None:
    two = Neighbourhood()
    two.update(BARN, ObjectAdded(Object(name="Jar7", type="Jar", values=POSITION)), FactAdded(Fact("isOn", ("Jar7", "Bench1"))))
    two.world.cut_off(YARD)
    two.update(BARN, situation="Jar1 isOn Yard:Ramp2")
    two.world.send(request(UpdateMap(situation="Jar1.Color = Red", author="camera"), recipient=BARN))
    two.world.send(request(UpdateMap(situation="Yard:Ramp2.Color = Red", author="camera"), recipient=BARN))
    two.world.send(request(reserve("barn-task", 1, "Yard:Jar1"), recipient=BARN))
    two.world.run(20.0)
    (neighbour,) = two.ask(BARN, ReadNeighbours(), Neighbours).neighbours
    assert neighbour.problems == (
        "Jar1 gets its home there as soon as Yard answers; 1 update of it waits for that",
        "an update of Yard:Ramp2 by camera waits until Yard answers",
        "the task 'tidy' waits until Yard answers whether it may have its objects",
    )
    two.world.reconnect(YARD)
    two.settle()
    (neighbour,) = two.ask(BARN, ReadNeighbours(), Neighbours).neighbours
    assert not neighbour.problems
    assert two.holds(BARN, "?Jar: Jar isOn Yard:Ramp2 AND ?Jar.Color = Red")


def reserve(task: str, serial: int, *objects: str, mode: ReservationMode = ReservationMode.TRY) -> Reserve:
    return Reserve(task=task, serial=serial, mode=mode, goal="tidy", changes=objects)


def test_objects_are_reserved_at_their_homes() -> None:
    two = Neighbourhood()
    two.ask(YARD, reserve("yard-task", 1, "Barn:Jar1", "Jar1"), Reserved)
    denied = two.ask(BARN, reserve("barn-task", 1, "Jar1"), ReservationDenied)
    assert [(holder.task, holder.objects) for holder in denied.holders] == [("yard-task", ("Jar1",))]
    two.world.send(request(Release(task="yard-task", serial=2, ended=True), recipient=YARD))
    two.settle()
    two.ask(BARN, reserve("barn-task", 2, "Jar1"), Reserved)


def test_a_late_report_of_a_neighbour_s_object_that_another_task_has_now_is_refused() -> None:
    two = Neighbourhood()
    fence = two.ask(YARD, reserve("yard-task", 1, "Barn:Jar1", "Jar1"), Reserved).fence
    two.world.send(request(Release(task="yard-task", serial=2), recipient=YARD))
    two.settle()
    two.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved)
    report = UpdateMap(situation="Barn:Jar1 isOn Bench2", author="test", reservation=UnderReservation(task="yard-task", fence=fence))
    rejected = two.ask(YARD, report, Rejected)
    assert [(rule.subject, rule.rule) for rule in rejected.broken] == [("Barn:Jar1", RESERVED)]
    assert two.holds(BARN, "Jar1 isOn Bench1")


@pytest.mark.parametrize("is_known", [False, True], ids=["before the grant", "while another map is asked"])
def test_a_task_that_loses_at_one_map_what_it_requests_gets_nothing(is_known: bool) -> None:
    three = Neighbourhood()
    three.add_mill()
    unreachable_address = MILL if is_known else BARN
    three.world.cut_off(unreachable_address)
    identity = "urn:uuid:asking"
    three.world.send(request(reserve("yard-task", 1, "Barn:Jar1", "Mill:Jar1", "Jar1"), recipient=YARD, identity=identity))
    three.world.run(1.0)
    three.world.send(request(ReservationLost(task="yard-task", fence=1), BARN, recipient=YARD))
    three.world.run(1.0)
    three.world.reconnect(unreachable_address)
    three.settle()
    answers = [message.body for message in three.world.messages if message.header.relates_to == identity]
    assert [type(answer) for answer in answers] == [ReservationDenied]
    holding_tasks = [
        task for address in (YARD, MILL) for task, claimant in three.at(address).contents.reservations.claimants.items() if claimant.held
    ]
    assert not holding_tasks, "what it had at other maps is free"


def test_a_question_that_a_home_answers_in_the_negative_is_over() -> None:
    two = Neighbourhood()
    two.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved)
    denied = two.ask(YARD, reserve("yard-task", 1, "Barn:Jar1", mode=ReservationMode.ASK), ReservationDenied)
    assert [(holder.task, holder.objects) for holder in denied.holders] == [("barn-task", ("Barn:Jar1",))]
    two.settle()
    assert RepetitionDue() not in two.world.timers(YARD)
    assert two.ask(YARD, reserve("yard-task", 2, "Jar1"), Reserved).fence


def test_answers_that_come_twice_are_not_answered() -> None:
    two = Neighbourhood()
    two.update(YARD, situation="Bench2.Color = Blue")
    answer = next(message for message in two.world.messages if message.header.recipient == YARD and isinstance(message.body, Updated))
    two.world.send(answer)
    two.settle()
    assert not any(isinstance(message.body, Fault) for message in two.world.messages)


def test_an_update_that_is_repeated_while_it_waits_for_a_handover_waits_once() -> None:
    two = Neighbourhood()
    two.world.cut_off(YARD)
    two.update(BARN, situation="Jar1 isOn Yard:Ramp2")
    for _ in range(3):
        two.world.send(request(UpdateMap(situation="Jar1.Color = Red", author="test"), recipient=BARN, identity="urn:uuid:red"))
        two.world.run(5.0)
    (handover,) = two.at(BARN).contents.handovers.values()
    assert len(handover.deferred) == 1
    two.world.reconnect(YARD)
    two.settle()
    assert two.holds(BARN, "?Jar: Jar isOn Yard:Ramp2 AND ?Jar.Color = Red")


def holders_of(repository: Repository, name: str) -> set[str]:
    """The tasks that have reserved this object here."""
    return {task for task, claimant in repository.contents.reservations.claimants.items() if name in claimant.held.changes}


@pytest.mark.parametrize("is_racing", [False, True], ids=["after it was denied", "while it asks"])
def test_what_a_task_has_not_got_is_not_its_own_when_it_comes_to_its_map(is_racing: bool) -> None:
    two = Neighbourhood()
    fence = two.ask(YARD, reserve("yard-task", 1, "Jar1"), Reserved).fence
    report = UpdateMap(situation="Jar1 isOn Barn:Bench2", author="test", reservation=UnderReservation(task="yard-task", fence=fence))
    if is_racing:
        two.world.send(request(report, recipient=YARD))
    two.ask(BARN, reserve("barn-task", 1, "Yard:Jar1", "Jar1"), ReservationDenied)
    if not is_racing:
        two.world.send(request(report, recipient=YARD))
    two.settle()
    (name,) = [fact.arguments[0] for fact in two.at(BARN).contents.map.facts_about("Bench2") if fact.relation == "isOn"]
    assert holders_of(two.at(BARN), name) == {"yard-task"}
    assert holders_of(two.at(BARN), "Jar1") == set(), "what was denied is not kept in part"
    denied = two.ask(BARN, reserve("barn-task", 2, name), ReservationDenied)
    assert [holder.task for holder in denied.holders] == ["yard-task"]


@pytest.mark.parametrize("address", [YARD, MILL, BARN], ids=["new home", "third map", "earlier home"])
def test_what_others_have_changed_before_it_got_its_home_is_not_undone(address: str) -> None:
    three = Neighbourhood()
    three.add_mill()
    three.ask(address, reserve("old-task", 1, "Jar1" if address == BARN else "Barn:Jar1"), Reserved)
    three.world.send(request(Release(task="old-task", serial=2), recipient=address))
    three.settle()
    fence = three.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved).fence
    report = UpdateMap(situation="Jar1 isOn Yard:Ramp2", author="test", reservation=UnderReservation(task="barn-task", fence=fence))
    three.ask(BARN, report, Updated)
    three.world.send(request(Release(task="barn-task", serial=2, ended=True), recipient=BARN))
    three.settle()
    (name,) = (fact.arguments[0] for fact in three.at(YARD).contents.map.facts_about("Ramp2") if fact.relation == "isOn")
    seen_name = name if address == YARD else f"Yard:{name}"
    undoing = three.ask(address, reserve("old-task", 3, seen_name, mode=ReservationMode.UNDO), Reserved)
    assert undoing.overtaken == (seen_name,)
    three.world.send(request(Release(task="old-task", serial=4, ended=True), recipient=address))
    three.settle()
    assert three.reserved_for() == set(), "nobody remembers a task that has ended"


def test_what_a_task_had_it_keeps_when_it_is_denied_more() -> None:
    two = Neighbourhood()
    fence = two.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved).fence
    two.ask(YARD, reserve("yard-task", 1, "Jar1"), Reserved)
    two.ask(BARN, RenameObject(name="Jar1", to="Jar9"), Updated)
    two.ask(BARN, reserve("barn-task", 2, "Jar9", "Bench1", "Yard:Jar1"), ReservationDenied)
    assert two.at(BARN).contents.reservations.is_held("barn-task", fence)
    assert holders_of(two.at(BARN), "Jar9") == {"barn-task"}
    assert holders_of(two.at(BARN), "Bench1") == set()


def test_who_asks_for_what_comes_to_its_map_meanwhile_gets_it_after_who_had_it() -> None:
    two = Neighbourhood()
    fence = two.ask(YARD, reserve("yard-task", 1, "Jar1"), Reserved).fence
    report = UpdateMap(situation="Jar1 isOn Barn:Bench2", author="test", reservation=UnderReservation(task="yard-task", fence=fence))
    two.world.send(request(report, recipient=YARD))
    two.world.send(request(Release(task="yard-task", serial=2, ended=True), recipient=YARD))
    assert two.ask(BARN, reserve("barn-task", 1, "Yard:Jar1", mode=ReservationMode.WAIT), ReservationDenied).waits
    two.settle()
    (name,) = [fact.arguments[0] for fact in two.at(BARN).contents.map.facts_about("Bench2") if fact.relation == "isOn"]
    two.ask(BARN, reserve("barn-task", 2, name, mode=ReservationMode.WAIT), Reserved)
    assert holders_of(two.at(BARN), name) == {"barn-task"}


def test_a_question_of_a_preview_leaves_nothing_behind() -> None:
    two = Neighbourhood()
    two.ask(YARD, reserve("preview", 1, "Barn:Jar1", mode=ReservationMode.ASK), Reserved)
    assert not two.at(YARD).contents.shared_reservations
    assert not two.at(BARN).contents.reservations.claimants


def test_a_task_that_waits_for_other_objects_now_hinders_nobody_where_it_waited() -> None:
    two = Neighbourhood()
    two.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved)
    assert two.ask(YARD, reserve("yard-task", 1, "Barn:Jar1", mode=ReservationMode.WAIT), ReservationDenied).waits
    two.ask(YARD, reserve("yard-task", 2, "Jar1"), Reserved)
    two.settle()
    assert two.at(BARN).contents.reservations.claimants["yard-task"].waiting is None
    two.world.send(request(Release(task="yard-task", serial=3, ended=True), recipient=YARD))
    two.settle()
    assert [*two.at(BARN).contents.reservations.claimants] == ["barn-task"]


def test_a_task_that_ends_while_it_waits_at_a_neighbour_waits_no_longer() -> None:
    two = Neighbourhood()
    two.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved)
    assert two.ask(YARD, reserve("yard-task", 1, "Barn:Jar1", mode=ReservationMode.WAIT), ReservationDenied).waits
    two.world.send(request(Release(task="yard-task", serial=2, ended=True), recipient=YARD))
    two.settle()
    assert [*two.at(BARN).contents.reservations.claimants] == ["barn-task"]


def test_a_task_that_needs_less_while_it_still_waits_for_an_answer_of_a_neighbour_has_that_alone() -> None:
    """It is cancelled, for example, and has to undo only what it did here. The neighbour is asked no more, and keeps nothing for it."""
    two = Neighbourhood()
    two.world.cut_off(BARN)
    earlier = "urn:uuid:earlier"
    two.world.send(request(reserve("yard-task", 1, "Barn:Jar1", "Jar1"), recipient=YARD, identity=earlier))
    two.world.run(5.0)
    assert two.ask(YARD, reserve("yard-task", 2, "Jar1", mode=ReservationMode.UNDO), Reserved).fence
    two.world.run(30.0)
    two.world.reconnect(BARN)
    two.settle()
    assert [type(message.body) for message in two.world.messages if message.header.relates_to == earlier] == [ReservationDenied]
    assert two.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved).fence
    two.world.send(request(Release(task="yard-task", serial=3, ended=True), recipient=YARD))
    two.world.send(request(Release(task="barn-task", serial=2, ended=True), recipient=BARN))
    two.settle()
    assert two.reserved_for() == set()


def test_what_is_released_while_it_gets_another_home_is_free_there() -> None:
    two = Neighbourhood()
    two.ask(BARN, reserve("barn-task", 1, "Jar1"), Reserved)
    two.world.cut_off(YARD)
    two.update(BARN, situation="Jar1 isOn Yard:Ramp2")
    two.world.send(request(Release(task="barn-task", serial=2, ended=True), recipient=BARN))
    two.world.run(5.0)
    two.world.reconnect(YARD)
    two.settle()
    assert two.reserved_for() == set()


@pytest.mark.parametrize("is_away", [False, True], ids=["after the handover", "while it lasts"])
def test_a_task_of_a_third_map_releases_what_it_has_wherever_that_is_at_home(is_away: bool) -> None:
    three = Neighbourhood()
    three.add_mill()
    three.ask(MILL, reserve("mill-task", 1, "Barn:Jar1", "Yard:Jar1"), Reserved)
    if is_away:
        three.world.cut_off(YARD)
    three.update(BARN, situation="Jar1 isOn Yard:Ramp2")
    three.world.run(30.0)
    three.world.send(request(Release(task="mill-task", serial=2, ended=True), recipient=MILL))
    three.world.run(5.0)
    three.world.reconnect(YARD)
    three.settle()
    assert three.reserved_for() == set()
    releasing = {message.header.sender for message in three.world.messages if isinstance(message.body, Release)}
    assert BARN not in releasing, "only the Repository that reserves for the task releases what it has"


def test_a_third_map_has_what_is_said_of_objects_of_two_others() -> None:
    three = Neighbourhood()
    three.update(BARN, FactAdded(Fact(PART_OF, ("Jar1", "Yard:Room1"))))
    three.add_mill()
    assert three.at(MILL).contents.map.has_fact(PART_OF, ("Barn:Jar1", "Yard:Room1"))


def test_what_moves_between_two_others_stays_one_thing_while_its_new_home_is_away() -> None:
    three = Neighbourhood()
    three.add_mill()
    three.world.separate(YARD, MILL)
    three.update(BARN, situation="Jar1 isOn Yard:Ramp2 AND Jar1.Color = Red")
    three.world.run(5.0)
    (name,) = (fact.arguments[0] for fact in three.at(YARD).contents.map.facts_about("Ramp2") if fact.relation == "isOn")
    assert "Barn:Jar1" not in three.names(MILL)
    assert three.at(MILL).contents.provenance.current_name("Barn:Jar1") == f"Yard:{name}"
    assert three.holds(MILL, f"Yard:{name}.Color = Red")
    three.world.run(60.0)
    assert f"Yard:{name}" in three.names(MILL)
    three.world.join(YARD, MILL)
    three.settle()
    assert three.holds(MILL, f"Yard:{name} isOn Yard:Ramp2 AND Yard:{name}.Color = Red")
    three.update(YARD, ObjectRemoved(name))
    three.settle()
    assert f"Yard:{name}" not in three.names(MILL)


def test_who_reads_a_map_anew_learns_what_has_another_name_since() -> None:
    three = Neighbourhood()
    three.add_mill()
    three.world.cut_off(MILL)
    three.update(BARN, situation="Jar1 isOn Yard:Ramp2")
    three.ask(YARD, RenameObject(name="Ramp1", to="Ramp9"), Updated)
    three.world.run(200.0)  # longer than subscriptions last
    three.world.reconnect(MILL)
    three.settle()
    (name,) = (fact.arguments[0] for fact in three.at(YARD).contents.map.facts_about("Ramp2") if fact.relation == "isOn")
    assert three.at(MILL).contents.provenance.current_name("Barn:Jar1") == f"Yard:{name}"
    assert three.at(MILL).contents.provenance.current_name("Yard:Ramp1") == "Yard:Ramp9"
    assert not {"Barn:Jar1", "Yard:Ramp1"} & three.names(MILL)


def test_a_map_with_many_long_former_names_can_be_read() -> None:
    two = Neighbourhood()
    former_names = two.at(BARN).contents.provenance.former_names
    for number in range(1000):
        former_names[f"{'Jar' * 80}{number}"] = FormerName(name="Jar1")
    page = two.ask(BARN, ReadMap(), MapPage)
    assert page.former_names[f"{'Jar' * 80}999"] == "Jar1", "the latest ones are told"
    assert len(soap.encode(Message(header=request(ReadMap(), recipient=BARN).header, body=page))) < MOST_BYTES


def test_what_moves_to_a_home_that_does_not_show_it_is_gone() -> None:
    three = Neighbourhood()
    three.add_mill()
    three.configure(YARD, "Yard", Neighbour(map="Barn", address=BARN, shows_all=True), Neighbour(map="Mill", address=MILL))
    three.settle()
    three.update(BARN, situation="Jar1 isOn Yard:Ramp2")
    three.settle()
    assert not {name for name in three.names(MILL) if name.startswith("Yard:")}
    assert "Barn:Jar1" not in three.names(MILL)


def test_a_release_by_another_repository_is_not_heeded() -> None:
    three = Neighbourhood()
    three.add_mill()
    three.ask(YARD, reserve("yard-task", 1, "Barn:Jar1"), Reserved)
    three.world.send(request(Release(task="yard-task", serial=99), MILL, recipient=YARD))
    three.settle()
    assert three.at(BARN).contents.reservations.claimants["yard-task"].held
    three.ask(YARD, reserve("yard-task", 2, "Barn:Jar1", "Jar1"), Reserved)


@pytest.mark.parametrize(
    "earlier",
    [Release(task="yard-task", serial=1, ended=False), ClaimReservations(serial=1)],
    ids=["what it released", "what it did not have"],
)
def test_what_was_said_before_a_request_and_arrives_after_it_does_not_end_it(earlier: Release | ClaimReservations) -> None:
    two = Neighbourhood()
    two.world.cut_off(BARN)
    two.world.send(request(reserve("yard-task", 2, "Barn:Jar1"), recipient=YARD))
    two.world.run(1.0)
    two.world.send(request(earlier, recipient=YARD))
    two.world.run(1.0)
    two.world.reconnect(BARN)
    two.settle()
    (claimant,) = two.at(BARN).contents.reservations.claimants.values()
    assert claimant.held.changes == {"Jar1"}
    assert two.at(YARD).contents.shared_reservations["yard-task"].fences == {"Barn": claimant.fence}


def test_the_home_of_an_object_decides_what_is_newer_of_it() -> None:
    """A camera at the Barn and a robot at the Yard tell their Repositories late what they saw; the robot saw it later."""
    two = Neighbourhood()
    seen_at = two.world.now
    two.world.run(60.0)
    two.tell(BARN, "Jar1 isHeldBy Robot1", as_of=seen_at)
    two.world.run(60.0)
    assert two.holds(YARD, "Barn:Jar1 isHeldBy Barn:Robot1")
    assert two.tell(YARD, "Barn:Jar1 isOn Barn:Bench2", as_of=seen_at + 1.0) == ()
    assert two.holds(BARN, "Jar1 isOn Bench2")
    assert two.tell(YARD, "Barn:Jar1 isHeldBy Barn:Robot1", as_of=seen_at - 1.0)
    assert two.holds(BARN, "Jar1 isOn Bench2")


def test_what_its_home_has_newer_of_an_object_is_said_to_who_reports_it_late() -> None:
    two = Neighbourhood()
    two.tell(BARN, "Jar1 isOn Bench2", as_of=two.world.now)
    two.settle()
    assert two.tell(YARD, "Barn:Jar1 isOn Barn:Bench1", as_of=two.world.now - 200.0) == (
        "NOT Barn:Jar1 isOn Barn:Bench2",
        "Barn:Jar1 isOn Barn:Bench1",
    )


def test_a_report_that_was_worked_out_on_an_old_copy_of_a_neighbour_s_map_is_true_all_the_same() -> None:
    two = Neighbourhood()
    two.world.separate(BARN, YARD)
    two.tell(BARN, "Jar1 isHeldBy Robot1", as_of=two.world.now)
    two.world.run(1.0)
    report = UpdateMap(situation="Barn:Jar1 isOn Barn:Bench2", observation=Observation(as_of=two.world.now), author="test")
    two.world.send(request(report, recipient=YARD))
    two.world.run(1.0)
    two.world.join(BARN, YARD)
    two.settle()
    assert two.holds(BARN, "Jar1 isOn Bench2")
    assert two.holds(YARD, "Barn:Jar1 isOn Barn:Bench2")


def test_who_edits_an_old_copy_of_a_neighbour_s_map_is_refused() -> None:
    two = Neighbourhood()
    two.tell(BARN, "Jar1 isHeldBy Robot1", as_of=two.world.now)
    changes = FactRemoved(Fact("isOn", ("Jar1", "Bench1"))), FactAdded(Fact("isOn", ("Jar1", "Bench2")))
    assert two.ask(BARN, UpdateMap(changes=changes, author="test"), Rejected).broken[0].rule == "exclusive"
