"""The driver of a simulated stationary camera, which reports the positions of the objects that it sees."""

from __future__ import annotations

import time

from somrs.devices.simulator.drivers.looking import describe_things
from somrs.devices.simulator.drivers.recognition import Search
from somrs.devices.simulator.drivers.watching import WatchingDevice
from somrs.devices.simulator.link.commands import CommandDone, Likeness
from somrs.entish.formula import Formula
from somrs.errors import RemoteError
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Result, Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed


async def _able(device: FixedCamera, task: Task) -> None:
    """Check that the camera works, and that the object is in view now. Raises Refusal."""
    await device.check_working()
    search = await Search.begin(device, task)
    view, _ = await device.view(search.like)
    if not any(sighting.alike for sighting in view.sightings) and all(state.object != search.object for state in view.object_states):
        raise Refusal(f"{device.name} does not see {search.object}", not_now=True)


async def _able_to_look(device: FixedCamera, task: Task) -> None:
    """Check that the camera works, and that the place is in view now. Raises Refusal."""
    await device.check_working()
    place = str(task.inputs["Place"])
    view, _ = await device.view(None)
    if place not in [state.object for state in view.object_states]:
        raise Refusal(f"{device.name} does not see {place}")


class FixedCamera(WatchingDevice):
    """A stationary camera in the simulator. It also reports by itself what it notices."""

    type = "Camera"
    features = ("OperationRange", "FieldOfView", "Price")
    mobile = False

    async def view(self, like: Likeness | None) -> tuple[CommandDone, float]:
        """What it sees now, and the time at which it looked; `like`: what it looks for. Raises Refusal when the camera does not answer."""

        async def look() -> tuple[CommandDone, float]:
            looked_at = time.time()
            return await self._link.sense(like=like), looked_at

        try:
            return await self.retry_when_link_lost(look)
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}", not_now=True) from None

    @service("RecognizeSituation", price=WatchingDevice.price, duration="1 s", able=_able, inputs=("Object",))
    async def recognize(self, task: Task) -> Result:
        search = await Search.begin(self, task)
        try:
            view, looked_at = await self.view(search.like)
            await search.note(view, looked_at, looked_at)
        except Refusal as silent:
            raise ServiceFailed(str(silent), self._out_of_order()) from None
        if search.situation is None:
            sees = f"sees something like {search.object}, which is another object" if search.mistaken else f"no longer sees {search.object}"
            raise ServiceFailed(f"{self.name} {sees}")
        return Result(situation=search.situation, observation=search.observation)

    @service("LookAt", price=WatchingDevice.price, duration="1 s", able=_able_to_look, inputs=("Place",), outputs=("Thing",))
    async def look_at_place(self, task: Task) -> Result:
        try:
            view, looked_at = await self.view(None)
        except Refusal as silent:
            raise ServiceFailed(str(silent), self._out_of_order()) from None
        situation = " AND ".join(describe_things(str(task.inputs["Place"]), view.sightings) or [f"{self.name}.Working = TRUE"])
        return Result(situation=situation, observation=Observation(as_of=looked_at))

    @recognize.compensation
    @look_at_place.compensation
    async def compensate_recognition(self, task: Task, situation: Formula) -> Situation:
        """An observation leaves nothing to undo."""
        return f"{self.name}.Working = TRUE"
