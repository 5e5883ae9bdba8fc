"""The work for traffic in a process beside its program: roadmaps, surveys of the building, and plans."""

from __future__ import annotations

from multiprocessing.connection import Connection
from random import Random

from msgspec import Struct

from somrs.errors import RemoteError
from somrs.kernel.codec import Codec, encode
from somrs.traffic.layout import Layout, lay_out
from somrs.traffic.notices import CloseWays
from somrs.traffic.planner import TrafficPlanner
from somrs.traffic.roadmap import Roadmap
from somrs.traffic.state import PlanTraffic, TrafficPlan
from somrs.traffic.survey import Survey, Surveyed, Surveyor
from somrs.worker import WorkerProcess, answer_questions


class _Survey(Struct, frozen=True, tag=True):
    survey: Survey


class _Plan(Struct, frozen=True, tag=True):
    """`roadmap`: None if it is that of the plan before."""

    problem: PlanTraffic
    roadmap: Roadmap | None


class _LayOut(Struct, frozen=True, tag=True):
    layout: Layout


class _LaidOut(Struct, frozen=True, tag=True):
    roadmap: Roadmap


class _Surveyed(Struct, frozen=True, tag=True):
    """`roadmap`: None if it is that of the survey before."""

    roadmap: Roadmap | None
    closing: CloseWays


class _Planned(Struct, frozen=True, tag=True):
    plan: TrafficPlan


class _Defect(Struct, frozen=True, tag=True):
    text: str


_QUESTIONS: Codec[_Survey | _Plan | _LayOut] = Codec(_Survey | _Plan | _LayOut)
_ANSWERS: Codec[_Surveyed | _Planned | _LaidOut | _Defect] = Codec(_Surveyed | _Planned | _LaidOut | _Defect)


class _Session:
    """What the process has been sent."""

    def __init__(self) -> None:
        self.roadmap: Roadmap | None = None


class TrafficWorker:
    """Answers one question after the other, in a process that starts with the first. A context manager."""

    def __init__(self) -> None:
        self._worker = WorkerProcess("traffic planner", _serve, _Session)
        self._surveyed = Roadmap(places=(), lanes=())

    def __enter__(self) -> TrafficWorker:
        self._worker.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._worker.__exit__(*exception)

    @property
    def pid(self) -> int | None:
        return self._worker.pid

    async def survey(self, survey: Survey) -> Surveyed:
        """The roadmap, and what is closed. Raises RemoteError."""
        answer = _decode(await self._worker.ask(lambda _: encode(_Survey(survey))))
        assert isinstance(answer, _Surveyed), "the answer to a survey"
        if answer.roadmap is not None:
            self._surveyed = answer.roadmap
        return Surveyed(roadmap=self._surveyed, closing=answer.closing)

    async def lay_out(self, layout: Layout) -> Roadmap:
        """The roadmap. Raises RemoteError."""
        answer = _decode(await self._worker.ask(lambda _: encode(_LayOut(layout))))
        assert isinstance(answer, _LaidOut), "the answer to a layout"
        return answer.roadmap

    async def plan(self, problem: PlanTraffic, roadmap: Roadmap) -> TrafficPlan:
        """The next steps of all robots. Raises RemoteError."""

        def pack(session: _Session) -> bytes:
            is_known, session.roadmap = session.roadmap is roadmap, roadmap
            return encode(_Plan(problem, None if is_known else roadmap))

        answer = _decode(await self._worker.ask(pack))
        assert isinstance(answer, _Planned), "the answer to a problem"
        return answer.plan


def _decode(answer: bytes) -> _Surveyed | _Planned | _LaidOut:
    value = _ANSWERS.decode(answer)
    if isinstance(value, _Defect):
        raise RemoteError(value.text)
    return value


class _Work:
    """What the process remembers."""

    def __init__(self) -> None:
        self._surveyor = Surveyor()
        self._planner: TrafficPlanner | None = None
        self._surveyed: Roadmap | None = None

    def answer(self, question: bytes) -> bytes:
        try:
            return encode(self._answer(_QUESTIONS.decode(question)))
        except Exception as error:  # noqa: BLE001  # any defect becomes the reply; the program reports it
            return encode(_Defect(str(error) or type(error).__name__))

    def _answer(self, question: _Survey | _Plan | _LayOut) -> _Surveyed | _Planned | _LaidOut:
        if isinstance(question, _LayOut):
            return _LaidOut(lay_out(question.layout.building, question.layout.kinds))
        if isinstance(question, _Survey):
            surveyed = self._surveyor.survey(question.survey)
            is_known, self._surveyed = surveyed.roadmap is self._surveyed, surveyed.roadmap
            return _Surveyed(None if is_known else surveyed.roadmap, surveyed.closing)
        if question.roadmap is not None:
            self._planner = TrafficPlanner(question.roadmap, Random())
        assert self._planner is not None, "the first problem has a roadmap"
        return _Planned(self._planner.plan(question.problem))


def _serve(questions: Connection) -> None:
    answer_questions(questions, _Work().answer)
