"""The lifts and automatic doors of a simulation in traffic: they take part as real ones do, by the same messages."""

from __future__ import annotations

from collections.abc import Mapping

from somrs.devices.simulator.motion.passages import AutomaticDoor, Lift
from somrs.devices.simulator.server.traffic_office import TrafficOffice
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.traffic import CallPassage, PassageEntered, ReleasePassage
from somrs.traffic.participant import PassageParticipant

LEASE = 10.0
"""The lease of a passage, in simulated seconds."""


class SimulatedPassage:
    """The part in traffic of a lift or a door."""

    def __init__(self, name: str, device: Lift | AutomaticDoor) -> None:
        self._device = device
        self._participant = PassageParticipant(name)
        self._reported: object = None

    def receive(self, body: Body) -> None:
        """A message from traffic."""
        if isinstance(body, CallPassage | ReleasePassage):
            self._participant.called(body)

    def advance(self, office: TrafficOffice, *, renews: bool) -> None:
        """Do what traffic calls it for, and say how it is, if that has changed, or to renew the lease."""
        participant = self._participant
        if not office.component.may_be_passage(participant.passage):
            participant.fence = 0  # it enters when the roadmap has it
            return
        if not participant.fence:
            answer = office.tell(participant.passage, participant.enter(LEASE))
            assert isinstance(answer, PassageEntered), "traffic takes every passage of its roadmap"
            participant.entered(answer)
        state = participant.call_number, self._follow(participant.call), self._device.is_usable
        if renews or state != self._reported:
            self._reported = state
            level = participant.call.level if participant.call is not None else None
            office.tell(participant.passage, participant.report(is_open=state[1], level=level if state[1] else None, working=state[2]))

    def _follow(self, call: CallPassage | None) -> bool:
        """Have the device moved. Returns whether it is open as it was called."""
        device = self._device
        if isinstance(device, AutomaticDoor):
            device.need(call is not None)
            return call is not None and device.is_open
        if call is None:
            device.release()
            return False
        assert call.level is not None, "a lift is called to a floor"
        device.call(call.level)
        return device.is_open(call.level)


class SimulatedPassages:
    """All lifts and automatic doors, by name."""

    def __init__(self, lifts: Mapping[str, Lift], doors: Mapping[str, AutomaticDoor]) -> None:
        self._lifts, self._doors = lifts, doors
        self._outside: set[str] = set()
        """Those that take part by messages of programs of their own."""
        self._parts: dict[str, tuple[Lift | AutomaticDoor, SimulatedPassage]] = {}

    def set_outside(self, name: str, office: TrafficOffice, *, is_outside: bool) -> None:
        """Let a lift or a door take part by messages of a program of its own, or again by the simulation."""
        if is_outside:
            self._outside.add(name)
            office.passages.pop(name, None)
        else:
            self._outside.discard(name)

    def advance(self, office: TrafficOffice, *, renews: bool = False) -> None:
        """Call it once per control period. `renews`: the leases are due."""
        all_devices: dict[str, Lift | AutomaticDoor] = {**self._lifts, **self._doors}
        devices = {name: device for name, device in all_devices.items() if name not in self._outside}
        self._parts = {name: part for name, part in self._parts.items() if devices.get(name) is part[0]}
        for name, device in devices.items():
            if name not in self._parts:
                self._parts[name] = device, SimulatedPassage(name, device)
                office.passages[name] = self._parts[name][1].receive
            self._parts[name][1].advance(office, renews=renews)
