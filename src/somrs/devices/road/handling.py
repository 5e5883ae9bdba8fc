"""How a robot of any make takes things, puts them on supports, and gets rid of what it must not keep."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from somrs.devices.road.building import Building, Stand
from somrs.devices.road.gripper import THIS_SPOT, Gripper
from somrs.devices.road.hardware import RobotFailed, Vehicle
from somrs.devices.road.traveller import Traveller
from somrs.devices.simulator.link.commands import ObjectState
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.space.solids import Point, Role

log = logging.getLogger(__name__)

MOST_SUPPORTS = 5
"""To how many supports it brings a thing that it cannot put down where it stands, until one takes it."""
ELSEWHERE = ("blocked", "unreachable", "unknown-object", "not-possible")
"""Reasons for which it cannot put something at one place, and may at another."""

Reach = Callable[[str], Coroutine[Any, Any, Stand]]
"""Drives to where an object is within reach, unless the robot stands there. Raises RobotGaveUp."""


class Handling:
    """The things that one robot takes and puts. `is_lost`: whether the thing that it was to take may be somewhere else now."""

    def __init__(self, robot: Vehicle, gripper: Gripper, traveller: Traveller, reach: Reach) -> None:
        self._robot, self._gripper, self._traveller, self._reach = robot, gripper, traveller, reach
        self.is_lost = False
        self._ending: asyncio.Task[None] | None = None
        traveller.on_return = self._return_back

    def _return_back(self) -> None:
        """The robot can be reached again."""
        if self._gripper.is_working and (self._ending is None or self._ending.done()):
            self._ending = asyncio.create_task(self._end_work())

    async def _end_work(self) -> None:
        """End what the robot works on and nobody waits for, so that what it says of its gripper counts."""
        await self._robot.interrupt()
        self._gripper.is_working = False
        self._traveller.renew_state()

    async def settled(self) -> None:
        """Wait until it is known what the robot holds, after its program or its connection had ended while it worked."""
        self._return_back()
        if self._ending is not None:
            await asyncio.wait({self._ending})

    async def work(self, activity: str, work: Coroutine[object, object, object]) -> None:
        """Let the robot work where it stands: nobody asks it to make room. Raises RobotGaveUp."""
        traveller, gripper = self._traveller, self._gripper
        traveller.activity = activity
        traveller.tell_mobility()
        try:
            await work
        except RobotFailed as failure:
            self.is_lost = failure.is_lost
            if failure.is_unsure:
                gripper.leave()
                raise RobotGaveUp("link-lost", failure.description, traveller.state) from None
            gripper.end(is_lost=self.is_lost)
            raise self._problem(failure.description) from None
        except asyncio.CancelledError:
            if traveller.connected.is_set():
                await asyncio.shield(self._robot.interrupt())
                self.is_lost = False
                gripper.end()
            raise
        finally:
            traveller.activity = None
            traveller.tell_mobility()
            traveller.renew_state()

    async def grip(self, thing: str) -> ObjectState:
        """Take a thing. Raises RobotGaveUp."""
        await self._reach(thing)
        building = await self._traveller.building()
        origin, (x, y, z, yaw) = building.support_of(thing), building.pose(thing)
        self.is_lost = True  # for who cannot be asked any more
        self._gripper.begin_pick(thing, origin)
        await self.work("Grip", self._robot.pick(thing, origin or ""))
        self.is_lost = False
        self._gripper.hold(thing, origin)
        return ObjectState(object=thing, x=x, y=y, z=z, yaw=yaw, held_by=self._robot.name)

    async def place(self, support: str) -> ObjectState:
        """Put what it holds on a support. Raises RobotGaveUp."""
        thing, held = self._held_thing(f"put on {support}"), self._gripper.held
        if held is not None and self._gripper.has_dropped:
            state = self._dropped(await self._traveller.building(), thing, held.target or THIS_SPOT)
            if held.target == support:
                return state
            raise RobotGaveUp("not-holding", f"{self._robot.name} has put {thing} down already", self._traveller.state, (state,))
        if held is not None and self._gripper.is_unsure and (held.target or held.origin) != support:
            await self._take_again(await self._make_sure())
        return await self._drop(thing, support)

    async def _take_again(self, state: ObjectState) -> None:
        """Take a thing from where the robot has just put it: the map does not have it there yet. Raises RobotGaveUp, with where it is."""
        noted = self._robot.building.noted
        noted[state.object] = state
        try:
            await self.grip(state.object)
        except RobotGaveUp as failure:
            raise RobotGaveUp(failure.reason, failure.description, failure.state, failure.object_states or (state,)) from None
        finally:
            del noted[state.object]

    async def put_down(self) -> ObjectState:
        """Get rid of what it holds: put it down where the robot stands, or, if it cannot, bring it back to where it was, or to the nearest
        support that takes it. Raises RobotGaveUp."""
        thing, held = self._held_thing("put down"), self._gripper.held
        if held is not None and self._gripper.has_dropped:
            return self._dropped(await self._traveller.building(), thing, held.target or THIS_SPOT)
        if self._gripper.is_unsure:
            return await self._make_sure()
        try:
            return await self._set_down(thing)
        except RobotGaveUp as failure:
            if failure.reason != "not-possible" or self._robot.holding is None:
                raise
            return await self._bring_back(thing, failure)

    def _held_thing(self, purpose: str) -> str:
        thing = self._robot.holding
        if thing is None:
            raise RobotGaveUp("not-holding", f"{self._robot.name} holds nothing that it could {purpose}", self._traveller.state)
        return thing

    async def _drop(self, thing: str, support: str) -> ObjectState:
        """Put what it holds on a support."""
        stand, building = await self._reach(support), await self._traveller.building()
        is_unsure = self._gripper.is_unsure
        self._gripper.begin_drop(thing, support)
        self._robot.spot = stand.spot
        try:
            await self.work("Place", self._robot.drop(thing, support))
        except RobotGaveUp as failure:
            if not is_unsure or failure.reason != "not-possible":
                raise
            log.warning("%s cannot put %s on %s, so that it is taken to be there: %s", self._robot.name, thing, support, failure)
        return self._release(_put(building, thing, support, stand.spot))

    async def _set_down(self, thing: str) -> ObjectState:
        """Put what it holds down where the robot stands."""
        building, spots = await self._traveller.building(), list[tuple[float, float, float, str]]()

        async def put_down() -> None:
            spots.append(await self._robot.put_down(thing))

        self._gripper.begin_drop(thing, THIS_SPOT)
        await self.work("PutDown", put_down())
        ((x, y, z, place),) = spots
        if place in building.solids:
            return self._release(ObjectState(object=thing, x=x, y=y, z=z, yaw=0.0, support=place))
        return self._release(_laid(building, thing, (x, y), z))

    async def _make_sure(self) -> ObjectState:
        """Put the thing of which nobody knows whether the robot holds it where it is otherwise: then it is there in either case."""
        held = self._gripper.held
        assert held is not None, "who is unsure has picked something"
        if held.target == THIS_SPOT:
            return await self._set_down(held.thing)
        support = held.target or held.origin
        if support is None:
            problem = self._problem(f"the map does not say from where {self._robot.name} took {held.thing}")
            return await self._bring_back(held.thing, problem)
        return await self._drop(held.thing, support)

    async def _bring_back(self, thing: str, problem: RobotGaveUp) -> ObjectState:
        """Put what it holds on the support from which it was taken, or on the nearest one that takes it. `problem`: why it cannot be put
        down here."""
        for support in [*self._supports(await self._traveller.building())][:MOST_SUPPORTS]:
            try:
                return await self._drop(thing, support)
            except RobotGaveUp as failure:
                if failure.reason not in ELSEWHERE or self._robot.holding is None:
                    raise
                problem = failure
        raise self._problem(f"{self._robot.name} can put {thing} down nowhere: {problem.description}")

    def _supports(self, building: Building) -> Iterator[str]:
        """Where a thing can be put: from where it was taken, and then the nearest."""
        held = self._gripper.held
        origin = held.origin if held is not None else None
        if origin is not None and origin in building.solids and building.solids[origin].role in (Role.SUPPORT, Role.MARK):
            yield origin
        yield from (name for name in building.supports_near(self._traveller.driver()) if name != origin)

    def _dropped(self, building: Building, thing: str, target: str) -> ObjectState:
        """Say where the thing is that was put down when nobody heard of it."""
        state, level = self._traveller.state, self._traveller.level
        assert state is not None, "a robot that says what it carries was located"
        point = state.x, state.y
        if target == THIS_SPOT:
            return self._release(_laid(building, thing, point, level))
        return self._release(_put(building, thing, target, building.spot_on(target, point)))

    def _release(self, put: ObjectState) -> ObjectState:
        """What it held is there now."""
        self._gripper.release(put)
        self._traveller.renew_state()
        return put

    def _problem(self, description: str) -> RobotGaveUp:
        return RobotGaveUp("not-possible", description, self._traveller.state)


def _put(building: Building, thing: str, support: str, spot: Point) -> ObjectState:
    """A thing that is on a support, at a point."""
    return ObjectState(object=thing, x=spot[0], y=spot[1], z=building.top_of(support), yaw=0.0, support=support)


def _laid(building: Building, thing: str, point: Point, level: float) -> ObjectState:
    """A thing that was laid down at a point of a floor: on the piece of furniture that stands there, if one does."""
    support = building.support_at(point, level)
    z = building.top_of(support) if support is not None else level
    return ObjectState(object=thing, x=point[0], y=point[1], z=z, yaw=0.0, support=support or building.floor_at(*point, level))
