"""The common parts of both SO-MRS contestants of `coordination.py`: a site, its carriers, and plans without a search."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Awaitable, Callable
from pathlib import Path

from contestants.contest import BIDDERS, MAX_CONVERSATIONS
from somrs.entish.formula import Name, Relation, Term, substitute
from somrs.entish.parse import parse
from somrs.ontology.files.loaded import LoadedModel
from somrs.ontology.files.loading import load_text
from somrs.ontology.map import Map
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.planner.model.problem import Problem
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.directory import Discover, Discovered
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit, Submitted
from somrs.protocol.messages.task_news import TaskNews, WatchTask
from somrs.service_manager.sdk.device import Device, Situation, Task, service

CARRIERS = tuple(f"Robot{number + 1}" for number in range(BIDDERS))
PLACES = ("Cupboard001", "Platform001")
EVENT_LIMIT = 1_000_000
"""More events than a task has, so that a request for later events waits for the task's end."""


def site() -> str:
    """Return a site with a jar for each simultaneous conversation, and the carriers."""
    jars = "\n".join(f"  Jar{line}: {{type: Jar, at: [1, {line / 10}, 0.8]}}" for line in range(MAX_CONVERSATIONS))
    robots = "\n".join(f"  {name}: {{type: PioneerP3DX, at: [{number / 2 + 2}, 3]}}" for number, name in enumerate(CARRIERS))
    facts = "\n".join(f"  - Jar{line} isOn {PLACES[0]}" for line in range(MAX_CONVERSATIONS))
    return f"""
map: Test
objects:
  Building001:
    type: Building
    parts:
      Storey001:
        type: Storey
        parts:
          Floor001: {{type: Floor, at: [0, 0, -0.1], Shape: {{Form: Box, Width: 20, Depth: 20, Height: 0.1}}}}
  Cupboard001: {{type: Cupboard, at: [1, 1, 0], Shape: {{Form: Box, Width: 0.5, Depth: 3, Height: 0.8}}}}
  Platform001: {{type: Platform, at: [8, 2, 0], Shape: {{Form: Box, Width: 3, Depth: 3, Height: 0.3}}}}
{jars}
{robots}
facts:
{facts}
"""


def site_loaded() -> LoadedModel:
    loaded = load_text(site(), "site.yaml")
    assert loaded.map is not None, "the site has objects"
    return loaded


class Carrier(Device):
    """Carries a jar in no time. Its price differs from one order to the next, so that each carrier gets some contracts."""

    type = "PioneerP3DX"
    capacity = MAX_CONVERSATIONS
    lease = 600.0

    def __init__(self, name: str, simulator: str | None = None) -> None:
        super().__init__(name, simulator)
        self._quoted = int(name.removeprefix("Robot"))

    def cost(self, task: Task) -> float:
        self._quoted += 1
        return float(self._quoted % 10)

    @service("TransferObject", price=cost, duration=1.0)
    async def carry(self, task: Task) -> Situation:
        return None

    @carry.stopping
    async def stop_carrying(self, task: Task) -> Situation:
        return None


def one_step(problem: Problem) -> Plan | NoPlan:
    """Return the plan that a search would find: to carry the jar to the place in the goal, if somebody offers that already."""
    assert isinstance(problem.goal, Relation), problem.goal
    jar, place = problem.goal.arguments
    offered = {available.service_type.name: available.service_type for available in problem.services}
    if (service_type := offered.get("TransferObject")) is None:
        return NoPlan("nobody offers it")
    inputs: dict[str, Term] = {"Object": jar, "Destination": place}
    source = Name(_other_place(str(place)))
    assert service_type.precondition is not None, "the precondition names the thing's place"
    return Plan(
        steps=(
            Step(
                id="s1",
                service_type=service_type.name,
                inputs=inputs,
                effect=substitute(parse(service_type.effect), inputs),
                precondition=substitute(parse(service_type.precondition), {**inputs, "Source": source}),
            ),
        )
    )


def _other_place(place: str) -> str:
    return PLACES[1 - PLACES.index(place)]


Ask = Callable[[Message], Awaitable[Message]]
"""Sends a message to its address, and returns the answer."""


class Lines:
    """The clients: each has its own jar, and submits tasks that carry it back and forth."""

    def __init__(self, ask: Ask, task_manager: str) -> None:
        self._ask, self._task_manager = ask, task_manager
        self._next_places = [1] * MAX_CONVERSATIONS

    async def converse(self, line: int) -> None:
        place = PLACES[self._next_places[line]]
        self._next_places[line] = 1 - self._next_places[line]
        submitted = await self._answer(self._task_manager, Submit(effect=f"Jar{line} isOn {place}"))
        assert isinstance(submitted, Submitted), submitted
        news = await self._answer(self._task_manager, WatchTask(task=submitted.task, after=EVENT_LIMIT, wait=60.0))
        assert isinstance(news, TaskNews), news
        assert news.view.outcome is Outcome.ACCOMPLISHED, news.view

    async def until_offered(self, registry: str) -> None:
        """Return when all carriers have joined."""
        while True:
            answer = await self._answer(registry, Discover())
            if isinstance(answer, Discovered) and len(answer.offers) == len(CARRIERS):
                return
            await asyncio.sleep(0.05)

    async def _answer(self, recipient: str, body: Body) -> Body:
        header = Header(sender=ANONYMOUS, recipient=recipient, message_id=uuid.uuid4().urn)
        return (await self._ask(Message(header=header, body=body))).body


def map_of(loaded: LoadedModel) -> Map:
    assert loaded.map is not None, "the site has objects"
    return loaded.map


def folder(data: Path, name: str) -> Path:
    subfolder = data / name
    subfolder.mkdir(exist_ok=True)
    return subfolder
