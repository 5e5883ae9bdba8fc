"""Devices and their services: presence, state, work and reliability; and the faults of simulated devices."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import StrEnum

import msgspec

from somrs.access.rights import Right
from somrs.api.assignments import BUSY, Assignment, by_device
from somrs.api.context import Context
from somrs.api.device_state import DeviceState, fault_text, is_working, state_of
from somrs.api.reliability_stats import WINDOW, ReliabilityStats, Tally
from somrs.api.service_presence import ServicePresence
from somrs.api.simulator_gateway import NO_TRAFFIC, SimulatedDeviceView, break_or_mend, put_robot, simulated_devices
from somrs.api.traffic_reader import last_place, reader_of
from somrs.api.waiting import waiting_text
from somrs.client.operations import operation
from somrs.client.refusals import ErrorReport, NotFound, error_report
from somrs.client.task_history import TaskHistory
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.roads import TrafficState
from somrs.errors import SomrsError
from somrs.kernel.offers import Offers
from somrs.ontology.modes import DOOR, LIFT, MOBILE_ROBOT
from somrs.ontology.objects import Change, Fact, FactRemoved, ValueSet
from somrs.ontology.services import ServiceKind
from somrs.ontology.types import IN_SERVICE, PAUSED, PAUSED_FOR, PROBLEM, WORKING, Value
from somrs.ontology.values import value_of
from somrs.protocol.messages.directory import Discover, NeighbourView, Offer, PresenceChange
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.task_views import TaskView, WorkView

_STOREY = "Storey"
_HELD_BY, _STANDS_AT = "isHeldBy", "standsAt"

DEPARTED_TIME = 600.0
"""Seconds for which a device that left is still listed."""

TICK = 1.0
"""Seconds between two checks of the fleet while a client follows it."""


class WithheldOffer(msgspec.Struct, frozen=True, kw_only=True):
    """A service that its device publishes and the Registry does not list: its type is defined otherwise, or another has its name."""

    offer: Offer
    reason: str


class Services(msgspec.Struct, frozen=True, kw_only=True):
    """`neighbours`: the neighbours of the Registry whose offers are among these, as far as they are there."""

    offers: tuple[Offer, ...]
    withheld: tuple[WithheldOffer, ...] = ()
    neighbours: tuple[NeighbourView, ...] = ()


class Presence(StrEnum):
    """Whether a device has services on offer."""

    OFFERS = "offers"
    """It has services on offer."""
    SILENT = "silent"
    """It is on the map, and has no service on offer."""
    DEPARTED = "gone"
    """It is not on the map, and its services left the Registry a short time ago."""


class ServiceView(msgspec.Struct, frozen=True, kw_only=True):
    """A service of a device. `price`: the device's usual price for a step, EUR, if it publishes one; its terms for a task may differ."""

    service: str
    type: str
    kind: ServiceKind
    effect: str
    precondition: str | None = None
    price: float | None = None
    attributes: dict[str, Value] = {}
    on_offer: bool = True
    tally: Tally = Tally()


class DeviceView(msgspec.Struct, frozen=True, kw_only=True):
    """A device. `lineage`: its type and that type's ancestors. `utilisation` (JSON: `load`): the share of the last `Devices.window` seconds
    in which it was at work, from 0 to 1. `since`: when it joined, if the log has that; `departed_at` (JSON: `left`) and `reason`: when and
    why it left; `registry`: the neighbour whose device it is, empty for one of this system; `assignments` (JSON: `doing`): its steps in
    tasks; `waiting`: why it waits in traffic, such as `waits for Robot3, which charges`, empty if it does not; `simulated`: its state in
    the simulator."""

    name: str
    type: str
    lineage: tuple[str, ...]
    presence: Presence
    state: DeviceState
    label: str | None = None
    working: bool = True
    """Whether it is free of known faults, and can be reached."""
    problem: str = ""
    """Why it is not, after its name: `cannot drive: its stop is pressed`; empty without a reason."""
    paused: bool = False
    """Whether an operator has stopped it."""
    paused_for: str | None = None
    """The paused task for which it stands still."""
    in_service: bool = True
    """Whether it gets new work."""
    position: tuple[float, ...] | None = None
    place: str | None = None
    """The storey on which it is, or at which the cabin of a lift is."""
    holding: tuple[str, ...] = ()
    charge: float | None = None
    services: tuple[ServiceView, ...] = ()
    assignments: tuple[Assignment, ...] = msgspec.field(default=(), name="doing")
    utilisation: float = msgspec.field(default=0.0, name="load")
    since: float | None = None
    departed_at: float | None = msgspec.field(default=None, name="left")
    reason: str = ""
    registry: str = ""
    waiting: str = ""
    simulated: SimulatedDeviceView | None = None


class Devices(msgspec.Struct, frozen=True, kw_only=True):
    """All devices by name; the latest arrivals and departures, newest first. `at`: seconds since 1970; `window`: seconds."""

    at: float
    devices: tuple[DeviceView, ...]
    log: tuple[PresenceChange, ...]
    window: float = WINDOW


