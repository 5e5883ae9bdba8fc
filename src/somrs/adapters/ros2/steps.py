"""Carries out the steps of a binding: goals of actions, calls of services, messages on topics."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping, Sequence

from somrs.adapters.ros2.lines import CancelRejected, Feedback, GoalEnded, GoalStatus, Replied
from somrs.adapters.ros2.session import Session
from somrs.adapters.ros2.settings import Step, full_name
from somrs.adapters.ros2.templates import differences, fill_in
from somrs.devices.road_robot import RobotFailed

FOUND = 5.0
"""How long the server of an action is looked for, s."""


class Steps:
    """Carries out the steps of one robot, one after the other. `hindered` is told why a goal goes on that is to be cancelled."""

    def __init__(self, name: str, session: Session, namespace: str, hindered: Callable[[str | None], None]) -> None:
        self._name, self._session, self._namespace, self._hindered = name, session, namespace, hindered
        self._actions: dict[tuple[str, str], int] = {}
        self._present: dict[tuple[str, str], asyncio.Event] = {}
        self._goals: dict[int, asyncio.Future[GoalEnded]] = {}
        """Those that have not ended; also when nobody waits for them any more."""
        self._is_interrupted = False

    def open(self, steps: Sequence[Step]) -> None:
        """Connect to the actions of the steps."""
        for step in steps:
            if step.action is not None and (step.action, step.type) not in self._actions:
                self._open(step.action, step.type)

    def _open(self, action: str, type: str) -> None:
        is_present = self._present[action, type] = asyncio.Event()

        def on_presence(present: bool) -> None:
            (is_present.set if present else is_present.clear)()

        self._actions[action, type] = self._session.open_action(full_name(action, self._namespace), type, on_presence)

    def close(self) -> None:
        """Disconnect from the actions."""
        for id in self._actions.values():
            self._session.close_action(id)
        self._actions.clear()
        self._present.clear()

    async def interrupt(self) -> None:
        """Cancel the goal of the step in progress, and wait for its end; later steps are not begun."""
        self._is_interrupted = True
        for id in self._goals:
            self._session.cancel_goal(id)
        if self._goals:
            await asyncio.wait([*self._goals.values()])

    async def carry_out(self, steps: Sequence[Step], values: Mapping[str, float | str]) -> None:
        """Carry out the steps. Raises RobotFailed: the step failed, or was interrupted."""
        self._is_interrupted = False
        for step in steps:
            if self._is_interrupted:
                raise RobotFailed("it was interrupted")
            await self._carry_out(step, values)

    async def _carry_out(self, step: Step, values: Mapping[str, float | str]) -> None:
        message = fill_in(step.template, values)
        result = await (self._reach(step, message) if step.action is not None else self._ask(step, message))
        if wrong := differences(step.succeeds, result):
            raise RobotFailed(step.otherwise or f"{step.action or step.service}: {', '.join(wrong)}", is_lost=True)

    async def _reach(self, step: Step, goal: dict[str, object]) -> dict[str, object]:
        assert step.action is not None, "only goals of actions are reached"
        key = (step.action, step.type)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(FOUND):
                await self._present[key].wait()
        if not self._present[key].is_set():
            raise RobotFailed(f"the action {step.action} has no server", is_unsure=True)
        ended: asyncio.Future[GoalEnded] = asyncio.get_running_loop().create_future()

        def observe(report: Feedback | CancelRejected | GoalEnded) -> None:
            if isinstance(report, CancelRejected):
                self._hindered(f"{self._name} goes on with {step.action}: it does not cancel it")
            elif isinstance(report, GoalEnded):
                self._goals.pop(report.id, None)
                self._hindered(None)
                ended.set_result(report)

        id = self._session.send_goal(self._actions[key], goal, observe)
        if not ended.done():
            self._goals[id] = ended
        end = await asyncio.shield(ended)
        if end.status != GoalStatus.SUCCEEDED:
            is_unsure = end.status == GoalStatus.LOST
            reason = "was lost: its server has ended" if is_unsure else f"was {end.status}"
            description = f"the goal of {step.action} {reason}" + (f": {end.problem}" if end.problem else "")
            raise RobotFailed(description, is_lost=end.status != GoalStatus.REJECTED, is_unsure=is_unsure)
        return end.value

    async def _ask(self, step: Step, message: dict[str, object]) -> dict[str, object]:
        """Call a service, or publish a message."""
        replied: asyncio.Future[Replied] = asyncio.get_running_loop().create_future()

        def observe(reply: Replied) -> None:
            if not replied.done():
                replied.set_result(reply)

        name = full_name(step.service or step.topic or "", self._namespace)
        (self._session.call_service if step.service is not None else self._session.publish)(name, step.type, message, observe)
        reply = await replied
        if reply.value is None:
            raise RobotFailed(f"{name}: {reply.problem}")
        return reply.value
