"""Lifts and automatic doors whose programs take part in traffic, on virtual time: the component, robots, and the programs of passages."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from random import Random

from somrs.kernel.component import Received, Send
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.traffic import (
    Berth,
    CallPassage,
    PassageClosed,
    PassageOpen,
    ReadTraffic,
    ReleasePassage,
    ReportPassage,
    TrafficView,
    TripResult,
)
from somrs.runtime.virtual_time import QUIET, Work, World
from somrs.space.solids import Role, Solid
from somrs.traffic.component import SCHEMA, Traffic
from somrs.traffic.notices import CloseWays, RoadmapMade
from somrs.traffic.passage_call import PassageCall, PassageStatus
from somrs.traffic.passage_program import LEASE, Complaint, PassageProgram, Release
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Lane, Place, Roadmap
from somrs.traffic.state import PlanTraffic
from verification.traffic_runs.vehicle import Robot, Vehicle

UPPER = 4.0
RIDE = 10.0
"""How long a lift takes to come and to open its doors, in seconds."""


def building(*, lifts: int = 1) -> Roadmap:
    """Two storeys of a corridor of five places, with a door between the third and the fourth on the lower one; lifts at its ends."""
    places = [
        Place(name=f"{storey}{number}", x=float(number), y=0.0, level=level)
        for storey, level in (("L", 0.0), ("U", UPPER))
        for number in range(5)
    ]
    lanes = [pair for storey in "LU" for pair in pairwise(f"{storey}{number}" for number in range(5))]
    rides: list[tuple[str, str]] = []
    for lift, (x, beside) in enumerate(((5.0, 4), (-1.0, 0))[:lifts], start=1):
        names = [f"{storey}Cabin{lift}" for storey in "LU"]
        places += (Place(name=name, x=x, y=0.0, level=level, zone=f"Lift{lift}") for name, level in zip(names, (0.0, UPPER), strict=True))
        lanes += ((f"{storey}{beside}", name) for storey, name in zip("LU", names, strict=True))
        rides.append((names[0], names[1]))
    door = Solid(
        name="Door1", type="AutomaticDoor", role=Role.DOOR, x=2.5, y=0.0, z=0.0, yaw=0.0, form="Box", width=0.1, depth=1.0, height=2.0
    )
    both_ways = [(pair, seconds) for pairs, seconds in ((lanes, 2.0), (rides, RIDE)) for a, b in pairs for pair in ((a, b), (b, a))]
    return Roadmap(
        places=tuple(places),
        lanes=tuple(Lane(start=start, end=end, seconds=seconds) for (start, end), seconds in both_ways),
        lifts=tuple(f"Lift{number}" for number in range(1, lifts + 1)),
        doors=(door,),
    )


@dataclass
class Hardware:
    """The cabin or the leaf that a program moves. `served`: what it was called for."""

    level: float | None = None
    served: list[PassageCall | Release] = field(default_factory=list)
    works: bool = True


class Lab:
    """Traffic with robots and passages, in one world."""

    def __init__(self, roadmap: Roadmap, *passages: str) -> None:
        self.world, self.roadmap = World(), roadmap
        self._planner = TrafficPlanner(roadmap, Random())
        self._seconds = {(lane.start, lane.end): lane.seconds for lane in roadmap.lanes}
        self.robots: dict[str, Robot] = {}
        self.hardware = {name: Hardware(level=0.0 if name.startswith("Lift") else None) for name in passages}
        self._lives = 0
        self.world.add("traffic", Traffic("traffic", roadmap), self._plan, journaled=SCHEMA)
        for name in passages:
            self.start_program(name)
        self.world.run(1.0)

    def _plan(self, task: object) -> Work:
        assert isinstance(task, PlanTraffic)
        yield 0.05, self._planner.plan(task)

    def replace_roadmap(self, roadmap: Roadmap) -> None:
        self._planner = TrafficPlanner(roadmap, Random())
        self.world.notify("traffic", RoadmapMade(roadmap=roadmap, closing=CloseWays()))

    def start_program(self, name: str) -> None:
        self._lives += 1
        program = PassageProgram(name, name, "traffic", str(self._lives))
        self.world.add(name, program, partial(self._work, self.hardware[name]))
        self.report(name)

    def report(self, name: str, *, shared: bool = False) -> None:
        self.world.notify(name, PassageStatus(level=self.hardware[name].level, working=self.hardware[name].works, shared=shared))

    def set_working(self, name: str, works: bool) -> None:
        """A passage breaks, or is mended."""
        self.hardware[name].works = works
        self.report(name)

    def _work(self, hardware: Hardware, task: object) -> Work:
        assert isinstance(task, PassageCall | Release | Complaint)
        if isinstance(task, Complaint):
            yield 0.0, None
            return
        hardware.served.append(task)
        name = next(name for name, candidate in self.hardware.items() if candidate is hardware)
        if isinstance(task, Release):
            yield 0.0, None
            return
        if task.level is not None and task.level != hardware.level:
            hardware.level = None
            self.report(name)
            yield RIDE, QUIET
            while not hardware.works:
                yield RIDE, QUIET
            hardware.level = task.level
            self.report(name)
        yield 1.0, None

    def robot(self, name: str, place: str, *trips: str, berth: Berth | None = None) -> Robot:
        berths = {berth.name: berth} if berth is not None else {}
        robot = self.robots[name] = Robot(name=name, place=place, trips=list(trips), berths=berths)
        self.world.add(name, Vehicle(robot, "traffic", self._duration, 0.0))
        return robot

    def _duration(self, start: str, end: str) -> float:
        if {start[0], end[0]} == {"L", "U"}:
            return 0.01  # in a ride, the lift takes the time
        return self._seconds.get((start, end), 2.0)

    def sent(self, recipient: str) -> list[Body]:
        return [message.body for message in self.world.messages if message.header.recipient == recipient]

    def read(self, body: Body) -> Body:
        header = Header(sender="x", recipient="traffic", message_id="x")
        (effect,) = self.world.components["traffic"].handle(Received(Message(header=header, body=body)), self.world.now)
        assert isinstance(effect, Send)
        return effect.message.body

    def view(self) -> TrafficView:
        view = self.read(ReadTraffic())
        assert isinstance(view, TrafficView)
        return view

    def run(self, *robots: Robot) -> None:
        assert self.world.run(600.0, lambda: not any(robot.trips for robot in robots)), robots
        assert all(ending.result is TripResult.ARRIVED for robot in robots for ending in robot.endings), [r.endings for r in robots]


def test_a_lift_is_called_for_a_robot_with_origin_and_destination_and_released_behind_it() -> None:
    lab = Lab(building(), "Lift1", "Door1")
    robot = lab.robot("Cart", "L3", "U3")
    lab.run(robot)
    lab.world.run(30.0)
    calls = [(body.level, body.destination, body.robots) for body in lab.sent("Lift1") if isinstance(body, CallPassage)]
    assert calls == [(0.0, UPPER, ("Cart",)), (UPPER, UPPER, ("Cart",))]
    assert [type(body) for body in lab.sent("Lift1") if isinstance(body, CallPassage | ReleasePassage)][-1] is ReleasePassage
    assert lab.hardware["Lift1"].served[-1] == Release()
    assert [body.place for body in lab.sent("Cart") if isinstance(body, PassageOpen)] == ["LCabin1", "UCabin1", "U4"]


def test_a_robot_drives_through_a_door_when_it_is_open_and_it_is_released_behind_it() -> None:
    lab = Lab(building(), "Door1")
    first, second = lab.robot("Cart1", "L1", "L4"), lab.robot("Cart2", "L0", "L3")
    lab.run(first, second)
    lab.world.run(30.0)
    assert [body.place for body in lab.sent("Cart1") if isinstance(body, PassageOpen)] == ["L3"]
    served = lab.hardware["Door1"].served
    assert served[:2] == [Release(), PassageCall()]
    assert served[-1] == Release()


def test_a_robot_waits_before_a_door_on_its_way_to_a_point_of_its_own_and_back() -> None:
    lab = Lab(building(), "Door1")
    table = Berth(name="Cart/Table", x=3.3, y=0.0, radius=0.2, places=("L2",))
    cart = lab.robot("Cart", "L1", "Cart/Table", "L1", berth=table)
    for place in ("Cart/Table", "L2"):
        assert lab.world.run(60.0, partial(_is_on_its_way, cart, place))
        assert [body.place for body in lab.sent("Cart") if isinstance(body, PassageOpen)][-1] == place
        assert isinstance(lab.hardware["Door1"].served[-1], PassageCall)
    lab.run(cart)


def _is_on_its_way(robot: Robot, place: str) -> bool:
    return robot.towards == place


def test_nobody_is_sent_through_passages_whose_programs_do_not_take_part() -> None:
    lab = Lab(building(), "Door1")
    cart = lab.robot("Cart", "L3", "U3")
    lab.world.run(5.0)
    (refusal,) = {body.text for body in lab.sent("Cart") if isinstance(body, Fault)}
    assert refusal == "no lanes lead from L3 to U3: Lift1 is out of order"
    lab.hardware["Lift1"] = Hardware(level=UPPER)
    lab.start_program("Lift1")
    lab.run(cart)


def test_a_robot_takes_the_other_lift_when_one_falls_silent_before_it_enters() -> None:
    lab = Lab(building(lifts=2), "Lift1", "Lift2", "Door1")
    lab.hardware["Lift1"].level = UPPER  # it takes its time to come
    lab.report("Lift1")
    cart = lab.robot("Cart", "L4", "U4")
    assert lab.world.run(5.0, lambda: any(isinstance(body, CallPassage) for body in lab.sent("Lift1")))
    lab.world.remove("Lift1")
    lab.run(cart)
    assert [body.passage for body in lab.sent("Cart") if isinstance(body, PassageClosed)] == ["Lift1"]
    assert "UCabin2" in {body.place for body in lab.sent("Cart") if isinstance(body, PassageOpen)}


def test_a_robot_keeps_a_lift_whose_program_dies_and_goes_on_when_that_is_back() -> None:
    lab = Lab(building(), "Lift1", "Door1")
    cart = lab.robot("Cart", "L4", "U4")
    assert lab.world.run(60.0, lambda: cart.place == "LCabin1")
    lab.world.run(3.0)
    lab.world.remove("Lift1")
    rival = lab.robot("Rival", "U2", "L2")
    lab.world.run(LEASE + 60.0)
    assert (cart.place, cart.towards) == ("LCabin1", None)
    assert rival.place[0] == "U"
    view = lab.view()
    assert {passage.passage: (passage.usable, passage.silent) for passage in view.passages}["Lift1"] == (False, True)
    assert {robot.robot: (robot.passage, robot.inside) for robot in view.robots}["Cart"] == ("Lift1", True)
    lab.start_program("Lift1")
    assert lab.world.run(600.0, lambda: not cart.trips and not rival.trips)


def test_a_program_that_is_started_again_within_its_lease_goes_on_with_the_ride() -> None:
    lab = Lab(building(), "Lift1", "Door1")
    cart = lab.robot("Cart", "L4", "U4")
    assert lab.world.run(60.0, lambda: lab.hardware["Lift1"].level is None)
    lab.world.remove("Lift1")
    lab.world.run(2.0)
    lab.start_program("Lift1")
    lab.run(cart)


def test_traffic_that_is_killed_and_started_again_in_the_middle_of_a_ride_goes_on_with_it() -> None:
    for moment in range(1, 40):
        lab = Lab(building(), "Lift1", "Door1")
        cart, rival = lab.robot("Cart", "L2", "U2"), lab.robot("Rival", "U1", "L1")
        lab.world.run(float(moment))
        lab.world.kill("traffic")
        lab.world.run(3 * LEASE)
        lab.world.revive("traffic")
        lab.run(cart, rival)


def test_robots_wait_while_people_use_a_lift_and_say_so() -> None:
    lab = Lab(building(), "Lift1", "Door1")
    lab.report("Lift1", shared=True)
    cart = lab.robot("Cart", "L4", "U4")
    lab.world.run(3_000.0)
    assert (cart.place, cart.endings) == ("L4", [])
    view = lab.view()
    assert {robot.robot: robot.passage for robot in view.robots}["Cart"] == "Lift1"
    assert {passage.passage: passage.shared for passage in view.passages}["Lift1"]
    lab.report("Lift1")
    lab.run(cart)


def test_a_lift_that_reports_a_fault_is_closed_until_it_is_mended() -> None:
    lab = Lab(building(), "Lift1", "Door1")
    lab.set_working("Lift1", False)
    cart = lab.robot("Cart", "L4", "U4")
    lab.world.run(60.0)
    assert cart.place == "L4"
    assert any("Lift1 is out of order" in body.text for body in lab.sent("Cart") if isinstance(body, Fault))
    lab.set_working("Lift1", True)
    assert lab.world.run(600.0, lambda: not cart.trips)


def test_the_others_go_on_while_a_lift_stands_still_with_a_robot_in_it() -> None:
    """The robot has a way out of the cabin that it cannot go: nobody waits for that, nor for what was planned for it."""
    lab = Lab(building(lifts=2), "Lift1", "Lift2", "Door1")
    cart = lab.robot("Cart", "L4", "U1")
    others = lab.robot("Other1", "U1", *["U0", "U4"] * 20), lab.robot("Other2", "L2", *["L0", "L4"] * 20)
    assert lab.world.run(60.0, lambda: cart.place == "LCabin1" and lab.hardware["Lift1"].level is None)
    lab.set_working("Lift1", False)
    lab.run(*others)
    assert cart.place == "LCabin1"
    assert {robot.robot: robot.held for robot in lab.view().robots}["Cart"] == ("LCabin1", "UCabin1")
    lab.set_working("Lift1", True)
    lab.run(cart)


def test_only_the_passages_of_the_building_have_programs() -> None:
    lab = Lab(building(), "Door1")
    lab.hardware["Dor1"] = Hardware()
    lab.start_program("Dor1")
    lab.world.run(5.0)
    text = "Dor1 is no lift or automatic door on the map where robots drive; did you mean Door1?"
    assert {body.text for body in lab.sent("Dor1") if isinstance(body, Fault)} == {text}
    assert [passage.passage for passage in lab.view().passages] == ["Lift1", "Door1"]


def test_a_program_that_came_before_the_roadmap_takes_part_if_the_roadmap_has_its_passage() -> None:
    lab = Lab(Roadmap(places=(), lanes=()), "Door1", "Dor1")
    assert not any(isinstance(body, Fault) for name in ("Door1", "Dor1") for body in lab.sent(name))
    lab.replace_roadmap(building())
    lab.world.run(2 * LEASE)
    assert not any(isinstance(body, Fault) for body in lab.sent("Door1"))
    texts = [body.text for body in lab.sent("Dor1") if isinstance(body, Fault)]
    assert texts[0] == "the program of Dor1 does not take part in traffic: let it enter first"
    assert texts[-1] == "Dor1 is no lift or automatic door on the map where robots drive; did you mean Door1?"


def test_a_program_that_was_replaced_is_refused() -> None:
    harness = Lab(building(), "Lift1", "Door1")
    first = harness.world.components["Lift1"]
    assert isinstance(first, PassageProgram)
    harness.start_program("Lift1")
    harness.world.run(1.0)
    old = Message(
        header=Header(sender="old", recipient="traffic", message_id="old1", reply_to="old"),
        body=ReportPassage(passage="Lift1", fence=1, number=100, call=0, level=UPPER, open=True),
    )
    traffic = harness.world.components["traffic"]
    answers = [effect.message.body for effect in traffic.handle(Received(old), harness.world.now) if isinstance(effect, Send)]
    assert any(isinstance(answer, Fault) and "entered traffic anew since" in answer.text for answer in answers)
