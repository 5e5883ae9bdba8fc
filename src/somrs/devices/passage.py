"""The base classes for lifts and automatic doors of any make: traffic calls them for robots, besides their services.

    class AcmeLift(LiftDevice):
        async def serve(self, call: PassageCall) -> None: ...
        async def release(self) -> None: ...

The program that runs the device talks to traffic.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection

from somrs.devices.own_names import FOR_ALL, check_own_names
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal
from somrs.service_manager.sdk.values import number_of
from somrs.traffic.passage_call import PassageCall, PassageStatus

FOR_AUTHORS = FOR_ALL | {"serve", "release", "stops"}
"""What authors of lifts and doors override."""

STANDING = 0.1
"""Difference in height up to which a cabin stands at a storey, m."""
MOVE_TIME = "30 s"
"""What a move is taken to need in a quote."""


def _tell_nobody(status: PassageStatus) -> None:
    """Do nothing: no program runs the device."""


class PassageDevice(Device):
    """A passage that moves for robots. It calls `status` whenever something of it changes, and once in `open`."""

    status_observer: Callable[[PassageStatus], None] = staticmethod(_tell_nobody)
    """Receives the status; the program that runs the device sets it."""
    current_status: PassageStatus | None = None
    """What was reported last."""

    def __init_subclass__(cls, *, replaces: Collection[str] = ()) -> None:
        """`replaces`: further names of the base classes that the class replaces on purpose. Raises DeviceError for those that it uses by
        mistake."""
        super().__init_subclass__()
        check_own_names(cls, FOR_AUTHORS.union(replaces))

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self.call: PassageCall | None = None
        """What robots need it for now; None if none does."""
        self._change = asyncio.Condition()
        self._move = asyncio.Lock()

    async def serve(self, call: PassageCall) -> None:
        """Open the passage, at the floor of the call, and return when robots can come. It has to stay open until the next call or
        `release`.

        It is cancelled when there is another call, and called again after an exception."""
        raise NotImplementedError

    async def release(self) -> None:
        """No robot needs the passage any more: it may shut, and others may use it."""
        raise NotImplementedError

    def status(self, *, level: float | None = None, working: bool = True, shared: bool = False, problem: str | None = None) -> None:
        """Say how the passage is now; the map learns whether it works. `problem`: why it does not, as of `report_problem`."""
        self.report_problem(None if working else problem or "does not work")
        earlier, self.current_status = self.current_status, PassageStatus(level=level, working=working, shared=shared)
        if earlier is None or earlier.working != working:
            self.observed(f"{self.name}.Working = {str(working).upper()}")
        self.status_observer(self.current_status)

    async def follow(self, call: PassageCall | None) -> None:
        """Do what traffic calls the passage for. The program that runs the device calls it."""
        async with self._change:
            self.call = call
            self._change.notify_all()
        async with self._move:
            await self._carry_out(call)

    async def _carry_out(self, call: PassageCall | None) -> None:
        await (self.serve(call) if call is not None else self.release())

    async def _unused(self) -> None:
        """Wait until no robot needs the passage. Who takes `_move` then, without waiting before, comes before all later calls."""
        async with self._change:
            await self._change.wait_for(lambda: self.call is None)


async def _stops_there(device: LiftDevice, task: Task) -> None:
    """Check that the lift works, and stops at the storey. Raises Refusal."""
    storey, stops = str(task.inputs["Storey"]), await device.stops()
    if storey not in stops:
        raise Refusal(f"{device.name} does not stop at {storey}; it stops at {', '.join(stops) or 'no storey'}")
    _check_working(device)


def _check_working(device: PassageDevice) -> None:
    if device.current_status is None or not device.current_status.working:
        raise Refusal(f"{device.name} does not work", not_now=True)


class LiftDevice(PassageDevice):
    """A lift. The map learns at which storey its cabin stands when no robot has it, and that it stands at none when the lift does
    not work and does not know where its cabin is."""

    type = "Lift"
    _reported_level: float | None = None

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self._reporting = asyncio.Lock()
        self._reports: set[asyncio.Task[None]] = set()

    def status(self, *, level: float | None = None, working: bool = True, shared: bool = False, problem: str | None = None) -> None:
        super().status(level=level, working=working, shared=shared, problem=problem)
        if not working or (level is not None and level != self._reported_level):
            report = asyncio.get_running_loop().create_task(self._report_whereabouts())
            self._reports.add(report)
            report.add_done_callback(self._reports.discard)

    async def follow(self, call: PassageCall | None) -> None:
        await super().follow(call)
        await self._report_whereabouts()

    async def _report_whereabouts(self) -> None:
        """Tell the map where the cabin stands, as far as it does not know."""
        async with self._reporting:
            status = self.current_status
            if status is None or (status.working and (status.level is None or self.call is not None)):
                return
            level, self._reported_level = self._reported_level, status.level
            if status.level is None:
                rows = await self.map.query(f"{self.name} standsAt ?Storey")
                parts = [f"NOT {self.name} standsAt {row['Storey']}" for row in rows]
            elif status.level != level:
                storeys = [storey for storey, height in (await self.stops()).items() if abs(height - status.level) < STANDING]
                parts = [f"{self.name}.PositionZ = {status.level}", *(f"{self.name} standsAt {name}" for name in storeys[:1])]
            else:
                return
            if parts:
                self.observed(" AND ".join(parts))

    async def stops(self) -> dict[str, float]:
        """The heights of the floors of the storeys at which it stops, m."""
        rows = await self.map.query(f"{self.name} stopsAt ?Storey AND ?Storey.Elevation = ?Height")
        return {str(row["Storey"]): number_of(row["Height"]) for row in rows}

    @service("CallLift", duration=MOVE_TIME, able=_stops_there, inputs=("Storey",))
    async def call_lift(self, task: Task) -> Situation:
        storey = str(task.inputs["Storey"])
        level = (await self.stops())[storey]
        await self._unused()
        async with self._move:
            await self.serve(PassageCall(level=level))
            await self.release()
        return f"{self.name}.PositionZ = {level} AND {self.name} standsAt {storey}"


async def _is_this_door(device: DoorDevice, task: Task) -> None:
    """Check that the order is for this door, and that it works. Raises Refusal."""
    if task.inputs["Door"] != device.name:
        raise Refusal(f"{device.name} opens and closes only itself")
    _check_working(device)


class DoorDevice(PassageDevice):
    """An automatic door. `OpenDoor` has it stay open, until `CloseDoor`."""

    type = "AutomaticDoor"

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self._stays_open = False

    async def _carry_out(self, call: PassageCall | None) -> None:
        if call is not None or not self._stays_open:
            await super()._carry_out(call)

    @service("OpenDoor", duration=MOVE_TIME, able=_is_this_door, inputs=("Door",))
    async def open_door(self, task: Task) -> Situation:
        async with self._move:
            await self.serve(PassageCall())
            self._stays_open = True
        return f"{self.name}.Open = TRUE"

    @service("CloseDoor", duration=MOVE_TIME, able=_is_this_door, inputs=("Door",))
    async def close_door(self, task: Task) -> Situation:
        await self._unused()
        async with self._move:
            await self.release()
            self._stays_open = False
        return f"{self.name}.Open = FALSE"
