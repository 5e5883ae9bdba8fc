"""Plays a story: a whole system on virtual time, and what happens to it, at the moments that the story says."""

from __future__ import annotations

import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from msgspec import structs

from somrs.kernel.component import Component, Input
from somrs.kernel.replica import Replica
from somrs.ontology.objects import Map
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.registry.component import SCHEMA as REGISTRY
from somrs.registry.component import Registry
from somrs.repository.component import SCHEMA as REPOSITORY
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.virtual import LATENCY, KillPoint, Work, World
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.state import ServiceManagerState
from somrs.service_manager.participant.timers import DepartureRequested as LeaveNow
from somrs.service_manager.sdk.orders import Capability, Profile
from somrs.task_manager.manager import SCHEMA, TaskManager
from verification.fault_runs.client import Client
from verification.fault_runs.hands import DeviceManager, Hands, Labour, Saw
from verification.fault_runs.likeness import difference
from verification.fault_runs.properties import Property, Violation, Witness
from verification.fault_runs.site import map_of, ontology, service_type
from verification.fault_runs.story import AT_WORK, Act, Character, Cut, Kill, Leave, Misdeed, Move, Sight, Story, Undo, Weather
from verification.fault_runs.truth import Reality

LONG = 4 * 3600.0
"""Seconds after the last fault has healed, in which every task has to be over and everyone home."""

AFTERWARDS = 60.0
"""Seconds in which nothing may happen any more."""

MOST_EVENTS = 100_000
"""So many inputs are more than any of these stories needs."""


class Parts:
    """How the components are made; tests put worse ones in their places."""

    def task_manager(self, address: str) -> TaskManager:
        return TaskManager(address, repository="repository", registry="registry")

    device_manager = DeviceManager

    def service_manager(self, profile: Profile, hands: Hands, saw: Saw) -> DeviceManager:
        return self.device_manager(profile, repository="repository", registry="registry").given(hands, saw)

    def service_manager_again(self, state: ServiceManagerState, hands: Hands, saw: Saw) -> DeviceManager:
        return self.device_manager.restored(state).given(hands, saw)

    def revive(self, world: World, address: str) -> None:
        world.revive(address)


