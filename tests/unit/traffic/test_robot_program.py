"""Programs of robots of any make in traffic: they enter, travel, wait, give up, and enter anew; messages may be late and lost."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from itertools import count, pairwise
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from somrs.kernel.component import (
    Answered,
    Ask,
    DeliveryFailed,
    Effect,
    Input,
    Notified,
    Received,
    Send,
    SetTimer,
    Started,
    TimerFired,
    Withdraw,
)
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.traffic import Mobility, TripResult
from somrs.space.solids import Role, Solid
from somrs.traffic.component import Traffic
from somrs.traffic.notices import ClosedLane, CloseWays, RoadmapMade
from somrs.traffic.participant import PassageParticipant
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Lane, Place, Roadmap
from somrs.traffic.robot_program import RobotProgram
from somrs.traffic.robot_tasks import (
    Astray,
    Follow,
    HeldUp,
    Locate,
    MobilityChanged,
    PlacePassed,
    SilenceChanged,
    Standing,
    TripGivenUp,
    TripOver,
    TripWanted,
    WayPlace,
)
from somrs.traffic.state import PlanTraffic

STEP = 0.5
"""Seconds between two looks."""
GRID = [f"{row}{column}" for row in range(4) for column in range(4)]


def line(*names: str) -> Roadmap:
    return roadmap([*pairwise(names)], [*names])


def grid() -> Roadmap:
    pairs = [(f"{r}{c}", f"{r}{c + 1}") for r in range(4) for c in range(3)] + [
        (f"{r}{c}", f"{r + 1}{c}") for r in range(3) for c in range(4)
    ]
    return roadmap(pairs, GRID)


def roadmap(pairs: list[tuple[str, str]], names: list[str]) -> Roadmap:
    lanes = tuple(Lane(start=start, end=end, seconds=2.0) for a, b in pairs for start, end in ((a, b), (b, a)))
    return Roadmap(places=tuple(Place(name=name, x=float(number), y=0.0) for number, name in enumerate(names)), lanes=lanes)


class Robot:
    """The hardware of a robot: it comes to one released place at each step. `workplace`: where it stays when it comes there."""

    def __init__(self, hall: Hall, name: str, place: str) -> None:
        self.hall, self.name, self.place, self.number = hall, name, place, 0
        self.program = RobotProgram(name, name, "traffic", f"life-{name}")
        self.way: tuple[WayPlace, ...] = ()
        self.overs: dict[str, TripOver] = {}
        self.is_stuck = False
        self.workplace = ""
        self.held_up = HeldUp()
        self.visited = [place]

    def carry_out(self, task: object) -> object:
        match task:
            case Locate():
                self.way = ()
                return Standing(place=self.place)
            case Follow(way=way):
                numbers = [waypoint.number for waypoint in way]
                assert numbers == [*range(numbers[0], numbers[0] + len(numbers))]
                assert way[0].name == self.place or not self.way or way[0].number <= self.number
                self.way, self.number = way, max(self.number, way[0].number)
            case TripOver(trip=trip):
                self.overs[trip] = task
            case HeldUp():
                self.held_up = task
        return None

    def drive(self) -> None:
        """Come to the next place, if it is released."""
        following = next((waypoint for waypoint in self.way if waypoint.number == self.number + 1), None)
        if following is not None and following.released and not self.is_stuck:
            self.number, self.place = following.number, following.name
            self.visited.append(self.place)
            self.hall.check_apart()
            self.notify(PlacePassed(self.number, Mobility.BUSY if self.place == self.workplace else None))

    def notify(self, notice: object) -> None:
        self.hall.handle(self.name, Notified(notice))

    def go(self, trip: str, place: str) -> None:
        self.notify(TripWanted(trip, place))

    def result(self, trip: str) -> TripResult | None:
        over = self.overs.get(trip)
        return over.ended.result if over is not None and over.ended is not None else None


class Hall:
    """Traffic and robots, with messages between them. `loss`: the share of messages that are lost; their senders learn it, or not
    (`is_silently`)."""

    def __init__(self, map: Roadmap, starts: dict[str, str], *, seed: int = 0, loss: float = 0.0, is_silently: bool = False) -> None:
        self.is_silently = is_silently
        self.map, self.now, self._random, self._loss = map, 100.0, Random(seed), loss
        self._traffic, self._planner = Traffic("traffic", map), TrafficPlanner(map, Random(seed))
        self._queue: deque[Message] = deque()
        self._timers: dict[tuple[str, object], float] = {}
        self._ids = count()
        self.robots = {name: Robot(self, name, place) for name, place in starts.items()}
        self.handle("traffic", Started("traffic"))
        for name in self.robots:
            self.handle(name, Started(name))

    def handle(self, address: str, event: Input) -> None:
        component = self._traffic if address == "traffic" else self.robots[address].program
        self._perform(address, component.handle(event, self.now))

    def _perform(self, address: str, effects: Iterable[Effect]) -> None:
        for effect in [*effects]:
            match effect:
                case Send(message):
                    self._queue.append(message)
                case SetTimer(timer, due):
                    self._timers.pop((address, timer), None)
                    if due is not None:
                        self._timers[address, timer] = due
                case Ask(question=question, task=PlanTraffic() as problem):
                    self.handle(address, Answered(question, self._planner.plan(problem)))
                case Ask(question=question, task=task):
                    self.handle(address, Answered(question, self.robots[address].carry_out(task)))
                case Withdraw():
                    pass

    def use(self, map: Roadmap) -> None:
        """The building has changed."""
        self._planner = TrafficPlanner(map, Random(1))
        self.handle("traffic", Notified(RoadmapMade(roadmap=map, closing=CloseWays())))

    def close(self, *lanes: tuple[str, str]) -> None:
        self.handle("traffic", Notified(CloseWays(lanes=tuple(ClosedLane(start=first, end=second) for first, second in lanes))))

    def run(self, seconds: float = 60.0) -> None:
        end = self.now + seconds
        while self.now < end:
            self.now += STEP
            while self._queue:
                message = self._queue.popleft()
                sender = message.header.sender or ""
                if message.header.recipient not in ("traffic", *self.robots):
                    continue  # nobody moves the door
                if self._random.random() >= self._loss:
                    self.handle(message.header.recipient, Received(message))
                elif not self.is_silently:
                    self.handle(sender, DeliveryFailed(message, "lost"))
            for (address, timer), due in [*self._timers.items()]:
                if due <= self.now and self._timers.pop((address, timer), None) is not None:
                    self.handle(address, TimerFired(timer))
            for robot in self.robots.values():
                robot.drive()

    def enter_all(self) -> None:
        """Run until all take part: before, nobody knows where they are."""
        for _ in range(200):
            self.run(5.0)
            if all(robot.way for robot in self.robots.values()):
                return
        raise AssertionError(f"{[name for name, robot in self.robots.items() if not robot.way]} do not take part")

    def check_apart(self) -> None:
        places = [robot.place for robot in self.robots.values()]
        assert len({*places}) == len(places), f"two robots are at one place: {places}"


def test_a_robot_travels_along_its_way_and_is_told_that_it_has_arrived() -> None:
    hall = Hall(line("A", "B", "C", "D"), {"Cart": "A"})
    hall.robots["Cart"].go("trip1", "D")
    hall.run()
    assert hall.robots["Cart"].visited == ["A", "B", "C", "D"]
    assert hall.robots["Cart"].result("trip1") is TripResult.ARRIVED


def test_what_is_planned_is_told_before_it_is_released() -> None:
    hall = Hall(grid(), {f"Cart{number}": place for number, place in enumerate(("00", "03", "30", "33"))})
    cart = hall.robots["Cart0"]
    ways_told: list[tuple[WayPlace, ...]] = []
    carry_out = cart.carry_out

    def watch(task: object) -> object:
        if isinstance(task, Follow):
            ways_told.append(task.way)
        return carry_out(task)

    cart.carry_out = watch  # type: ignore[method-assign]
    for robot, goal in zip(hall.robots.values(), ("33", "30", "03", "00"), strict=True):
        robot.go("trip", goal)
    hall.run(200.0)
    assert all(robot.result("trip") is TripResult.ARRIVED for robot in hall.robots.values())
    assert any(not way[-1].released for way in ways_told)
    assert all(all(first.released or not second.released for first, second in pairwise(way)) for way in ways_told)


def test_an_idle_robot_makes_room() -> None:
    hall = Hall(roadmap([("A", "B"), ("B", "C"), ("B", "Side")], ["A", "B", "C", "Side"]), {"Cart": "A", "Idle": "B"})
    hall.robots["Cart"].go("trip1", "C")
    hall.run()
    assert hall.robots["Cart"].result("trip1") is TripResult.ARRIVED
    assert "Side" in hall.robots["Idle"].visited


def test_one_that_works_is_waited_for() -> None:
    hall = Hall(line("A", "B", "C"), {"Cart": "A", "Worker": "B"})
    hall.run(5.0)
    hall.robots["Worker"].notify(MobilityChanged(Mobility.BUSY))
    hall.robots["Cart"].go("trip1", "B")
    hall.run(30.0)
    assert hall.robots["Cart"].place == "A"
    hall.robots["Worker"].notify(MobilityChanged(Mobility.FREE))
    hall.run(30.0)
    assert hall.robots["Cart"].result("trip1") is TripResult.ARRIVED


def test_one_that_comes_to_where_it_works_is_not_sent_away_before_it_has_begun() -> None:
    hall = Hall(roadmap([("A", "B"), ("B", "C"), ("B", "Side")], ["A", "B", "C", "Side"]), {"Cart": "A", "Worker": "Side"})
    hall.run(5.0)
    worker = hall.robots["Worker"]
    worker.workplace = "B"
    worker.go("trip1", "B")
    hall.robots["Cart"].go("trip2", "C")
    hall.run(30.0)
    assert worker.result("trip1") is TripResult.ARRIVED
    assert worker.visited == ["Side", "B"]
    worker.notify(MobilityChanged(Mobility.FREE))
    hall.run(60.0)
    assert hall.robots["Cart"].result("trip2") is TripResult.ARRIVED


def test_a_robot_is_told_for_whom_it_waits_also_when_that_one_cannot_be_reached() -> None:
    """Seen: a robot that waited was said to drive."""
    hall = Hall(line("A", "B", "C"), {"Cart": "A", "Mute": "B"})
    hall.run(5.0)
    cart, mute = hall.robots["Cart"], hall.robots["Mute"]
    mute.notify(MobilityChanged(Mobility.BUSY))
    mute.notify(SilenceChanged(True))
    cart.go("trip1", "B")
    hall.run(6.0)
    assert cart.held_up == HeldUp(robots=("Mute",))
    mute.notify(SilenceChanged(False))
    mute.notify(MobilityChanged(Mobility.FREE))
    hall.run(30.0)
    assert (cart.held_up, cart.result("trip1")) == (HeldUp(), TripResult.ARRIVED)


def test_a_robot_is_told_for_which_door_it_waits() -> None:
    """Seen: a robot stood before a door that never opened, and was said to drive."""
    door = Solid(
        name="Door1", type="AutomaticDoor", role=Role.DOOR, x=2.5, y=0.0, z=0.0, yaw=0.0, form="Box", width=0.1, depth=1.0, height=2.0
    )
    hall = Hall(structs.replace(line("A", "B", "C", "D"), doors=(door,)), {"Cart": "A"})
    program = PassageParticipant("Door1")
    for number in (1, 2):
        header = Header(sender="door", recipient="traffic", message_id=f"urn:door:{number}", reply_to="door")
        body = program.enter(60.0) if number == 1 else program.report(is_open=False)
        hall.handle("traffic", Received(Message(header=header, body=body)))
        program.fence = hall._traffic.state.passages["Door1"].fence
    hall.run(5.0)
    hall.robots["Cart"].go("trip1", "D")
    hall.run(10.0)
    assert (hall.robots["Cart"].held_up, hall.robots["Cart"].place) == (HeldUp(passage="Door1"), "C")


def test_a_trip_that_is_given_up_gives_its_way_back() -> None:
    hall = Hall(line("A", "B", "C", "D", "E"), {"Cart": "A", "Van": "E"})
    cart = hall.robots["Cart"]
    hall.run(5.0)
    cart.is_stuck = True
    cart.go("trip1", "D")
    hall.run(5.0)
    cart.notify(TripGivenUp())
    hall.robots["Van"].go("trip2", "C")
    hall.run(30.0)
    assert hall.robots["Van"].result("trip2") is TripResult.ARRIVED


def test_a_robot_that_cannot_drive_on_enters_anew_and_takes_another_way() -> None:
    hall = Hall(roadmap([("A", "B"), ("B", "C"), ("A", "D"), ("D", "C")], ["A", "B", "C", "D"]), {"Cart": "A"})
    cart = hall.robots["Cart"]
    hall.run(5.0)
    cart.is_stuck = True
    cart.go("trip1", "C")
    hall.run(5.0)
    hall.close(("A", "B"), ("B", "A"))
    cart.notify(TripGivenUp())
    cart.notify(Astray())
    cart.is_stuck = False
    hall.run(5.0)
    cart.go("trip2", "C")
    hall.run(30.0)
    assert cart.result("trip2") is TripResult.ARRIVED
    assert cart.visited == ["A", "D", "C"]


def test_a_new_roadmap_is_read_and_the_robot_travels_on_it() -> None:
    hall = Hall(line("A", "B", "C"), {"Cart": "A"})
    hall.run(5.0)
    hall.use(line("A", "B", "C", "New"))
    hall.run(10.0)
    hall.robots["Cart"].go("trip1", "New")
    hall.run(30.0)
    assert hall.robots["Cart"].result("trip1") is TripResult.ARRIVED


def test_an_unknown_destination_is_refused_with_the_reason() -> None:
    hall = Hall(line("A", "B"), {"Cart": "A"})
    hall.robots["Cart"].go("trip1", "Nowhere")
    hall.run()
    assert "Nowhere" in hall.robots["Cart"].overs["trip1"].refusal


def test_a_silent_robot_is_driven_around_and_goes_on_when_it_is_there_again() -> None:
    hall = Hall(roadmap([("A", "B"), ("B", "C"), ("A", "D"), ("D", "C")], ["A", "B", "C", "D"]), {"Cart": "A", "Mute": "B"})
    hall.run(5.0)
    hall.robots["Mute"].is_stuck = True
    hall.robots["Mute"].notify(SilenceChanged(True))
    hall.run(60.0)
    hall.robots["Cart"].go("trip1", "C")
    hall.run(60.0)
    assert hall.robots["Cart"].visited == ["A", "D", "C"]
    hall.robots["Mute"].is_stuck = False
    hall.robots["Mute"].notify(SilenceChanged(False))
    hall.robots["Mute"].go("trip2", "A")
    hall.run(60.0)
    assert hall.robots["Mute"].result("trip2") is TripResult.ARRIVED


def test_a_place_that_was_not_granted_is_not_believed() -> None:
    hall = Hall(line("A", "B", "C"), {"Cart": "A"})
    hall.run(5.0)
    hall.robots["Cart"].notify(PlacePassed(99))
    hall.run(5.0)
    hall.robots["Cart"].go("trip1", "C")
    hall.run(30.0)
    assert hall.robots["Cart"].visited == ["A", "B", "C"]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**20), loss=st.sampled_from((0.0, 0.1, 0.3)), is_silently=st.booleans())
def test_robots_come_everywhere_without_meeting_whatever_is_lost(seed: int, loss: float, is_silently: bool) -> None:
    random = Random(seed)
    starts = random.sample(GRID, 5)
    hall = Hall(grid(), {f"Cart{number}": start for number, start in enumerate(starts)}, seed=seed, loss=loss, is_silently=is_silently)
    hall.enter_all()
    for turn in range(2):
        goals = dict(zip(hall.robots, random.sample(GRID, 5), strict=True))
        for attempt in range(40):
            away = {name: robot for name, robot in hall.robots.items() if robot.place != goals[name]}
            for name, robot in away.items():
                robot.go(f"trip{turn}.{attempt}", goals[name])  # as a driver asks again
            hall.run(60.0)
            if not any(robot.place != goals[name] for name, robot in hall.robots.items()):
                break
        else:
            raise AssertionError(f"{ {name: robot.place for name, robot in hall.robots.items()} } are not where they wanted to go: {goals}")
