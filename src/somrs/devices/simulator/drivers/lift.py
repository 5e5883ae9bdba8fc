"""The driver of a simulated lift, which says where its cabin is, and takes it to a storey.

Robots that ride need no service: traffic grants them the lift, one after the other.
"""

from __future__ import annotations

from somrs.devices.simulator.drivers.simulated import STANDING, Pose, SimulatedDevice, format_number
from somrs.devices.simulator.link.commands import RobotState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.entish.formula import Formula, Name, Relation, conjuncts
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed
from somrs.service_manager.sdk.values import number_of

DOOR_TIME = 6.0
"""Time until a robot has left the cabin and the doors are shut, s."""
DEFAULT_SPEED = 1.0
"""Speed of a cabin for which the map states none, m/s."""


async def _able(device: Lift, task: Task) -> None:
    """Check that the lift works, and stops at the storey. Raises Refusal."""
    storey, stops = str(task.inputs["Storey"]), await device.stops()
    if storey not in stops:
        raise Refusal(f"{device.name} does not stop at {storey}; it stops at {', '.join(stops) or 'no storey'}")
    await device.check_working()


async def _duration(device: Lift, task: Task) -> float:
    """The time for the way from where the cabin is now."""
    state = await device.check_working()
    speeds = [number_of(row["Speed"]) for row in await task.map.query(f"{device.name}.Speed = ?Speed")]
    height = (await device.stops())[str(task.inputs["Storey"])]
    way = abs(height - state.z) if state.z is not None else 0.0
    return round(DOOR_TIME + way / (speeds[0] if speeds and speeds[0] > 0 else DEFAULT_SPEED), 1)


class Lift(SimulatedDevice):
    """A lift in the simulator."""

    type = "Lift"
    features = ("Payload", "Speed", "Price")
    mobile = False

    async def open(self) -> None:
        self._last_height: float | None = None
        self._reported_whereabouts = ""
        await super().open()

    async def stops(self) -> dict[str, float]:
        """The heights of the floors of the storeys at which it stops, m."""
        rows = await self.map.query(f"{self.name} stopsAt ?Storey AND ?Storey.Elevation = ?Height")
        return {str(row["Storey"]): number_of(row["Height"]) for row in rows}

    @service("CallLift", price=SimulatedDevice.price, duration=_duration, able=_able, inputs=("Storey",))
    async def call(self, task: Task) -> Situation:
        return await self._go(str(task.inputs["Storey"]))

    @call.stopping
    async def stop_cabin(self, task: Task) -> Situation:
        done = await self.retry_when_link_lost(self._link.stop)
        return await self._whereabouts(done.state)

    @call.compensation
    async def restore(self, task: Task, situation: Formula) -> Situation:
        """Take the cabin to where it was, if it was at a storey."""
        for part in conjuncts(situation):
            match part:
                case Relation("standsAt", (Name(self.name), Name(storey))):
                    return await self._go(storey)
        return await self._whereabouts(await self.check_working())

    async def _go(self, storey: str) -> str:
        height = (await self.stops())[storey]
        try:
            done = await self.retry_when_link_lost(lambda: self._link.move_cabin(height))
        except RobotGaveUp as failure:
            is_broken = self._link.silent or not self._link.connected or failure.state is None or bool(failure.state.faults)
            whereabouts = [await self._whereabouts(failure.state)] if failure.state is not None else []
            situation = " AND ".join([*whereabouts, *([self._out_of_order()] if is_broken else [])])
            raise ServiceFailed(failure.description, situation or None) from failure
        return await self._whereabouts(done.state)

    async def _notice_idle(self, state: RobotState, pose: Pose) -> None:
        """Report also where the cabin has come to rest."""
        await super()._notice_idle(state, pose)
        height, self._last_height = self._last_height, state.z
        if height is None or state.z is None or abs(height - state.z) > STANDING:
            return
        whereabouts = await self._whereabouts(state)
        if whereabouts != self._reported_whereabouts:
            if not await self.map.holds(whereabouts):
                self.observed(whereabouts)
            self._reported_whereabouts = whereabouts

    async def _whereabouts(self, state: RobotState) -> str:
        """Where the cabin is, as a formula."""
        assert state.z is not None, "a lift knows where its cabin is"
        position = f"{self.name}.PositionZ = {format_number(state.z)}"
        at_height = [storey for storey, height in (await self.stops()).items() if abs(height - state.z) <= STANDING]
        if at_height:
            return f"{position} AND {self.name} standsAt {at_height[0]}"
        rows = await self.map.query(f"{self.name} standsAt ?Storey")
        return " AND ".join([position, *(f"NOT {self.name} standsAt {row['Storey']}" for row in rows)])
