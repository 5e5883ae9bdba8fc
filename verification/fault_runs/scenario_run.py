"""Plays a scenario: runs a whole system on virtual time, and injects the scenario's faults at their times."""

from __future__ import annotations

import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from msgspec import structs

from somrs.kernel.component import Component, Input
from somrs.kernel.following import LEASE
from somrs.kernel.replica import Replica
from somrs.ontology.map import Map
from somrs.planner.model.problem import Problem
from somrs.planner.planning import plan
from somrs.protocol.messages.envelope import Message
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.virtual_network import LATENCY
from somrs.runtime.virtual_time import KillPoint, Work, World
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.participant.timers import DepartureRequested as LeaveNow
from somrs.task_manager.manager import SCHEMA, TaskManager
from somrs.task_manager.transaction.state import TaskState
from verification.fault_runs.bystanders import Bystanders
from verification.fault_runs.client import Client
from verification.fault_runs.component_factory import ComponentFactory, profile
from verification.fault_runs.ground_truth import Reality
from verification.fault_runs.names import DeviceNames
from verification.fault_runs.organisations import Organisations
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
    Partition,
    Scenario,
    Sight,
    Slam,
    Survey,
    TakeOver,
    WorkFault,
    WorkFaultKind,
)
from verification.fault_runs.simulated_device import DeviceManager, DeviceWork, SimulatedDevice
from verification.fault_runs.state_diff import difference
from verification.fault_runs.violation import Property, Violation

LONG = 4 * 3600.0
"""Seconds after the last fault has healed within which every task has to end and every participant has to be released."""

READING_TIME = 20.0
"""Seconds in which Repositories and Registries get to know their neighbours, before a run with several maps."""

AFTERWARDS = 60.0
"""Seconds after the end in which there may be no activity."""

MAX_EVENTS = 100_000
"""The limit on the inputs of a run; no scenario needs as many."""


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
        self._targets: dict[Kill | TakeOver | Cut, str] = {}
        self._disturbances: list[Disturbance] = []
        self._cuts: Counter[str] = Counter()
        self._doomed: dict[str, Component] = {}
        self._fallen: dict[str, Component] = {}
        self._listeners: list[Callable[[float, Input], None]] = []
        self.client = Client(scenario.requests)
        self.organisations = Organisations(scenario)
        self.witness = Witness(self)
        self._bystanders = Bystanders(self)
        self.managers = [f"tm{number}" for number in range(1, scenario.managers + 1)]
        self.organisations.begin(self.world)
        self.world.add("client", self.client)
        self._scheduled: list[tuple[float, Callable[[], None]]] = []
        for traits in scenario.devices:
            if traits.joins:
                self._schedule(traits.joins, partial(self._join, traits))
            else:
                self._join(traits)
        for number, address in enumerate(self.managers):
            map_number = scenario.map_number(address)
            registry = self.organisations.registry_of(map_number, number)
            manager = self.factory.task_manager(address, self.organisations.repository_of(map_number), registry)
            schema = structs.replace(SCHEMA, restore=type(manager).restored)
            self.world.add(address, manager, partial(self._plan, address), journaled=schema)

    # Components

    def _join(self, traits: DeviceTraits) -> None:
        next_fault = partial(self._work_fault, traits.name)
        names = DeviceNames(self.scenario.maps[self.scenario.map_number(traits.name)], self.organisations.fixed_homes)
        simulated_device = SimulatedDevice(
            traits, names, self.reality, next_fault, lambda: self.world.now, self._observe_start, self._break
        )
        self.simulated_devices[traits.address] = simulated_device
        schema = structs.replace(
            SERVICE_MANAGER, restore=lambda state: self.factory.restore_service_manager(state, simulated_device, self.witness.observe_input)
        )
        self.world.add(traits.address, self._device(traits), simulated_device.carry_out, journaled=schema)

    def _device(self, traits: DeviceTraits) -> ServiceManager:
        organisations, map_number = self.organisations, self.scenario.map_number(traits.name)
        registry = organisations.registry_of(map_number, self.scenario.devices.index(traits))
        simulated_device = self.simulated_devices[traits.address]
        return self.factory.service_manager(
            profile(traits), organisations.repository_of(map_number), registry, simulated_device, self.witness.observe_input
        )

    def task_manager(self, address: str) -> TaskManager | None:
        """Return the Task Manager at the address; None while it is down."""
        component = self.world.components.get(address)
        return component if isinstance(component, TaskManager) else None

    def running_tasks(self) -> Iterator[TaskState]:
        """The tasks that have not ended, also those of Task Managers that are down."""
        for address in self.managers:
            component = self.world.components.get(address) or self._fallen.get(address) or self._doomed.get(address)
            if isinstance(component, TaskManager):
                yield from component.state.running_tasks

    @property
    def offered_types(self) -> set[str]:
        """The service types that devices offer."""
        return {service for device in self.scenario.devices for service in device.services}

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
        if self.scenario.repositories > 1:
            self._run(READING_TIME)
            self.start = self.world.now
        for address in {fault.target for fault in self.scenario.faults if isinstance(fault, TakeOver)}:
            self.world.add_standby(address)
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
        self._run(AFTERWARDS if len(self.organisations.all_registries) == 1 else AFTERWARDS + 2 * LEASE)
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
            case TakeOver(at=offset, seconds=seconds):
                self._schedule(offset, partial(self._lose_host, fault))
                self._schedule(offset + seconds, partial(self._take_over, fault))
            case Partition(at=offset, seconds=seconds, one=one, other=other):
                self._schedule(offset, partial(self._separate, one, other))
                self._schedule(offset + seconds, partial(self._join_again, one, other))
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

    def _lose_host(self, take_over: TakeOver) -> None:
        if not take_over.lingers:
            self._kill(Kill(at=take_over.at, target=take_over.target, moment=take_over.moment, effects=take_over.effects))

    def _take_over(self, take_over: TakeOver) -> None:
        address = take_over.target
        self.reap()
        if address in self.lost_devices:
            return
        self.note(f"a standby continues {address}")
        if address not in self._fallen:
            self._fallen[address] = self.world.components[address]
        self._doomed.pop(address, None)
        self.restart_times[address] = self.world.now
        self.world.take_over(address, take_over.lingers)

    def _separate(self, one: str, other: str) -> None:
        self.note(f"{one} and {other} cannot reach each other")
        self.world.separate(one, other)

    def _join_again(self, one: str, other: str) -> None:
        self.note(f"{one} and {other} can reach each other again")
        self.world.join(one, other)

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


def _copy(manager: TaskManager) -> tuple[int, Map]:
    """Return the version and the map of a Task Manager's replica."""
    return manager.state.replica.version, manager.state.replica.map
