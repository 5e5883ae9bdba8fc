"""Robots read a roadmap of many pages while it changes: what they go by is always one edition, whole."""

from __future__ import annotations

import heapq
from itertools import count, pairwise
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from somrs.kernel.component import Answered, Ask, DeliveryFailed, Effect, Input, Notified, Received, Send, SetTimer, Started, TimerFired
from somrs.protocol.messages.envelope import Message
from somrs.protocol.messages.traffic import RoadmapPage
from somrs.traffic.component import Traffic
from somrs.traffic.notices import CloseWays, RoadmapMade
from somrs.traffic.roadmap import Lane, Place, Roadmap
from somrs.traffic.robot_program import RobotProgram
from somrs.traffic.robot_tasks import Astray, Locate, Standing

RADII = (0.2, 0.3, 0.45)


def roadmap(kinds: int, length: int) -> Roadmap:
    """Places in a row for robots of so many radii, numbered through, as in a building with several kinds of robots."""
    places, lanes = list[Place](), list[Lane]()
    for kind, radius in enumerate(RADII[:kinds]):
        row = [Place(name=f"P{kind}/{number}", x=2.0 * number, y=10.0 * kind, radius=radius) for number in range(length + 30 * kind)]
        places += row
        lanes += (Lane(start=a.name, end=b.name, seconds=2.0) for one, two in pairwise(row) for a, b in ((one, two), (two, one)))
    return Roadmap(places=tuple(places), lanes=tuple(lanes))


class Office:
    """Traffic, and the programs of robots that read its roadmap. `longest`: how long a message takes at most, s."""

    def __init__(self, robots: int, *, seed: int = 0, longest: float = 0.2, loss: float = 0.0) -> None:
        self.now, self._random, self._longest, self._loss, self._numbers = 100.0, Random(seed), longest, loss, count()
        self._roadmap = roadmap(1, 230)
        self.traffic = Traffic("traffic", self._roadmap)
        self.editions = {self.traffic.state.edition: self._roadmap}
        self.programs = {
            f"Robot{number}": RobotProgram(f"Robot{number}", f"Robot{number}", "traffic", f"life{number}") for number in range(robots)
        }
        self.located: dict[str, int] = {}
        """The edition by which each robot was located last."""
        self.pages = 0
        """How many pages were sent."""
        self._due: list[tuple[float, int, str, Input]] = []
        self._timers: dict[tuple[str, object], float] = {}
        for name in ("traffic", *self.programs):
            self._handle(name, Started(name))

    def _handle(self, name: str, event: Input) -> None:
        component = self.traffic if name == "traffic" else self.programs[name]
        for effect in component.handle(event, self.now):
            self._perform(name, effect)

    def _perform(self, name: str, effect: Effect) -> None:
        match effect:
            case Send(message=message):
                self._deliver(name, message)
            case SetTimer(timer, due):
                self._timers.pop((name, timer), None)
                if due is not None:
                    self._timers[name, timer] = due
            case Ask(question=question, task=Locate(roadmap=read)):
                names = [place.name for place in read.places]
                assert names == [place.name for place in self.editions[read.edition].places], "what was read is no edition"
                self.located[name] = read.edition
                self._later(name, Answered(question, Standing(place=names[10 * int(name.removeprefix("Robot"))])))
            case _:
                pass

    def _deliver(self, sender: str, message: Message) -> None:
        self.pages += isinstance(message.body, RoadmapPage)
        if self._random.random() >= self._loss:
            self._later(message.header.recipient, Received(message))
        else:
            self._later(sender, DeliveryFailed(message, "lost"))

    def _later(self, name: str, event: Input) -> None:
        heapq.heappush(self._due, (self.now + self._random.uniform(0.01, self._longest), next(self._numbers), name, event))

    def use(self, changed: Roadmap) -> None:
        """Robots of another radius have joined."""
        self._handle("traffic", Notified(RoadmapMade(roadmap=changed, closing=CloseWays())))
        self.editions[self.traffic.state.edition] = changed

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while True:
            timers = [(due, name, timer) for (name, timer), due in self._timers.items()]
            timer_due = min(timers, key=lambda entry: entry[0], default=None)
            message_due = self._due[0][0] if self._due else end
            if timer_due is not None and timer_due[0] < min(message_due, end):
                self.now = max(self.now, timer_due[0])
                del self._timers[timer_due[1], timer_due[2]]
                self._handle(timer_due[1], TimerFired(timer_due[2]))
            elif message_due < end:
                self.now, _, name, event = heapq.heappop(self._due)
                self._handle(name, event)
            else:
                self.now = end
                return

    def astray(self, name: str) -> None:
        self._handle(name, Notified(Astray()))


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**20),
    longest=st.sampled_from((0.5, 3.0, 8.0)),
    loss=st.sampled_from((0.0, 0.1)),
    changes=st.lists(st.tuples(st.floats(0.1, 20.0), st.integers(1, 3), st.booleans()), max_size=4),
)
def test_what_robots_go_by_is_one_whole_edition_whatever_changes_while_they_read(
    seed: int, longest: float, loss: float, changes: list[tuple[float, int, bool]]
) -> None:
    """Seen in a hotel whose roadmap grew while robots of several sizes joined: pages of two readings were mixed, for ever."""
    office = Office(6, seed=seed, longest=longest, loss=loss)
    for pause, kinds, is_astray in changes:
        office.run(pause)
        office.use(roadmap(kinds, 230))
        if is_astray:
            office.astray("Robot0")
    office.run(600.0)
    assert office.located == dict.fromkeys(office.programs, office.traffic.state.edition)
    assert office.traffic.state.robots.keys() == office.programs.keys()


def test_slow_pages_are_read_once() -> None:
    """A roadmap whose pages take long is not read from the beginning again and again: on a loaded machine, nobody would ever be done."""
    office = Office(3, longest=6.0)
    office.use(roadmap(3, 230))
    office.run(300.0)
    assert office.traffic.state.robots.keys() == office.programs.keys()
    assert office.pages <= 3 * 8


@pytest.mark.parametrize("pause", [1.0, 3.0, 5.0])
def test_a_robot_that_is_astray_while_it_reads_waits_for_the_rest(pause: float) -> None:
    office = Office(1, longest=4.0)
    office.run(pause)
    office.astray("Robot0")
    office.run(100.0)
    assert "Robot0" in office.traffic.state.robots
