"""Plays a scenario: runs a whole system on virtual time, and injects the scenario's faults at their times."""

from __future__ import annotations

import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial

from msgspec import structs

from somrs.kernel.component import Component, Input, Received, Send
from somrs.kernel.following import LEASE
from somrs.kernel.offers import Offers
from somrs.kernel.replica import Replica
from somrs.ontology.map import Map
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.registry.component import SCHEMA as REGISTRY
from somrs.registry.component import Registry
from somrs.registry.neighbours import Neighbour
from somrs.registry.selection import Selection
from somrs.repository.component import SCHEMA as REPOSITORY
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.virtual_network import LATENCY
from somrs.runtime.virtual_time import KillPoint, Work, World
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.state import ServiceManagerState
from somrs.service_manager.participant.timers import DepartureRequested as LeaveNow
from somrs.service_manager.sdk.orders import Capability, Profile
from somrs.task_manager.manager import SCHEMA, TaskManager
from verification.fault_runs.bystanders import Bystanders
from verification.fault_runs.client import Client
from verification.fault_runs.ground_truth import Reality
from verification.fault_runs.properties import Witness
from verification.fault_runs.scenario import (
    AT_WORK,
    Cut,
    Departure,
    DeviceTraits,
    Disturbance,
    Kill,
    Loss,
    Move,
    Scenario,
    Sight,
    Slam,
    Survey,
    Undo,
    WorkFault,
    WorkFaultKind,
    registry_addresses,
)
from verification.fault_runs.simulated_device import DeviceManager, DeviceWork, InputObserver, SimulatedDevice
from verification.fault_runs.site import map_of, ontology, service_type
from verification.fault_runs.state_diff import difference
from verification.fault_runs.violation import Property, Violation

LONG = 4 * 3600.0
"""Seconds after the last fault has healed within which every task has to end and every participant has to be released."""

AFTERWARDS = 60.0
"""Seconds after the end in which there may be no activity."""

MAX_EVENTS = 100_000
"""The limit on the inputs of a run; no scenario needs as many."""


class ComponentFactory:
    """Makes the components of a run. Tests override it to introduce defects."""

    def task_manager(self, address: str) -> TaskManager:
        return TaskManager(address, repository="repository", registry="registry")

    device_manager = DeviceManager

    def service_manager(self, profile: Profile, simulated_device: SimulatedDevice, observe_input: InputObserver) -> DeviceManager:
        return self.device_manager(profile, repository="repository", registry="registry").attach(simulated_device, observe_input)

    def restore_service_manager(
        self, state: ServiceManagerState, simulated_device: SimulatedDevice, observe_input: InputObserver
    ) -> DeviceManager:
        return self.device_manager.restored(state).attach(simulated_device, observe_input)

    def revive(self, world: World, address: str) -> None:
        world.revive(address)


