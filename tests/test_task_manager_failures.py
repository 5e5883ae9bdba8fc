"""Whatever robots, people and the network do, on virtual time: what must hold in every run of the Task Manager.

The properties are those of the Failure Recovery Protocol (no double hands, no work without a contract, everyone goes home, the
map tells the truth, no orphan), seen from outside: on the messages, on the real Service Managers, and on the Repository's map.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import cycle

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from somrs.app.virtual import Medium, Work
from somrs.entish.parse import parse
from somrs.ontology.objects import Map
from somrs.ontology.truth import holds
from somrs.protocol import frp
from somrs.protocol.clients import CancelTask, Phase, TaskNews, WatchTask
from somrs.protocol.component import Input, Received
from somrs.protocol.envelope import Header, Message, message_id
from somrs.protocol.frp import Outcome
from somrs.protocol.knowledge import UpdateMap
from somrs.protocol.session import service_of
from somrs.protocol.states import WORKING
from somrs.service_manager.orders import Advance, Done, Order, ServiceFailed
from somrs.service_manager.participant import LEAVE
from virtual_system import Robot, VirtualSystem, done

WISHES = (
    "Jar002 isOn Platform001",
    "Jar002 isOn Cupboard002",
    "Jar001 isOn Platform001",
    "Jar001 isOn Platform001 AND Jar002 isOn Platform001",
    "Jar001 isOn Platform001 AND Jar002 isOn Cupboard002 AND Tin001 isOn Platform001",
    "Jar001 isOn Cupboard001 AND Jar002 isOn Platform001 AND Tin001 isOn Cupboard002",
)
JARS = ("Jar001", "Jar002", "Tin001")
LONG = 4 * 3600.0
"""Seconds after which every task has to be over, whatever happened."""


class Act(StrEnum):
    """What a robot does about an order."""

    DO = "does it"
    DO_SLOWLY = "takes ten times as long as it said"
    CARRY = "tells of the jar on its way"
    DROP = "fails, and says where the jar is"
    FAIL = "fails, and says nothing"
    BREAK = "runs into an error of its program"
    LIE = "says it is done, and that the jar is somewhere else"
    RAVE = "says it is done, and what the map cannot hold"


def acting(acts: Sequence[Act], name: str, duration: float) -> Callable[[Order], Work]:
    turns = cycle(acts)

    def works(order: Order) -> Work:
        jar = order.inputs["Object"]
        match next(turns):
            case Act.DO:
                yield duration, Done(situation=done(order))
            case Act.DO_SLOWLY:
                yield duration * 10, Done(situation=done(order))
            case Act.CARRY:
                yield duration / 2, Advance(fraction=0.5, situation=f"{jar} isHeldBy {name}")
                yield duration / 2, Done(situation=done(order))
            case Act.DROP:
                yield duration / 2, Advance(fraction=0.5, situation=f"{jar} isHeldBy {name}")
                yield 0.1, ServiceFailed("it slipped", f"{jar} isOn Floor001")
            case Act.FAIL:
                yield duration / 2, ServiceFailed("the gripper is stuck", None)
            case Act.BREAK:
                yield duration / 2, ZeroDivisionError("division by zero")
            case Act.LIE:
                yield duration, Done(situation=f"{jar} isOn Cupboard001")
            case Act.RAVE:
                yield duration, Done(situation=f"{jar} isOn Nowhere")

    return works


@dataclass(frozen=True)
class Character:
    """A robot as it is drawn."""

    price: int
    duration: float
    acts: tuple[Act, ...]
    refuses: bool
    mute: bool
    valid_for: float
    halts: float

    def robot(self, name: str) -> Robot:
        return Robot(
            name,
            self.price,
            self.duration,
            acting(self.acts, name, self.duration),
            refuses="it is too heavy for me" if self.refuses else "",
            mute=self.mute,
            valid_for=self.valid_for,
            halts=self.halts,
        )


@dataclass(frozen=True)
class Wish:
    at: float
    effect: str
    deadline: float | None


class Blow(StrEnum):
    """What happens to the system."""

    CANCEL = "a client cancels a task"
    REMOVE = "a robot is gone without a word"
    LEAVE = "a robot takes its leave"
    RESTART = "a robot's Service Manager comes up again"
    CUT_OFF = "a robot cannot be reached for a while, and goes on"
    JOIN = "another robot comes"
    TAKE = "a person takes a jar away for a while"
    NO_REPOSITORY = "the Repository cannot be reached for a while"
    NO_REGISTRY = "the Registry cannot be reached for a while"


@dataclass(frozen=True)
class Happening:
    at: float
    blow: Blow
    target: int
    seconds: float


@dataclass(frozen=True)
class Story:
    robots: tuple[Character, ...]
    newcomers: tuple[Character, ...]
    wishes: tuple[Wish, ...]
    happenings: tuple[Happening, ...]
    jitter: float
    planning: float
    seed: int


times = st.one_of(st.floats(0, 120), st.floats(0, 30)).map(lambda seconds: round(seconds, 1))
characters = st.builds(
    Character,
    price=st.integers(1, 9),
    duration=st.sampled_from((4.0, 20.0, 45.0)),
    acts=st.lists(st.sampled_from((*Act, *[Act.DO, Act.CARRY, Act.DROP] * 2)), min_size=1, max_size=4).map(tuple),
    refuses=st.sampled_from((*[False] * 6, True)),
    mute=st.sampled_from((*[False] * 6, True)),
    valid_for=st.sampled_from((60.0, 60.0, 60.0, 5.0, 0.5)),
    halts=st.sampled_from((0.5, 5.0, 100.0)),
)
stories = st.builds(
    Story,
    robots=st.integers(1, 3).flatmap(lambda count: st.lists(characters, min_size=count, max_size=count)).map(tuple),
    newcomers=st.lists(characters, max_size=1).map(tuple),
    wishes=st.lists(
        st.builds(Wish, at=st.floats(0, 40), effect=st.sampled_from(WISHES), deadline=st.sampled_from((None, None, None, 15.0, 300.0))),
        min_size=1,
        max_size=4,
    ).map(tuple),
    happenings=st.lists(
        st.builds(
            Happening, at=times, blow=st.sampled_from(Blow), target=st.integers(0, 3), seconds=st.sampled_from((3.0, 17.0, 35.0, 150.0))
        ),
        max_size=3,
    ).map(tuple),
    jitter=st.sampled_from((0.0, 0.3, 2.0, 2.0)),
    planning=st.sampled_from((0.0, 2.0, 20.0)),
    seed=st.integers(0, 2**32),
)


def shaky(story: Story) -> Medium:
    """Messages overtake each other, and some come twice."""
    dice = random.Random(story.seed)

    def medium(message: Message) -> Sequence[float]:
        times = (0.001 + dice.random() * story.jitter, 0.001 + dice.random() * story.jitter * 3)
        return times if story.jitter and dice.random() < 0.2 else times[:1]

    return medium


@dataclass
class Witness:
    """Sees each input and what came of it, and checks what must hold at all times."""

    system: VirtualSystem | None = None
    said: int = 0
    planned: int = 0
    maps: dict[int, Map] = field(default_factory=dict)
    outcomes: dict[str, tuple[Outcome, float | None]] = field(default_factory=dict)
    """How each task ended, and when."""
    accepted: set[tuple[str, str]] = field(default_factory=set)
    released: set[tuple[str, str]] = field(default_factory=set)
    hands: dict[tuple[str, str], set[str]] = field(default_factory=dict)
    """Who was told to execute what, by transaction and inputs."""
    known: set[str] = field(default_factory=set)
    unsaid: dict[str, dict[str, tuple[str, str]]] = field(default_factory=dict)
    """What was reported in each transaction and has not come to the Repository yet: service and situation."""

    def __call__(self, address: str, event: Input) -> None:
        if self.system is None:
            return
        contents = self.system.repository.contents
        self.maps[contents.version] = contents.map
        if isinstance(event, Received):
            self._received(self.system, address, event.message)
        new, self.said = self.system.world.messages[self.said :], len(self.system.world.messages)
        for message in new:
            self._sent(message)
        self._plans(self.system)
        if address == "tm":
            self._ends(self.system)
        self._no_double_hands(self.system)

    def _received(self, system: VirtualSystem, address: str, message: Message) -> None:
        body, task = message.body, message.header.transaction or ""
        if address == "repository" and isinstance(body, UpdateMap):
            for reports in self.unsaid.values():
                for id in [id for id, report in reports.items() if report == (body.author, body.situation)]:
                    del reports[id]
        elif address == "tm" and isinstance(body, frp.Refuse):
            self.released.add((task, message.header.participant or ""))  # its terms had run out before the Accept came
        elif address == "tm" and isinstance(body, frp.Completed | frp.Failed | frp.Stopped) and body.situation:
            id, participant = message.header.message_id, message.header.participant or ""
            if id not in self.known and task not in self.outcomes and (task, participant) not in self.released:
                self.unsaid.setdefault(task, {})[id] = service_of(participant), body.situation
            self.known.add(id)

    def _sent(self, message: Message) -> None:
        task, participant = message.header.transaction or "", message.header.participant or ""
        match message.body:
            case frp.Arrange():
                assert not self.unsaid.get(task), "arranged before the Repository knew what was reported"
            case frp.Accept():
                self.accepted.add((task, participant))
            case frp.Execute(inputs=inputs):
                assert (task, participant) in self.accepted, "told to execute without a contract"
                self.hands.setdefault((task, str(sorted(inputs.items()))), set()).add(participant)
            case frp.End() | frp.Cancel():
                self.released.add((task, participant))

    def _plans(self, system: VirtualSystem) -> None:
        for problem in system.problems[self.planned :]:
            candidates = [
                t.id for t in system.manager.transactions.values() if t.phase is Phase.PLANNING and t.task.effect == str(problem.goal)
            ]
            assert not candidates or any(not self.unsaid.get(task) for task in candidates), "planned before the Repository knew"
        self.planned = len(system.problems)

    def _ends(self, system: VirtualSystem) -> None:
        for task in system.manager.transactions.values():
            if task.id in self.outcomes:
                assert task.phase is Phase.ENDED, "went on after its end"
                assert (task.outcome, task.ended_at) == self.outcomes[task.id], "ended twice"
            elif task.outcome is not None:
                self.outcomes[task.id] = task.outcome, task.ended_at
                seen = self.maps[system.manager.replica.version]
                if task.outcome is Outcome.ACCOMPLISHED:
                    assert holds(parse(task.task.effect), seen, system.repository.contents.ontology), "accomplished, but not so"
                else:
                    assert task.explanation

    def _no_double_hands(self, system: VirtualSystem) -> None:
        for (task, _), participants in self.hands.items():
            if len(participants) > 1:
                busy = [p for p in participants if system.devices[service_of(p).partition(".")[0]].state(task, p) in WORKING]
                assert len(busy) <= 1, f"{busy} do the same"


class Stage:
    """Plays a story."""

    def __init__(self, story: Story) -> None:
        self.witness = Witness()
        self.robots = [character.robot(f"Robot{number}") for number, character in enumerate(story.robots, 1)]
        self.newcomers = [character.robot(f"Robot{number}") for number, character in enumerate(story.newcomers, len(self.robots) + 1)]
        self.system = VirtualSystem(*self.robots, medium=shaky(story), watch=self.witness, settle=60, planning=story.planning)
        self.witness.system = self.system
        self.witness.maps[self.system.repository.contents.version] = self.system.map
        self.tasks: list[str] = []
        self.watching: list[str] = []
        self.gone: set[str] = set()
        self.story = story

    def play(self) -> None:
        start, world = self.system.world.now, self.system.world
        scenes: list[tuple[float, Callable[[], None]]] = [(wish.at, lambda wish=wish: self.wish(wish)) for wish in self.story.wishes]  # type: ignore[misc]
        for one in self.story.happenings:
            scenes.append((one.at, lambda one=one: self.strike(one)))  # type: ignore[misc]
            scenes.append((one.at + one.seconds, lambda one=one: self.mend(one)))  # type: ignore[misc]
        for at, scene in sorted(scenes, key=lambda scene: scene[0]):
            world.run(start + at - world.now)
            scene()
        assert world.run(LONG, lambda: all(self.system.view(task).outcome is not None for task in self.tasks)), [
            self.system.manager.transactions[task].events for task in self.tasks if self.system.view(task).outcome is None
        ]
        world.run(300)

    def wish(self, wish: Wish) -> None:
        task = self.system.submit(wish.effect, deadline=wish.deadline)
        self.tasks.append(task)
        id = message_id("watch", len(self.watching))
        self.watching.append(id)
        header = Header(sender="client", recipient="tm", message_id=id, reply_to="client")
        self.system.world.send(Message(header=header, body=WatchTask(task=task, after=10_000, wait=20_000)))

    def update(self, situation: str) -> None:
        id = message_id("person", self.system.world.now, situation)
        header = Header(sender="client", recipient="repository", message_id=id, reply_to="client")
        self.system.world.send(Message(header=header, body=UpdateMap(situation=situation, author="a person")))

    def strike(self, one: Happening) -> None:
        system, robot = self.system, self.robots[one.target % len(self.robots)]
        address = f"devices/{robot.name}"
        match one.blow:
            case Blow.CANCEL if self.tasks:
                system.ask(CancelTask(task=self.tasks[one.target % len(self.tasks)]))
            case Blow.REMOVE:
                system.world.remove(address)
                self.gone.add(robot.name)
            case Blow.LEAVE if robot.name not in self.gone:
                system.world.ring(address, LEAVE)
            case Blow.RESTART if robot.name not in self.gone:
                system.restart(robot)
            case Blow.CUT_OFF:
                system.world.cut_off(address)
            case Blow.JOIN if self.newcomers:
                self.robots.append(self.newcomers.pop())
                system.join(self.robots[-1])
            case Blow.TAKE:
                self.update(f"{JARS[one.target % len(JARS)]} isHeldBy Robot1")
            case Blow.NO_REPOSITORY:
                system.world.cut_off("repository")
            case Blow.NO_REGISTRY:
                system.world.cut_off("registry")

    def mend(self, one: Happening) -> None:
        match one.blow:
            case Blow.CUT_OFF:
                self.system.world.reconnect(f"devices/{self.robots[one.target % len(self.robots)].name}")
            case Blow.TAKE:
                self.update(f"{JARS[one.target % len(JARS)]} isOn Cupboard002")
            case Blow.NO_REPOSITORY:
                self.system.world.reconnect("repository")
            case Blow.NO_REGISTRY:
                self.system.world.reconnect("registry")

    def everyone_went_home(self) -> None:
        now = self.system.world.now
        assert self.witness.accepted <= self.witness.released, "no orphan"
        for name, device in self.system.devices.items():
            if name not in self.gone:
                assert device.idle, f"{name} still works"
                assert not device.calendar(now), f"{name} still waits"
        assert self.system.world.timers("tm") == {"replica"}
        answered = {m.header.relates_to for m in self.system.client.heard if isinstance(m.body, TaskNews)}
        assert answered >= set(self.watching)
        assert not [m for m in self.system.world.messages if m.header.sender == "tm" and isinstance(m.body, frp.Fault)]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(stories)
def test_whatever_happens_every_task_ends_and_everyone_goes_home(story: Story) -> None:
    stage = Stage(story)
    stage.play()
    stage.everyone_went_home()
