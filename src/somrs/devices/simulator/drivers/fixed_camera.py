"""The driver of a simulated stationary camera, which reports the positions of the objects that it sees."""

from __future__ import annotations

from somrs.devices.simulator.drivers.looking import describe_things
from somrs.devices.simulator.drivers.recognition import Search
from somrs.devices.simulator.drivers.watching import WatchingDevice
from somrs.devices.simulator.link.commands import CommandDone, Likeness
from somrs.entish.formula import Formula
from somrs.errors import RemoteError
from somrs.service_manager.sdk.device import Situation, Task, service
from somrs.service_manager.sdk.orders import Refusal, ServiceFailed


async def _able(device: FixedCamera, task: Task) -> None:
    """Check that the camera works, and that the object is in view now. Raises Refusal."""
    await device.check_working()
    search = await Search.begin(device, task)
    view = await device.view(search.like)
    if not any(sighting.alike for sighting in view.sightings) and all(state.object != search.object for state in view.object_states):
        raise Refusal(f"{device.name} does not see {search.object}", not_now=True)


async def _able_to_look(device: FixedCamera, task: Task) -> None:
    """Check that the camera works, and that the place is in view now. Raises Refusal."""
    await device.check_working()
    place = str(task.inputs["Place"])
    if place not in [state.object for state in (await device.view(None)).object_states]:
        raise Refusal(f"{device.name} does not see {place}")


class FixedCamera(WatchingDevice):
    """A stationary camera in the simulator. It also reports by itself what it notices."""

    type = "Camera"
    features = ("OperationRange", "FieldOfView", "Price")
    mobile = False

    async def view(self, like: Likeness | None) -> CommandDone:
        """What it sees now; `like`: what it looks for. Raises Refusal when the camera does not answer."""
        try:
            return await self.retry_when_link_lost(lambda: self._link.sense(like=like))
        except RemoteError as error:
            raise Refusal(f"{self.name} does not answer: {error}", not_now=True) from None

    @service("RecognizeSituation", price=WatchingDevice.price, duration="1 s", able=_able, inputs=("Object",))
    async def recognize(self, task: Task) -> Situation:
        search = await Search.begin(self, task)
        try:
            await search.note(await self.view(search.like))
        except Refusal as silent:
            raise ServiceFailed(str(silent), self._out_of_order()) from None
        if search.situation is None:
            sees = f"sees something like {search.object}, which is another object" if search.mistaken else f"no longer sees {search.object}"
            raise ServiceFailed(f"{self.name} {sees}")
        return search.situation

    @service("LookAt", price=WatchingDevice.price, duration="1 s", able=_able_to_look, inputs=("Place",), outputs=("Thing",))
    async def look_at_place(self, task: Task) -> Situation:
        try:
            view = await self.view(None)
        except Refusal as silent:
            raise ServiceFailed(str(silent), self._out_of_order()) from None
        return " AND ".join(describe_things(str(task.inputs["Place"]), view.sightings) or [f"{self.name}.Working = TRUE"])

    @recognize.compensation
    @look_at_place.compensation
    async def compensate_recognition(self, task: Task, situation: Formula) -> Situation:
        """An observation leaves nothing to undo."""
        return f"{self.name}.Working = TRUE"