class ScenarioRun:
    """One run of a scenario. `play` raises Violation when a property does not hold."""

    def __init__(self, scenario: Scenario, factory: ComponentFactory | None = None) -> None:
        self.scenario, self.factory = scenario, factory or ComponentFactory()
        self.world = World(medium=self._medium, watch=self._watch, restored=self._restored)
        self.start = self.world.now
        self.reality = Reality.from_scenario(scenario)
        self.simulated_devices: dict[str, SimulatedDevice] = {}
        self.lost_devices: set[str] = set()
        """Devices that never restart."""
        self.restart_times: dict[str, float] = {}
        """When each component was last restarted."""
        self.log: list[tuple[float, str]] = []
        """The faults and other events of the run."""
        self.events = 0
        self._tries: Counter[str] = Counter()
        self._work_counts: Counter[str | None] = Counter()
        self._targets: dict[Kill | Cut, str] = {}
        self._disturbances: list[Disturbance] = []
        self._cuts: Counter[str] = Counter()
        self._doomed: dict[str, Component] = {}
        self._fallen: dict[str, Component] = {}
        self._listeners: list[Callable[[float, Input], None]] = []
        self.client = Client(scenario.requests)
        self.witness = Witness(self)
        self._bystanders = Bystanders(self)
        self.managers = [f"tm{number}" for number in range(1, scenario.managers + 1)]
        self.world.add("repository", self._repository(), journaled=REPOSITORY)
        self.registries = registry_addresses(scenario.registries)
        for address in self.registries:
            self.world.add(address, self._registry(address), journaled=REGISTRY)
        self.world.add("client", self.client)
        self._scheduled: list[tuple[float, Callable[[], None]]] = []
        for traits in scenario.devices:
            if traits.joins:
                self._schedule(traits.joins, partial(self._join, traits))
            else:
                self._join(traits)
        for number, address in enumerate(self.managers):
            manager = self.factory.task_manager(address)
            manager.state.requests.registry = self._registry_of(number)
            schema = structs.replace(SCHEMA, restore=type(manager).restored)
            self.world.add(address, manager, partial(self._plan, address), journaled=schema)

    # Components

    def _registry(self, address: str) -> Registry:
        everything = Selection()
        neighbours = (
            Neighbour(name=other, address=other, takes=everything, gives=everything, is_of_site=True)
            for other in self.registries
            if other != address
        )
        return Registry(address, ontology(), "repository", neighbours)

    def _registry_of(self, number: int) -> str:
        """The Registry with which the Task Manager or the device with this number begins."""
        return self.registries[number % len(self.registries)]

    def _repository(self) -> Repository:
        return Repository("repository", Contents(ontology=ontology(), map=map_of(self.scenario)))

    def _join(self, traits: DeviceTraits) -> None:
        next_fault = partial(self._work_fault, traits.name)
        simulated_device = SimulatedDevice(traits, self.reality, next_fault, lambda: self.world.now, self._observe_start, self._break)
        self.simulated_devices[traits.address] = simulated_device
        schema = structs.replace(
            SERVICE_MANAGER, restore=lambda state: self.factory.restore_service_manager(state, simulated_device, self.witness.observe_input)
        )
        self.world.add(traits.address, self._device(traits), simulated_device.carry_out, journaled=schema)

    def _device(self, traits: DeviceTraits) -> ServiceManager:
        manager = self.factory.service_manager(profile(traits), self.simulated_devices[traits.address], self.witness.observe_input)
        manager.state.joining.registry = self._registry_of(self.scenario.devices.index(traits))
        return manager

    def task_manager(self, address: str) -> TaskManager | None:
        """Return the Task Manager at the address; None while it is down."""
        component = self.world.components.get(address)
        return component if isinstance(component, TaskManager) else None

    @property
    def offered_types(self) -> set[str]:
        """The service types that devices offer."""
        return {service for device in self.scenario.devices for service in device.services}

    @property
    def contents(self) -> Contents | None:
        repository = self.world.components.get("repository")
        return repository.contents if isinstance(repository, Repository) else None

    def offers_at(self, registry: str) -> Offers | None:
        """What a Registry lists; None if it is down for good. All of it fits on a page."""
        if not self.world.alive(registry):
            return None
        header = Header(sender=ANONYMOUS, recipient=registry, message_id="urn:so-mrs:all-offers")
        effects = self.world.components[registry].handle(Received(Message(header=header, body=Discover())), self.world.now)
        (page,) = (effect.message.body for effect in effects if isinstance(effect, Send))
        assert isinstance(page, Discovered)
        assert not page.more
        return Offers(page.offers)

    @property
    def working(self) -> list[tuple[SimulatedDevice, DeviceWork]]:
        """The work that devices really do now."""
        self.reap()
        return [
            (simulated_device, device_work)
            for simulated_device in self.simulated_devices.values()
            for device_work in simulated_device.current_work.values()
        ]

    # Events

    def play(self) -> None:
        """Play the scenario to its end."""
        try:
            self._play()
        except Violation:
            raise
        except Exception as error:  # any error of a component is a finding
            frame = traceback.extract_tb(error.__traceback__)[-1]
            text = f"{type(error).__name__} in {frame.name} (line {frame.lineno} of {frame.filename.rpartition('/')[2]}): {error}"
            raise Violation(Property.UNHANDLED_INPUT, text) from error

    def _play(self) -> None:
        for number, request in enumerate(self.scenario.requests):
            self._schedule(request.at, partial(self.world.fire_timer, "client", f"submit {number}"))
        for fault in self.scenario.faults:
            self._schedule_fault(fault)
        for offset, callback in sorted(self._scheduled, key=lambda entry: entry[0]):
            self._run(self.start + offset - self.world.now)
            callback()
        self.reap()
        if not self._run(LONG, self.witness.settled):
            raise Violation(Property.TERMINATION, f"{LONG / 3600:.0f} hours after the last fault: {self.witness.unsettled()}")
        self._run(AFTERWARDS if len(self.registries) == 1 else AFTERWARDS + 2 * LEASE)
        self.witness.finish()

    def add_listener(self, listener: Callable[[float, Input], None]) -> None:
        """Call the listener for every input that is handled, with its time."""
        self._listeners.append(listener)

    def _run(self, seconds: float, condition: Callable[[], bool] = lambda: False) -> bool:
        return self.world.run(seconds, condition)

    def _schedule(self, offset: float, callback: Callable[[], None]) -> None:
        self._scheduled.append((offset, callback))

    def _schedule_fault(self, fault: object) -> None:
        match fault:
            case Kill(at=offset, seconds=seconds):
                self._schedule(offset, partial(self._kill, fault))
                if seconds is not None:
                    self._schedule(offset + seconds, partial(self._revive, fault))
            case Cut(at=offset, seconds=seconds):
                self._schedule(offset, partial(self._cut, fault))
                self._schedule(offset + seconds, partial(self._reconnect, fault))
            case Disturbance(at=offset, seconds=seconds):
                self._schedule(offset, partial(self._disturbances.append, fault))
                self._schedule(offset + seconds, partial(self._disturbances.remove, fault))
            case Move(at=offset):
                self._schedule(offset, partial(self._bystanders.move, fault))
            case Slam(at=offset):
                self._schedule(offset, partial(self._bystanders.slam, fault))
            case Loss(at=offset, object=object):
                self._schedule(offset, partial(self._bystanders.report_loss, object))
            case Sight(at=offset, object=object):
                self._schedule(offset, partial(self._bystanders.report_sighting, object))
            case Survey(at=offset, place=place):
                self._schedule(offset, partial(self._bystanders.report_survey, place))
            case Departure(at=offset, device=device):
                self._schedule(offset, partial(self._withdraw_device, f"devices/{device}"))

    def _work_fault(self, device: str) -> WorkFaultKind | None:
        """Return the fault of the device's next execution, or None."""
        counts = {None: self._work_counts[None], device: self._work_counts[device]}
        self._work_counts.update((None, device))
        faults = [f for f in self.scenario.faults if isinstance(f, WorkFault) and counts.get(f.device) == f.nth]
        if not faults:
            return None
        self.note(f"{device} {faults[0].kind}")
        return faults[0].kind

    def _target(self, target: str) -> str:
        if target != AT_WORK:
            return target
        return next((simulated_device.traits.address for simulated_device, _ in self.working), "")

    def note(self, text: str) -> None:
        self.log.append((self.world.now, text))

    def _kill(self, kill: Kill) -> None:
        address = self._targets[kill] = self._target(kill.target)
        if not self.world.alive(address) or address in self._doomed:
            return
        if kill.snapshot:
            self.world.snapshot(address)
        self.note(f"{address} is killed {kill.moment}{f' ({kill.effects})' if kill.moment is KillPoint.AMID else ''}")
        self._doomed[address] = self.world.components[address]
        self.world.kill(address, kill.moment, kill.effects)
        if kill.seconds is None:
            self.lost_devices.add(address)
        self.reap()

    def _break(self, traits: DeviceTraits) -> None:
        self.note(f"{traits.name} breaks without a message")
        self._doomed[traits.address] = self.world.components[traits.address]
        self.world.kill(traits.address)
        self.lost_devices.add(traits.address)
        self.reap()

    def reap(self) -> None:
        """Note the components that have died since the last call, and stop their devices."""
        for address in [address for address in self._doomed if not self.world.alive(address)]:
            self.note(f"{address} is dead")
            self._fallen[address] = self._doomed.pop(address)
            if address in self.simulated_devices:
                self.simulated_devices[address].died()

    def _revive(self, kill: Kill) -> None:
        address = self._targets[kill]
        self.reap()
        if address in self._doomed:
            self.world.remove(address)
            self.reap()
        if self.world.alive(address) or address not in self._fallen or address in self.lost_devices:
            return
        self.note(f"{address} restarts")
        self.restart_times[address] = self.world.now
        self.factory.revive(self.world, address)
        self.reap()

    def _restored(self, address: str, component: Component) -> None:
        self._check_same_state(address, self._fallen.pop(address), component)

    def _check_same_state(self, address: str, component_before: Component, component_after: Component) -> None:
        """Check property 7: the restored component equals the one that was killed."""
        different: str | None = None
        match component_before, component_after:
            case TaskManager(), TaskManager():
                different = difference(component_before.state, component_after.state, ignored_types=(Replica,))
                if different is None and _copy(component_before) != _copy(component_after):
                    different = "the copies of the map"
            case Registry(), Registry():
                different = difference(component_before.state, component_after.state, ignored_types=(Replica,))
            case Repository(), Repository():
                different = difference(component_before.state, component_after.state)
            case DeviceManager(), DeviceManager():
                different = difference(component_before.state, component_after.state)
        if different is not None:
            raise Violation(Property.RESTART, f"{address} differs after its restart: {different}")

    def _cut(self, cut: Cut) -> None:
        target = self._targets[cut] = self._target(cut.target)
        if not target:
            return
        self.note(f"{target} cannot be reached")
        self._cuts[target] += 1
        self.world.cut_off(target)

    def _reconnect(self, cut: Cut) -> None:
        target = self._targets[cut]
        self._cuts[target] -= 1
        if target and not self._cuts[target]:
            self.note(f"{target} can be reached again")
            self.world.reconnect(target)

    def _withdraw_device(self, address: str) -> None:
        if self.world.alive(address):
            self.note(f"{address} leaves")
            self.world.notify(address, LeaveNow())

    # Callbacks of the simulated world

    def _medium(self, message: Message) -> Sequence[float]:
        """Return the delays of the message's copies. They depend only on the seed and the message, so a reduced scenario keeps them."""
        if not self._disturbances:
            return (LATENCY,)
        disturbance, id = self._disturbances[-1], message.header.message_id
        self._tries[id] += 1
        dice = zlib.crc32(f"{self.scenario.seed} {id} {self._tries[id]}".encode())
        if (dice & 0xFF) / 256 < disturbance.lost:
            return ()
        late = LATENCY + (dice >> 16 & 0xFF) / 256 * disturbance.late
        return (late, LATENCY + (dice >> 24) / 256 * disturbance.late * 2) if (dice >> 8 & 0xFF) / 256 < disturbance.twice else (late,)

    def _watch(self, address: str, event: Input) -> None:
        self.events += 1
        if self.events > MAX_EVENTS:
            raise Violation(Property.TERMINATION, f"more than {MAX_EVENTS} inputs without an end")
        if self._doomed:
            self.reap()
        for listener in self._listeners:
            listener(self.world.now, event)
        self.witness.watch(address, event)

    def _observe_start(self, simulated_device: SimulatedDevice, device_work: DeviceWork) -> None:
        self.witness.observe_start(simulated_device, device_work)

    def _plan(self, address: str, task: object) -> Work:
        assert isinstance(task, Problem), "a Task Manager's only background work is planning"
        self.witness.planning(address, task)
        yield self.scenario.planning, plan(task)


def profile(traits: DeviceTraits) -> Profile:
    """Return the device's profile for its Service Manager."""
    undoable = traits.undo is not Undo.IMPOSSIBLE
    capabilities = tuple(Capability(type=service_type(name), method=name, stoppable=True, undoable=undoable) for name in traits.services)
    return Profile(name=traits.name, type="PioneerP3DX", capabilities=capabilities, valid_for=traits.valid_for, lease=traits.lease)


def _copy(manager: TaskManager) -> tuple[int, Map]:
    """Return the version and the map of a Task Manager's replica."""
    return manager.state.replica.version, manager.state.replica.map