def rank_and_name(device: DeviceView) -> tuple[int, str]:
    """The order for operators: robots first, and last lifts and doors, of which a building has many."""
    rank = 0 if MOBILE_ROBOT in device.lineage else 2 if {LIFT, DOOR} & {*device.lineage} else 1
    return rank, device.name


class FleetService:
    def __init__(self, context: Context) -> None:
        self._context = context
        self._presence = ServicePresence()
        self._task_history = TaskHistory(context.client.records, context.client)
        self._reliability = ReliabilityStats()
        self._reader = reader_of(context)
        context.hub.feed("fleet", self._feed)

    @operation("GET", "/services", Right.SEE)
    async def services(self, type: str | None = None, effect: str | None = None) -> Services:
        """The services on offer now: all, those of a service type, or those that can achieve an effect."""
        client, query = self._context.client, Discover(service_type=type, effect=effect)
        withheld = tuple(WithheldOffer(offer=offer, reason=reason) for offer, reason in await client.withheld_services(query))
        return Services(offers=await client.services(query), withheld=withheld, neighbours=await client.neighbours())

    @operation("GET", "/fleet", Right.SEE)
    async def devices(self) -> Devices:
        """List all devices: those on the map, and those with services on offer now or a short time ago.

        The topic `fleet` publishes the same list whenever it changes.
        """
        now = time.time()
        services = self._context.listener.services
        tasks, (states, traffic), offers, *_ = await asyncio.gather(
            self._context.client.tasks(running=True),
            self._world(),
            self._offers(),
            self._presence.read(self._context.client, services.version),
            self._reliability.learn(self._task_history),
        )
        assignments = by_device(tasks)
        utilisations = self._reliability.utilisations(_works(tasks), now)
        names = {*self._on_map(), *offers.providers}
        names.update(change.device for change in self._presence.log if not change.joined and change.at > now - DEPARTED_TIME)
        devices = (
            self._device(name, offers.of_provider(name), assignments.get(name, ()), utilisations.get(name, 0.0), states.get(name), traffic)
            for name in names
        )
        return Devices(at=now, devices=tuple(sorted(devices, key=rank_and_name)), log=self._presence.log)

    async def _world(self) -> tuple[Mapping[str, SimulatedDeviceView], TrafficState]:
        """The simulated devices, and the traffic of the building, whether it is simulated or not."""
        if self._reader is None:
            return await simulated_devices(self._context.addresses)
        try:
            return {}, await self._reader.traffic()
        except SomrsError:
            return {}, NO_TRAFFIC

    @operation("POST", "/fleet/{robot}/faults/{fault}", Right.OPERATE)
    async def fault(self, robot: str, fault: Fault, repair: bool = False) -> None:
        """Inject a fault into a simulated robot, lift, door or other device, or with `repair` remove it."""
        await break_or_mend(self._context.addresses, robot, fault, repair=repair)

    @operation("POST", "/fleet/{robot}/place", Right.OPERATE)
    async def put(self, robot: str, x: float, y: float, storey: str | None = None, turned: float = 0.0, by: str = "") -> None:
        """Put a simulated robot somewhere else, as somebody would carry it. It gives up what it does, and its task goes on from there.

        `storey`: by default, the floor on which it is. `turned`: its heading, in radians. It must fit there, and hold nothing.
        """
        map, ontology = self._context.map, self._context.ontology
        if storey is not None and storey not in map.objects:
            raise NotFound(f"there is no storey {storey}; GET /map lists the objects")
        if robot not in map.objects:
            raise NotFound(f"there is no robot {robot} on the map; GET /fleet lists the devices")
        height = value_of(storey, "Elevation", map, ontology) if storey is not None else value_of(robot, "PositionZ", map, ontology)
        z = _number(height) or 0.0
        await put_robot(self._context.addresses, robot, x, y, z, turned)
        pose = {"PositionX": x, "PositionY": y, "PositionZ": z, "RotationZ": turned}
        moved: list[Change] = [ValueSet(robot, path, value) for path, value in pose.items()]
        former_places = [FactRemoved(Fact("isAt", arguments)) for arguments in map.facts_with("isAt", 0, robot)]
        await self._context.client.report(UpdateMap(changes=(*moved, *former_places), author=by))

    def _on_map(self) -> Iterator[str]:
        map, ontology = self._context.map, self._context.ontology
        for type_name in ontology.types:
            if ontology.is_device(type_name):
                yield from map.of_type(type_name)

    async def _offers(self) -> Offers:
        """The services on offer; until the copy has been read, as the Registry answers."""
        services = self._context.listener.services
        return services.offers if services.ready else Offers(await self._context.client.services())

    def _device(
        self,
        name: str,
        offers: Sequence[Offer],
        assignments: tuple[Assignment, ...],
        utilisation: float,
        state: SimulatedDeviceView | None,
        traffic: TrafficState,
    ) -> DeviceView:
        map, ontology = self._context.map, self._context.ontology
        object = map.objects.get(name)
        departure, arrival = self._presence.last_departure(name), self._presence.last_arrival(name)
        type_name = object.type if object is not None else offers[0].provider_type if offers else ""
        offered = [self._service(offer) for offer in offers]
        if not offered and departure is not None:
            offered = [self._former_service(service) for service in departure.services]
        paused_for = _text(value_of(name, PAUSED_FOR, map, ontology))
        faults, problem = state.faults if state is not None else None, _text(value_of(name, PROBLEM, map, ontology)) or ""
        working = is_working(value_of(name, WORKING, map, ontology) is not False, faults) and not problem
        return DeviceView(
            name=name,
            type=type_name,
            lineage=ontology.ancestors(type_name),
            presence=Presence.OFFERS if offers else Presence.SILENT if object is not None else Presence.DEPARTED,
            label=_text(value_of(name, "Label", map, ontology)),
            working=working,
            problem=problem or fault_text(faults),
            state=state_of(
                on_map=object is not None,
                offers=bool(offers),
                working=working,
                busy=any(assignment.state in BUSY for assignment in assignments),
                booked=bool(assignments),
                paused=value_of(name, PAUSED, map, ontology) is True or paused_for is not None,
                in_service=value_of(name, IN_SERVICE, map, ontology) is not False,
            ),
            paused=value_of(name, PAUSED, map, ontology) is True,
            paused_for=paused_for,
            in_service=value_of(name, IN_SERVICE, map, ontology) is not False,
            position=(last_place(name, traffic) if state is None else None) or self._position(name),
            place=self._place(name),
            holding=tuple(arguments[0] for arguments in map.facts_with(_HELD_BY, 1, name)),
            charge=_number(value_of(name, "Charge", map, ontology)),
            services=tuple(sorted(offered, key=lambda service: service.service)),
            assignments=assignments,
            utilisation=round(utilisation, 3),
            since=arrival.at if arrival is not None and offers else None,
            departed_at=departure.at if departure is not None and not offers else None,
            reason=departure.reason if departure is not None and not offers else "",
            registry=offers[0].registry if offers else departure.registry if departure is not None else "",
            waiting=waiting_text(traffic.robots.get(name), traffic) if not problem else "",
            simulated=state,
        )

    def _service(self, offer: Offer) -> ServiceView:
        kind = offer.service_type
        return ServiceView(
            service=offer.service,
            type=kind.name,
            kind=kind.kind,
            effect=kind.effect,
            precondition=kind.precondition,
            price=_number(offer.attributes.get("Price")),
            attributes=offer.attributes,
            tally=self._reliability.tally(offer.service),
        )

    def _former_service(self, service: str) -> ServiceView:
        """A service that is no longer on offer."""
        type_name = service.partition(".")[2]
        kind = self._context.ontology.services.get(type_name)
        return ServiceView(
            service=service,
            type=type_name,
            kind=kind.kind if kind is not None else ServiceKind.PHYSICAL,
            effect=kind.effect if kind is not None else "",
            on_offer=False,
            tally=self._reliability.tally(service),
        )

    def _position(self, name: str) -> tuple[float, ...] | None:
        map, ontology = self._context.map, self._context.ontology
        coordinates = [_number(value_of(name, path, map, ontology)) for path in ("PositionX", "PositionY", "PositionZ")]
        known_coordinates = [coordinate for coordinate in coordinates if coordinate is not None]
        return tuple(known_coordinates) if coordinates[0] is not None and coordinates[1] is not None else None

    def _place(self, name: str) -> str | None:
        map, ontology = self._context.map, self._context.ontology
        for arguments in map.facts_with(_STANDS_AT, 0, name):
            return arguments[1]
        whole, visited = map.whole(name), set[str]()
        while whole is not None and whole in map.objects and whole not in visited:
            if ontology.is_subtype(map.objects[whole].type, _STOREY):
                return whole
            visited.add(whole)
            whole = map.whole(whole)
        return None

    async def _feed(self, topic: str) -> None:
        """Publish the fleet whenever it changes, or an error report while it cannot be read."""
        published_fleet: object = None
        with self._context.hub.subscribe("services") as news:
            while True:
                try:
                    fleet: Devices | ErrorReport = await self.devices()
                except SomrsError as error:
                    fleet = error_report(error)
                timeless_fleet = msgspec.structs.replace(fleet, at=0.0) if isinstance(fleet, Devices) else fleet
                if timeless_fleet != published_fleet:
                    published_fleet = timeless_fleet
                    self._context.hub.publish(topic, fleet)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(TICK):
                        await news.next_news()


def _works(tasks: Iterable[TaskView]) -> Iterator[WorkView]:
    return (work for task in tasks for work in task.work)


def _number(value: Value | None) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _text(value: Value | None) -> str | None:
    return value if isinstance(value, str) else None
