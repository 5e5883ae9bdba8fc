"""The previews that a Task Manager makes, for clients and for its own tasks that compare plans. `preview.py` has the work on one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from somrs.kernel.component import Effects, EffectsReturning, Send
from somrs.protocol.messages import previews
from somrs.protocol.messages.envelope import Message, message_id, reply
from somrs.task_manager.context import TaskManagerContext, find_task_error
from somrs.task_manager.preview import PreviewExecutor
from somrs.task_manager.preview_state import new_preview, preview_of_plan
from somrs.task_manager.state import TaskManagerState
from somrs.task_manager.transaction.views import preview_reply

PreviewWork = Callable[[PreviewExecutor], EffectsReturning[previews.Previewed | None]]
PlanQuoted = Callable[[str, str, previews.Previewed, float], Effects]
"""Tells a task that the preview of a plan of its own has ended: the task, the preview, its answer, the time."""


class RunningPreviews:
    """Begins, continues and answers previews. It has no state of its own."""

    def __init__(self, state: TaskManagerState, context: TaskManagerContext, plan_quoted: PlanQuoted) -> None:
        self._state, self._context, self._plan_quoted = state, context, plan_quoted

    def begin(self, message: Message, query: previews.Preview, now: float) -> Effects:
        """Begin the preview that a client requests, unless it runs already."""
        state, id = self._state, message_id("preview", message.header.message_id)
        if id not in state.previews:
            preview = new_preview(id, query, message)
            if (task_error := find_task_error(preview.task, state.replica)) is not None:
                yield self._reply(message, preview_reply(str(task_error)))
            else:
                state.previews[id] = preview
                yield from self.advance(id, now, lambda preview: preview.begin(now))

    def advance(self, id: str, now: float, work: PreviewWork) -> Effects:
        """Continue a preview. Who wants it receives the answer when it has ended."""
        preview = self._state.previews[id]
        answer = yield from work(PreviewExecutor(preview, self._context))
        if answer is None:
            return
        if preview.request is not None:
            yield self._reply(preview.request, answer)
        elif preview.owner in self._state.previews:
            yield from self.advance(preview.owner, now, lambda owner: owner.rival_ended(id, answer, now))
        elif preview.owner in self._state.tasks:
            yield from self._plan_quoted(preview.owner, id, answer, now)

    def quote_plans(self, now: float) -> Effects:
        """Ask services for terms for the plans that tasks and previews compare."""
        while self._context.plans_to_quote:
            quoted = self._context.plans_to_quote.pop(0)
            self._state.previews[quoted.id] = preview_of_plan(quoted)
            yield from self.advance(quoted.id, now, partial(PreviewExecutor.begin_with_plan, plan=quoted.plan, now=now))

    def forget_ended(self) -> None:
        """Forget the previews that have ended."""
        for id in [id for id, preview in self._state.previews.items() if preview.ended]:
            del self._state.previews[id]

    def _reply(self, request: Message, body: previews.Previewed) -> Send:
        return Send(reply(request, body, self._state.requests.address))