class Stage:
    """One run. `play` raises Violation when something does not hold."""

    def __init__(self, story: Story, parts: Parts | None = None) -> None:
        self.story, self.parts = story, parts or Parts()
        self.world = World(medium=self._medium, watch=self._watch, restored=self._restored)
        self.start = self.world.now
        self.reality = Reality.of(story)
        self.hands: dict[str, Hands] = {}
        self.gone: set[str] = set()
        """Devices that never come back."""
        self.log: list[tuple[float, str]] = []
        """What happened to the system."""
        self.events = 0
        self._tries: Counter[str] = Counter()
        self._works: Counter[str | None] = Counter()
        self._targets: dict[Kill | Cut, str] = {}
        self._weather: list[Weather] = []
        self._cuts: Counter[str] = Counter()
        self._doomed: dict[str, Component] = {}
        self._fallen: dict[str, Component] = {}
        self._ears: list[Callable[[float, Input], None]] = []
        self.client = Client(story.wishes)
        self.witness = Witness(self)
        self.managers = [f"tm{number}" for number in range(1, story.managers + 1)]
        self.world.add("repository", self._repository(), journaled=REPOSITORY)
        self.world.add("registry", self._registry(), journaled=REGISTRY)
        self.world.add("client", self.client)
        self._scenes: list[tuple[float, Callable[[], None]]] = []
        for character in story.devices:
            if character.joins:
                self._at(character.joins, partial(self._join, character))
            else:
                self._join(character)
        for address in self.managers:
            manager = self.parts.task_manager(address)
            schema = structs.replace(SCHEMA, restore=type(manager).restored)
            self.world.add(address, manager, partial(self._plan, address), journaled=schema)

    # What is there

    def _registry(self) -> Registry:
        return Registry("registry", ontology(), "repository")

    def _repository(self) -> Repository:
        return Repository("repository", Contents(ontology=ontology(), map=map_of(self.story)))

    def _join(self, character: Character) -> None:
        misdeeds = partial(self._misdeed, character.name)
        hands = Hands(character, self.reality, misdeeds, lambda: self.world.now, self._began, self._break)
        self.hands[character.address] = hands
        schema = structs.replace(SERVICE_MANAGER, restore=lambda state: self.parts.service_manager_again(state, hands, self.witness.saw))
        self.world.add(character.address, self._device(character), hands.carry_out, journaled=schema)

    def _device(self, character: Character) -> ServiceManager:
        return self.parts.service_manager(profile(character), self.hands[character.address], self.witness.saw)

    def task_manager(self, address: str) -> TaskManager | None:
        """None when it is down."""
        component = self.world.components.get(address)
        return component if isinstance(component, TaskManager) else None

    @property
    def contents(self) -> Contents | None:
        repository = self.world.components.get("repository")
        return repository.contents if isinstance(repository, Repository) else None

    @property
    def working(self) -> list[tuple[Hands, Labour]]:
        """What devices really do now."""
        self.reap()
        return [(hands, labour) for hands in self.hands.values() for labour in hands.labours.values()]

    # What happens

    def play(self) -> None:
        """Everything, to the end."""
        try:
            self._play()
        except Violation:
            raise
        except Exception as error:  # whatever a component runs into is what is looked for here
            where = traceback.extract_tb(error.__traceback__)[-1]
            text = f"{type(error).__name__} in {where.name} (line {where.lineno} of {where.filename.rpartition('/')[2]}): {error}"
            raise Violation(Property.BREAKS, text) from error

    def _play(self) -> None:
        for number, wish in enumerate(self.story.wishes):
            self._at(wish.at, partial(self.world.fire_timer, "client", f"submit {number}"))
        for fault in self.story.faults:
            self._stage(fault)
        for at, scene in sorted(self._scenes, key=lambda scene: scene[0]):
            self._run(self.start + at - self.world.now)
            scene()
        self.reap()
        if not self._run(LONG, self.witness.settled):
            raise Violation(Property.HOME, f"{LONG / 3600:.0f} hours after the last fault: {self.witness.unsettled()}")
        self._run(AFTERWARDS)
        self.witness.finish()

    def hears(self, ear: Callable[[float, Input], None]) -> None:
        """Tell it every input that is handled, and when."""
        self._ears.append(ear)

    def _run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        return self.world.run(seconds, until)

    def _at(self, at: float, scene: Callable[[], None]) -> None:
        self._scenes.append((at, scene))

    def _stage(self, fault: object) -> None:
        match fault:
            case Kill(at=at, seconds=seconds):
                self._at(at, partial(self._kill, fault))
                if seconds is not None:
                    self._at(at + seconds, partial(self._revive, fault))
            case Cut(at=at, seconds=seconds):
                self._at(at, partial(self._cut, fault))
                self._at(at + seconds, partial(self._reconnect, fault))
            case Weather(at=at, seconds=seconds):
                self._at(at, partial(self._weather.append, fault))
                self._at(at + seconds, partial(self._weather.remove, fault))
            case Move(at=at):
                self._at(at, partial(self._move, fault))
            case Sight(at=at, object=object):
                self._at(at, partial(self._see, object))
            case Leave(at=at, device=device):
                self._at(at, partial(self._leave, f"devices/{device}"))

    def _misdeed(self, device: str) -> Act | None:
        """What goes wrong in the device's next work."""
        counts = {None: self._works[None], device: self._works[device]}
        self._works.update((None, device))
        found = [f for f in self.story.faults if isinstance(f, Misdeed) and counts.get(f.device) == f.nth]
        if not found:
            return None
        self._note(f"{device} {found[0].act}")
        return found[0].act

    def _target(self, target: str) -> str:
        if target != AT_WORK:
            return target
        return next((hands.character.address for hands, _ in self.working), "")

    def _note(self, text: str) -> None:
        self.log.append((self.world.now, text))

    def _kill(self, kill: Kill) -> None:
        address = self._targets[kill] = self._target(kill.target)
        if not self.world.alive(address) or address in self._doomed:
            return
        if kill.snapshot:
            self.world.snapshot(address)
        self._note(f"{address} is killed {kill.moment}{f' ({kill.effects})' if kill.moment is KillPoint.AMID else ''}")
        self._doomed[address] = self.world.components[address]
        self.world.kill(address, kill.moment, kill.effects)
        if kill.seconds is None:
            self.gone.add(address)
        self.reap()

    def _break(self, character: Character) -> None:
        self._note(f"{character.name} breaks without a word")
        self._doomed[character.address] = self.world.components[character.address]
        self.world.kill(character.address)
        self.gone.add(character.address)
        self.reap()

    def reap(self) -> None:
        """See to those that are dead by now."""
        for address in [address for address in self._doomed if not self.world.alive(address)]:
            self._note(f"{address} is dead")
            self._fallen[address] = self._doomed.pop(address)
            if address in self.hands:
                self.hands[address].died()

    def _revive(self, kill: Kill) -> None:
        address = self._targets[kill]
        self.reap()
        if address in self._doomed:
            self.world.remove(address)
            self.reap()
        if self.world.alive(address) or address not in self._fallen or address in self.gone:
            return
        self._note(f"{address} is started again")
        self.parts.revive(self.world, address)
        self.reap()

    def _restored(self, address: str, after: Component) -> None:
        self._same(address, self._fallen.pop(address), after)

    def _same(self, address: str, before: Component, after: Component) -> None:
        """FRP, property 7."""
        different: str | None = None
        match before, after:
            case TaskManager(), TaskManager():
                different = difference(before.state, after.state, leave_out=(Replica,))
                if different is None and _copy(before) != _copy(after):
                    different = "the copies of the map"
            case Registry(), Registry():
                different = difference(before.state, after.state, leave_out=(Replica,))
            case Repository(), Repository():
                different = difference(before.state, after.state)
            case DeviceManager(), DeviceManager():
                different = difference(before.state, after.state)
        if different is not None:
            raise Violation(Property.RESTART, f"{address} was started again, and is not what it was: {different}")

    def _cut(self, cut: Cut) -> None:
        target = self._targets[cut] = self._target(cut.target)
        if not target:
            return
        self._note(f"{target} cannot be reached")
        self._cuts[target] += 1
        self.world.cut_off(target)

    def _reconnect(self, cut: Cut) -> None:
        target = self._targets[cut]
        self._cuts[target] -= 1
        if target and not self._cuts[target]:
            self._note(f"{target} can be reached again")
            self.world.reconnect(target)

    def _move(self, move: Move) -> None:
        self._note(f"a person puts {move.thing} on {move.place}{', and says so' if move.told else ''}")
        self.reality.put(move.thing, ("isOn", move.place), self.world.now, None, "a person")
        self.reality.doubtful.add(move.thing)
        if move.told:
            self._tell("a person", f"{move.thing} isOn {move.place}")

    def _see(self, object: str) -> None:
        self.reality.doubtful.add(object)  # what is seen while it moves may be on the map after where it came to rest
        self._tell("a camera", self.reality.said(object))

    def _tell(self, who: str, situation: str) -> None:
        self._note(f"{who} tells: {situation}")
        header = Header(sender="client", recipient="repository", message_id=message_id(who, self.world.now, situation), reply_to="client")
        self.world.send(Message(header=header, body=UpdateMap(situation=situation, author=who)))

    def _leave(self, address: str) -> None:
        if self.world.alive(address):
            self._note(f"{address} takes its leave")
            self.world.notify(address, LeaveNow())

    # What the world asks

    def _medium(self, message: Message) -> Sequence[float]:
        """The same message meets the same weather whatever else there is in the story, so that it can be made shorter."""
        if not self._weather:
            return (LATENCY,)
        weather, id = self._weather[-1], message.header.message_id
        self._tries[id] += 1
        dice = zlib.crc32(f"{self.story.seed} {id} {self._tries[id]}".encode())
        if (dice & 0xFF) / 256 < weather.lost:
            return ()
        late = LATENCY + (dice >> 16 & 0xFF) / 256 * weather.late
        return (late, LATENCY + (dice >> 24) / 256 * weather.late * 2) if (dice >> 8 & 0xFF) / 256 < weather.twice else (late,)

    def _watch(self, address: str, event: Input) -> None:
        self.events += 1
        if self.events > MOST_EVENTS:
            raise Violation(Property.HOME, f"more than {MOST_EVENTS} inputs, and no end of it")
        if self._doomed:
            self.reap()
        for hear in self._ears:
            hear(self.world.now, event)
        self.witness.watch(address, event)

    def _began(self, hands: Hands, labour: Labour) -> None:
        self.witness.began(hands, labour)

    def _plan(self, address: str, task: object) -> Work:
        assert isinstance(task, Problem), "a Task Manager has nothing but plans made here"
        self.witness.planning(address, task)
        yield self.story.planning, plan(task)


def profile(character: Character) -> Profile:
    """What the Service Manager knows of the device."""
    undoable = character.undo is not Undo.NO
    undoable = character.undo is not Undo.NO
    capabilities = tuple(Capability(type=service_type(name), method=name, stoppable=True, undoable=undoable) for name in character.services)
    return Profile(name=character.name, type="PioneerP3DX", capabilities=capabilities, valid_for=character.valid_for, lease=character.lease)


def _copy(manager: TaskManager) -> tuple[int, Map]:
    """What a Task Manager knows of the map."""
    return manager.state.replica.version, manager.state.replica.map
