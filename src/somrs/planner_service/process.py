"""The planner in a process beside the Task Manager's, so that planning does not block the Task Manager. A killed process is restarted."""

from __future__ import annotations

from multiprocessing.connection import Connection
from typing import Self

from msgspec import Struct

from somrs.errors import RemoteError
from somrs.kernel.codec import Codec, encode
from somrs.planner.model.plan import NoPlan, Plan
from somrs.planner.model.problem import Problem
from somrs.planner_service.engines import plan_in_process
from somrs.planner_service.problem_delta import ProblemDelta, Recipient, Sender
from somrs.worker import WorkerProcess, answer_questions


class Defect(Struct, frozen=True, tag=True):
    """The message of an exception that the planner raised."""

    text: str


_DELTA_CODEC: Codec[ProblemDelta] = Codec(ProblemDelta)
_ANSWER_CODEC: Codec[Plan | NoPlan | Defect] = Codec(Plan | NoPlan | Defect)


class PlannerProcess:
    """Plans one problem after the other. A context manager; the process starts with the first problem. Engines are in its process group."""

    def __init__(self) -> None:
        self.worker = WorkerProcess("planner", _serve, Sender)

    @property
    def pid(self) -> int | None:
        return self.worker.pid

    async def plan(self, problem: Problem) -> Plan | NoPlan:
        """A plan, or why there is none. Raises RemoteError when the planner raises an exception or its process ends repeatedly."""
        answer = _ANSWER_CODEC.decode(await self.worker.ask(lambda sender: encode(sender.pack(problem))))
        if isinstance(answer, Defect):
            raise RemoteError(answer.text)
        return answer

    def __enter__(self) -> Self:
        self.worker.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self.worker.__exit__(*exception)


def _serve(questions: Connection) -> None:
    """The main function of the process."""
    recipient = Recipient()

    def answer(question: bytes) -> bytes:
        result: Plan | NoPlan | Defect
        try:
            result = plan_in_process(recipient.unpack(_DELTA_CODEC.decode(question)))
        except Exception as error:  # noqa: BLE001  # any defect becomes the reply; the Task Manager reports it
            result = Defect(str(error) or type(error).__name__)
        return encode(result)

    answer_questions(questions, answer)
