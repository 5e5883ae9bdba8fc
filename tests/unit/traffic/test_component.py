"""Traffic as robots meet it: they enter, ask for trips, and are granted places."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count, pairwise
from random import Random

import pytest

from somrs.kernel.component import Answered, Ask, Effect, Notified, Received, Send, Started, TimerFired
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.traffic import (
    Berth,
    CancelTrip,
    EnterTraffic,
    Granted,
    LeaveTraffic,
    Mobility,
    ReadTraffic,
    ReportPlace,
    RequestTrip,
    TrafficEntered,
    TrafficLeft,
    TrafficView,
    TripBegun,
    TripEnded,
    TripResult,
)
from somrs.runtime.virtual_journal import VirtualJournal
from somrs.traffic.component import SCHEMA, Traffic
from somrs.traffic.notices import ClosedLane, ClosedPassage, CloseWays, HoldTraffic, RoadmapMade
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Lane, Place, Roadmap
from somrs.traffic.state import LeasesDue, PlanTraffic, TrafficPlan

LEASE = 30.0
LINE = ("West", "A", "B", "C", "East")


def roadmap(*ways: tuple[str, ...]) -> Roadmap:
    """A roadmap of two-way lanes along these ways, each lane of two seconds."""
    names = dict.fromkeys(name for way in ways for name in way)
    pairs = [pair for way in ways for pair in pairwise(way)]
    lanes = (Lane(start=start, end=end, seconds=2.0) for a, b in pairs for start, end in ((a, b), (b, a)))
    return Roadmap(places=tuple(Place(name=name, x=float(number), y=0.0) for number, name in enumerate(names)), lanes=tuple(lanes))


class Harness:
    """Traffic, with its planner at hand, and robots that send messages by name."""

    def __init__(self, map: Roadmap) -> None:
        self.map, self.now = map, 100.0
        self._journal = VirtualJournal(Traffic("traffic", map), SCHEMA)
        self._planner, self._ids, self._numbers = TrafficPlanner(map, Random()), count(), count(1)
        self.fences: dict[str, int] = {}
        self.sent: list[tuple[str, Body]] = []
        self.postponed: list[Ask] | None = None
        """The plans that were asked for, while none are made."""
        self._handle(Started("traffic"))

    def _handle(self, event: Started | Received | TimerFired | Answered | Notified) -> None:
        self._perform(effect for effect, _ in self._journal.handle(event, self.now))

    def _perform(self, effects: Iterable[Effect]) -> None:
        for effect in [*effects]:
            if isinstance(effect, Send):
                self.sent.append((effect.message.header.recipient, effect.message.body))
            elif isinstance(effect, Ask):
                if self.postponed is not None:
                    self.postponed.append(effect)
                else:
                    self._make_plan(effect)

    def _make_plan(self, effect: Ask) -> None:
        assert isinstance(effect.task, PlanTraffic)
        self.answer(effect, self._planner.plan(effect.task))

    def answer(self, effect: Ask, plan: TrafficPlan) -> None:
        self._handle(Answered(effect.question, plan))

    def make_postponed_plans(self) -> None:
        postponed, self.postponed = self.postponed or [], None
        for effect in postponed:
            self._make_plan(effect)

    def send(self, sender: str, body: Body, id: str | None = None) -> list[Body]:
        """The bodies that are sent because of this message."""
        before = len(self.sent)
        header = Header(sender=sender, recipient="traffic", message_id=id or f"m{next(self._ids)}", reply_to=sender)
        self._handle(Received(Message(header=header, body=body)))
        return [sent for _, sent in self.sent[before:]]

    def enter(self, robot: str, place: str, mobility: Mobility = Mobility.FREE, towards: str | None = None) -> Body:
        answer = self.send(robot, EnterTraffic(robot=robot, place=place, towards=towards, lease=LEASE, mobility=mobility))[0]
        if isinstance(answer, TrafficEntered):
            self.fences[robot] = answer.fence
        return answer

    def trip(self, robot: str, destination: str, berth: Berth | None = None) -> list[Body]:
        body = RequestTrip(
            robot=robot,
            fence=self.fences[robot],
            number=next(self._numbers),
            trip=f"{robot} to {destination}",
            destination=destination,
            berth=berth,
        )
        return self.send(robot, body)

    def report(
        self, robot: str, place: str, progress: int, mobility: Mobility = Mobility.FREE, grant: int | None = None, between: bool = False
    ) -> list[Body]:
        last_grant = max((b.number for _, b in self.sent if isinstance(b, Granted) and b.robot == robot), default=0)
        body = ReportPlace(
            robot=robot,
            fence=self.fences[robot],
            number=next(self._numbers),
            grant=grant if grant is not None else last_grant,
            progress=progress,
            place=place,
            between=between,
            mobility=mobility,
        )
        return self.send(robot, body)

    def replace_roadmap(self, map: Roadmap, closing: CloseWays = CloseWays()) -> None:
        self.notify(RoadmapMade(roadmap=map, closing=closing))

    def notify(self, notice: object) -> list[Body]:
        """The bodies that are sent because of this notice."""
        before = len(self.sent)
        self._handle(Notified(notice))
        return [sent for _, sent in self.sent[before:]]

    def wait(self, seconds: float) -> list[Body]:
        before = len(self.sent)
        self.now += seconds
        self._handle(TimerFired(LeasesDue()))
        return [sent for _, sent in self.sent[before:]]

    def way(self, robot: str) -> tuple[str, ...]:
        """The way that the robot was granted last."""
        return next((body.way for _, body in reversed(self.sent) if isinstance(body, Granted) and body.robot == robot), ())

    def view(self) -> TrafficView:
        view = self.send("window", ReadTraffic())[0]
        assert isinstance(view, TrafficView)
        return view

    def restart(self) -> None:
        self._journal.restart()


def text_of(body: Body) -> str:
    assert isinstance(body, Fault)
    return body.text


def test_a_robot_is_granted_its_way_a_few_places_ahead_of_it() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    begun = harness.trip("R1", "East")[0]
    assert begun == TripBegun(trip="R1 to East", length=8.0)
    harness.wait(1)
    assert harness.way("R1") == ("West", "A", "B", "C")
    harness.report("R1", "B", 2)
    assert harness.way("R1") == ("B", "C", "East")
    ended = harness.report("R1", "East", 4)
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.ARRIVED) in ended


def test_a_robot_without_a_trip_makes_room() -> None:
    harness = Harness(roadmap(LINE, ("B", "Bay")))
    harness.enter("R1", "West")
    harness.enter("R2", "B")
    harness.wait(1)
    harness.trip("R1", "East")
    harness.wait(1)
    assert len(harness.way("R2")) > 1, "it goes out of the way"
    assert harness.way("R1") == ("West", "A"), "it has to wait for that"
    waiting = next(robot for robot in harness.view().robots if robot.robot == "R1")
    assert (waiting.planned[:1], waiting.waits_for) == (("B",), ("R2",))
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.ARRIVED) in drive(harness)


def drive(harness: Harness, rounds: int = 30) -> list[Body]:
    """Let all robots drive as far as they may, again and again. Returns what was sent."""
    sent: list[Body] = []
    for _ in range(rounds):
        sent += harness.wait(1)
        for robot in harness.view().robots:
            if len(robot.held) > 1:
                granted = next(body for _, body in reversed(harness.sent) if isinstance(body, Granted) and body.robot == robot.robot)
                sent += harness.report(robot.robot, granted.way[-1], granted.progress + len(granted.way) - 1)
    return sent


def test_two_robots_are_never_in_one_place() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "A")
    assert "R1 holds it" in text_of(harness.enter("R2", "A"))
    assert "there is no place Nowhere" in text_of(harness.enter("R2", "Nowhere"))
    assert "no lane leads from West to C" in text_of(harness.enter("R2", "West", towards="C"))
    assert "R1 holds it" in text_of(harness.enter("R2", "West", towards="A"))


def test_messages_of_an_earlier_entry_count_no_more() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "A")
    old = harness.fences["R1"]
    harness.enter("R1", "B")
    assert harness.fences["R1"] > old
    body = ReportPlace(robot="R1", fence=old, number=1, grant=0, progress=0, place="A")
    assert "earlier fence" in text_of(harness.send("R1", body)[0])
    assert [robot.held for robot in harness.view().robots] == [("B",)]
    assert "does not take part" in text_of(
        harness.send("R2", ReportPlace(robot="R2", fence=1, number=1, grant=0, progress=0, place="A"))[0]
    )


def test_a_message_that_arrives_again_changes_nothing() -> None:
    harness = Harness(roadmap(LINE))
    entry = EnterTraffic(robot="R1", place="West", lease=LEASE)
    answer = harness.send("R1", entry, id="entry")[0]
    assert isinstance(answer, TrafficEntered)
    harness.fences["R1"] = answer.fence
    harness.trip("R1", "East")
    harness.wait(1)
    harness.report("R1", "A", 1)
    assert isinstance(harness.send("R1", entry, id="entry")[0], TrafficEntered)
    late = ReportPlace(robot="R1", fence=answer.fence, number=0, grant=0, progress=0, place="West")
    harness.send("R1", late)
    assert next(iter(harness.view().robots)).held[0] == "A", "the later report has overtaken it"


def test_a_robot_that_is_elsewhere_than_it_may_be_is_told_to_enter_anew() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    assert "let it enter anew" in text_of(harness.report("R1", "C", 3)[0])


def test_a_silent_robot_keeps_its_places_and_closes_the_way() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.enter("R2", "B")
    harness.now += LEASE / 2
    harness.report("R1", "West", 0)
    harness.trip("R1", "East")
    ended = harness.wait(LEASE / 2 + 1)
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.CLOSED, robots=("R2",)) in ended
    assert {robot.robot: robot.silent for robot in harness.view().robots} == {"R1": False, "R2": True}
    harness.send("operator", LeaveTraffic(robot="R2"))
    harness.wait(1)
    harness.trip("R1", "East")
    harness.wait(1)
    assert harness.way("R1") == ("West", "A", "B", "C")


def test_a_robot_that_cannot_move_ends_its_trip_and_closes_only_where_it_is() -> None:
    harness = Harness(roadmap(LINE, ("A", "Round", "C")))
    harness.enter("R1", "West")
    harness.trip("R1", "East")
    harness.wait(1)
    harness.report("R1", "A", 1)
    assert len(harness.way("R1")) > 2
    ended = harness.report("R1", "A", 1, Mobility.IMMOBILE)
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.IMMOBILE) in ended
    assert [robot.held for robot in harness.view().robots] == [("A",)]


def test_a_robot_keeps_what_it_was_granted_and_does_not_know_of() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.trip("R1", "East")
    harness.wait(1)
    harness.report("R1", "West", 0, Mobility.BUSY, grant=0)
    assert next(iter(harness.view().robots)).held == ("West", "A", "B", "C"), "the grant is still on its way"
    harness.report("R1", "West", 0, Mobility.BUSY)
    assert next(iter(harness.view().robots)).held == ("West",)


def test_where_nobody_can_make_room_the_trip_ends() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.enter("R2", "East")
    harness.wait(1)
    harness.trip("R1", "East")
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.NO_ROOM, robots=("R2",)) in drive(harness)


def test_a_trip_that_was_begun_after_the_plan_does_not_end_because_of_it() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.enter("R2", "East")
    harness.wait(1)
    harness.postponed = []
    harness.trip("R1", "East")
    harness.wait(1)
    assert harness.postponed
    harness.send("R1", CancelTrip(robot="R1", fence=harness.fences["R1"], trip="R1 to East"))
    harness.trip("R1", "A")
    harness.make_postponed_plans()
    assert TripEnded(robot="R1", trip="R1 to A", result=TripResult.ARRIVED) in drive(harness)


def test_a_robot_waits_for_hours_for_one_that_works_in_its_way() -> None:
    harness = Harness(roadmap(("West", "A", "East"), ("A", "Bay")))
    harness.enter("R1", "West")
    harness.enter("R2", "A", Mobility.BUSY)
    harness.postponed = []
    harness.trip("R1", "East")
    for _ in range(1100):
        harness.report("R1", "West", 0)
        harness.report("R2", "A", 0, Mobility.BUSY)
        harness.wait(11)
        for effect in harness.postponed:
            harness.answer(effect, TrafficPlan(ways={}))
        harness.postponed.clear()
    harness.postponed = None
    harness.report("R2", "A", 0)
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.ARRIVED) in drive(harness)


def test_a_cancelled_trip_is_not_driven() -> None:
    harness = Harness(roadmap((*LINE, "Further", "Farthest")))
    harness.enter("R1", "West")
    harness.trip("R1", "Farthest")
    harness.wait(1)
    harness.send("R1", CancelTrip(robot="R1", fence=harness.fences["R1"], trip="R1 to Farthest"))
    harness.wait(1)
    harness.report("R1", "C", 3)
    assert harness.way("R1")[-1] == "C", "what it holds is not taken away, and nothing is added"
    harness.send("R1", CancelTrip(robot="R1", fence=harness.fences["R1"], trip="another"))


def test_a_passage_that_is_out_of_order_is_avoided_and_named_if_there_is_no_other_way() -> None:
    harness = Harness(roadmap(LINE, ("A", "Bay", "C")))
    harness.enter("R1", "West")
    door = ClosedPassage(name="Door1", lanes=(ClosedLane(start="A", end="B"), ClosedLane(start="B", end="A")))
    harness.notify(CloseWays(passages=(door,)))
    harness.trip("R1", "East")
    harness.wait(1)
    assert harness.way("R1") == ("West", "A", "Bay", "C")
    lift = ClosedPassage(name="Lift1", places=("East",))
    ended = harness.notify(CloseWays(passages=(door, lift)))
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.CLOSED, passages=("Lift1",)) in [*ended, *harness.wait(1)]
    harness.restart()
    assert text_of(harness.trip("R1", "East")[0]) == "no lanes lead from C to East: Lift1 is out of order"
    harness.notify(CloseWays(places=("East",), passages=(door, lift)))
    closed = "no lanes lead from C to East now, because of doors that are shut, or of what stands there"
    assert text_of(harness.trip("R1", "East")[0]) == closed
    harness.notify(CloseWays(passages=(door,)))
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.ARRIVED) in [*harness.trip("R1", "East"), *drive(harness)]


def test_nobody_is_granted_a_way_while_traffic_is_held_and_trips_go_on_afterwards() -> None:
    harness = Harness(roadmap((*LINE, "Further", "Farthest")))
    harness.enter("R1", "West")
    harness.trip("R1", "Further")
    harness.wait(1)
    assert harness.way("R1") == ("West", "A", "B", "C")
    harness.notify(HoldTraffic(reason="fire alarm in House"))
    assert harness.view().hold == "fire alarm in House"
    harness.enter("R2", "Further")
    assert isinstance(harness.trip("R2", "Farthest")[0], TripBegun)
    harness.report("R1", "C", 3)
    harness.restart()
    for _ in range(5):
        sent = harness.wait(20)
        harness.report("R1", "C", 3), harness.report("R2", "Further", 0)
        assert not [body for body in sent if isinstance(body, Granted | TripEnded)]
    assert (harness.view().robots[0].held, harness.view().robots[1].held) == (("C",), ("Further",))
    harness.notify(HoldTraffic())
    results = {body.robot: body.result for body in drive(harness) if isinstance(body, TripEnded)}
    assert results == {"R1": TripResult.ARRIVED, "R2": TripResult.ARRIVED}


def house() -> Roadmap:
    """Two storeys with a hall of two places and a corner each, and a lift of two places between them."""
    names = ("Hall", "Door", "Front", "Cabin", "Corner")
    zones = {"Front": "Lift1", "Cabin": "Lift1"}
    places = [
        Place(name=f"{name}{storey}", x=float(number), y=0.0, level=4.0 * storey, zone=zones.get(name))
        for storey in (0, 1)
        for number, name in enumerate(names)
    ]
    ways = [
        (f"{first}{storey}", f"{second}{storey}")
        for storey in (0, 1)
        for first, second in (("Hall", "Door"), ("Door", "Front"), ("Front", "Cabin"), ("Door", "Corner"))
    ]
    lanes = [Lane(start=start, end=end, seconds=1.0) for a, b in ways for start, end in ((a, b), (b, a))]
    rides = [Lane(start=f"Cabin{start}", end=f"Cabin{1 - start}", seconds=10.0) for start in (0, 1)]
    return Roadmap(places=tuple(places), lanes=(*lanes, *rides))


FIRE = HoldTraffic(reason="fire alarm in House")


def test_a_robot_in_a_lift_is_granted_its_way_out_while_traffic_is_held_and_no_further() -> None:
    harness = Harness(house())
    harness.enter("R1", "Cabin0")
    harness.notify(FIRE)
    harness.trip("R1", "Hall1")
    drive(harness)
    assert harness.view().robots[0].held == ("Door0",), "out of the lift, on its storey"
    harness.notify(HoldTraffic())
    assert TripEnded(robot="R1", trip="R1 to Hall1", result=TripResult.ARRIVED) in drive(harness)


def test_a_robot_that_rides_leaves_the_lift_where_it_takes_it() -> None:
    harness = Harness(house())
    harness.enter("R1", "Front0")
    harness.trip("R1", "Corner1")
    harness.wait(1)
    assert harness.way("R1") == ("Front0", "Cabin0", "Cabin1", "Front1")
    harness.report("R1", "Cabin0", 1, between=True)
    harness.notify(FIRE)
    drive(harness)
    assert harness.view().robots[0].held == ("Door1",)


def test_a_robot_in_front_of_a_lift_makes_room_for_one_that_leaves_it_in_a_fire_and_nobody_else_moves() -> None:
    harness = Harness(house())
    for robot, place in (("R1", "Cabin0"), ("R2", "Door0"), ("R3", "Hall1")):
        harness.enter(robot, place)
    harness.notify(FIRE)
    harness.trip("R2", "Hall1")
    harness.trip("R3", "Corner1")
    drive(harness)
    first, second, third = (robot.held for robot in harness.view().robots)
    assert first == ("Door0",)
    assert second in (("Hall0",), ("Corner0",))
    assert third == ("Hall1",)


def test_a_plan_that_was_asked_for_before_a_hold_is_not_followed() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.postponed = []
    harness.trip("R1", "East")
    harness.wait(1)
    harness.notify(HoldTraffic(reason="fire alarm in House"))
    assert harness.postponed
    harness.make_postponed_plans()
    assert harness.way("R1") == ("West",)
    harness.notify(HoldTraffic())
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.ARRIVED) in drive(harness)


def test_nobody_is_sent_through_places_that_are_closed() -> None:
    harness = Harness(roadmap(LINE, ("A", "Bay", "C")))
    harness.enter("R1", "West")
    harness.notify(CloseWays(lanes=(ClosedLane(start="A", end="B"), ClosedLane(start="B", end="A"))))
    harness.trip("R1", "East")
    harness.wait(1)
    assert harness.way("R1") == ("West", "A", "Bay", "C")
    ended = harness.notify(CloseWays(places=("B", "East")))
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.CLOSED) in [*ended, *harness.wait(1)]
    assert "no lanes lead" in text_of(harness.trip("R1", "East")[0])
    harness.restart()
    assert "no lanes lead" in text_of(harness.trip("R1", "East")[0])
    harness.notify(CloseWays())
    harness.trip("R1", "East")
    harness.report("R1", "A", 1)
    harness.report("R1", "Bay", 2)
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.ARRIVED) in drive(harness)


def test_a_robot_works_at_a_berth_and_comes_back() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    berth = Berth(name="R1/table", x=3.4, y=0.0, radius=0.2, places=("C", "East"))
    harness.trip("R1", "R1/table", berth)
    assert TripEnded(robot="R1", trip="R1 to R1/table", result=TripResult.ARRIVED) in drive(harness)
    assert harness.view().berths == (berth,)
    harness.restart()
    harness.trip("R1", "West")
    assert TripEnded(robot="R1", trip="R1 to West", result=TripResult.ARRIVED) in drive(harness)
    assert harness.view().berths == ()


def test_the_berth_of_another_robot_is_refused() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    answer = harness.trip("R1", "R2/table", Berth(name="R2/table", x=1.4, y=0.0, radius=0.2, places=("A",)))[0]
    assert "has to begin with R1/" in text_of(answer)


def test_places_are_the_same_after_a_restart() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.enter("R2", "East")
    harness.trip("R1", "C")
    harness.wait(1)
    before = harness.view()
    harness.restart()
    assert harness.view() == before
    assert "holds it" in text_of(harness.enter("R3", "A"))


def test_what_cannot_be_is_refused() -> None:
    one_way = Roadmap(places=(Place(name="A", x=0, y=0), Place(name="B", x=1, y=0)), lanes=(Lane(start="A", end="B", seconds=1.0),))
    harness = Harness(one_way)
    harness.enter("R1", "B")
    assert text_of(harness.trip("R1", "A")[0]) == "no lanes lead from B to A"
    assert "state it in wsa:From" in text_of(harness.send(ANONYMOUS, EnterTraffic(robot="R2", place="A", lease=LEASE))[0])
    for x, radius in ((float("nan"), 0.3), (1.0, 0.0), (1.0, float("inf"))):
        berth = Berth(name="R1/1", x=x, y=0.0, radius=radius, places=("B",))
        assert "numbers in metres are needed" in text_of(harness.trip("R1", "R1/1", berth)[0])
    assert harness.send("R9", LeaveTraffic(robot="R9"))[0] == TrafficLeft(robot="R9")
    fault = harness.send("R1", TrafficLeft(robot="R1"))[0]
    assert isinstance(fault, Fault)
    assert fault.code == "ActionNotSupported"
    assert harness.send("R1", fault) == []


@pytest.mark.parametrize(
    ("map", "problem"),
    [
        (Roadmap(places=(Place(name="A", x=0, y=0), Place(name="A", x=1, y=0)), lanes=()), "A is the name of two places"),
        (Roadmap(places=(Place(name="A", x=0, y=0),), lanes=(Lane(start="A", end="B", seconds=1),)), "there is no place B"),
        (Roadmap(places=(Place(name="A", x=0, y=0),), lanes=(Lane(start="A", end="A", seconds=0),)), "takes 0 s"),
    ],
)
def test_a_roadmap_that_cannot_be_used_is_refused(map: Roadmap, problem: str) -> None:
    with pytest.raises(Exception, match=problem):
        Traffic("traffic", map)


def test_places_that_are_too_near_to_each_other_exclude_each_other() -> None:
    near = Roadmap(
        places=(Place(name="A", x=0.0, y=0.0), Place(name="B", x=0.5, y=0.0), Place(name="Above", x=0.5, y=0.0, level=3.0)),
        lanes=(),
        spacing=0.6,
    )
    harness = Harness(near)
    harness.enter("R1", "A")
    assert "R1 holds it" in text_of(harness.enter("R2", "B"))
    assert isinstance(harness.enter("R2", "Above"), TrafficEntered)


def test_a_robot_that_breaks_between_two_places_keeps_both() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.trip("R1", "East")
    harness.wait(1)
    ended = harness.report("R1", "A", 1, Mobility.IMMOBILE, between=True)
    assert TripEnded(robot="R1", trip="R1 to East", result=TripResult.IMMOBILE) in ended
    assert [robot.held for robot in harness.view().robots] == [("A", "B")]


def test_a_robot_between_two_places_turns_round_on_a_lane_that_is_closed_by_now() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "A")
    harness.trip("R1", "East")
    harness.wait(1)
    harness.report("R1", "A", 0, Mobility.BUSY, between=True)
    harness.notify(CloseWays(places=("B",)))
    assert isinstance(harness.enter("R1", "B", towards="A"), TrafficEntered)
    assert [robot.held for robot in harness.view().robots] == [("B", "A")]
    harness.report("R1", "A", 1)
    harness.trip("R1", "West")
    assert TripEnded(robot="R1", trip="R1 to West", result=TripResult.ARRIVED) in drive(harness)


def test_a_robot_turns_round_to_the_berth_from_which_it_came() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "East")
    berth = Berth(name="R1/table", x=3.4, y=0.0, radius=0.2, places=("C", "East"))
    harness.trip("R1", "R1/table", berth)
    drive(harness)
    harness.notify(CloseWays(places=("C",)))
    turned = EnterTraffic(robot="R1", place="C", towards="R1/table", berths=(berth,), lease=LEASE)
    assert isinstance(harness.send("R1", turned)[0], TrafficEntered)
    assert [robot.held for robot in harness.view().robots] == [("C", "R1/table")]


def test_a_request_that_arrives_again_is_answered_again_and_begins_nothing() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    request = RequestTrip(robot="R1", fence=harness.fences["R1"], number=1, trip="first", destination="A")
    assert harness.send("R1", request)[0] == TripBegun(trip="first", length=2.0)
    harness.wait(1)
    assert TripEnded(robot="R1", trip="first", result=TripResult.ARRIVED) in harness.report("R1", "A", 1)
    assert isinstance(harness.send("R1", request)[0], TripBegun)
    assert harness.view().robots[0].trip is None


def test_a_plan_for_an_earlier_roadmap_is_not_followed() -> None:
    harness = Harness(roadmap(LINE))
    harness.enter("R1", "West")
    harness.wait(1)
    harness.postponed = []
    harness.trip("R1", "East")
    harness.wait(1)
    assert harness.postponed, "the plan is being made"
    harness.replace_roadmap(roadmap(LINE))
    harness.make_postponed_plans()
    harness.enter("R1", "West")
    harness.trip("R1", "East")
    harness.wait(1)
    assert harness.way("R1") == ("West", "A", "B", "C")


def test_robots_go_on_by_the_plan_while_another_one_begins_to_work() -> None:
    traffic = Harness(roadmap(("A", "B", "C", "D", "E", "F", "G", "H"), ("Table", "Shelf")))
    traffic.enter("R1", "A")
    traffic.enter("R2", "Table")
    traffic.trip("R1", "H")
    traffic.wait(1.0)
    assert traffic.way("R1") == ("A", "B", "C", "D")
    traffic.postponed = []  # from now on, plans take a while
    traffic.report("R2", "Table", 0, Mobility.BUSY)
    traffic.wait(1.0)
    traffic.make_postponed_plans()
    traffic.postponed = []
    traffic.report("R2", "Table", 0, Mobility.FREE)
    traffic.report("R1", "B", 1)
    assert traffic.way("R1") == ("B", "C", "D", "E")
