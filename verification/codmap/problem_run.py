"""Runs one problem from its files to its end: import, planning, arrangement, execution, and the check against the world."""

from __future__ import annotations

import gc
import time
from functools import partial
from pathlib import Path

from somrs.devices.symbolic.agent import SymbolicAgent
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.errors import SomrsError
from somrs.kernel.component import Effect, Input, Received
from somrs.ontology.objects import Fact, FactAdded, ObjectAdded
from somrs.ontology.truth import formula_holds
from somrs.ontology.types import PART_OF
from somrs.planner.model.plan import NoPlan, Plan, Step
from somrs.planner.model.problem import AvailableService, Problem
from somrs.planner_service.engines import plan_in_process
from somrs.protocol.messages.envelope import Header, Message
from somrs.protocol.messages.event_text import join_reasons, sentence
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.submission import Policy, Submit, Submitted
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.virtual_time import CarryOut, Work, World
from somrs.service_manager.participant.participant import ServiceManager
from somrs.service_manager.sdk.orders import Profile
from somrs.sites.pddl import ImportedProblem, classical, read
from somrs.task_manager.manager import TaskManager
from somrs.task_manager.transaction.state import TaskState
from verification.codmap.agents import STEP_TIME, Observer, TimedAgent
from verification.codmap.faults import Faults
from verification.codmap.referee import objections
from verification.codmap.result import Result

FOREVER = 1e9
"""Seconds."""

LONGEST = 30 * 86_400.0
"""Seconds of virtual time within which a task has to end."""


class Client:
    """Submits the task once the services are known."""

    def __init__(self) -> None:
        self.task = ""

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received) and isinstance(event.message.body, Submitted):
            self.task = event.message.body.task
        return []


class ProblemRun:
    """The whole system for one problem, on virtual time."""

    def __init__(self, imported: ImportedProblem, faults: Faults, limit: float) -> None:
        self.imported, self.faults, self.limit = imported, faults, limit
        self.truth = SymbolicWorld(imported.ontology, imported.map)
        self.plans: list[Plan | NoPlan] = []
        self.planning = 0.0
        self.world = World(watch=self._watch)
        self.client = Client()
        self.timed_agents: dict[str, TimedAgent] = {}
        world, ontology = self.world, imported.ontology
        map, observer = imported.map, Observer(world=self.truth)
        if faults.share:
            map = map.changed([ObjectAdded(observer.person), FactAdded(Fact(PART_OF, (observer.name, next(iter(map.roots())))))])
        world.add("repository", Repository("repository", Contents(ontology=ontology, map=map)))
        world.add("registry", Registry("registry", ontology, "repository"))
        world.add("client", self.client)
        for name, services in imported.agents.items():
            agent = SymbolicAgent(name=name, world=self.truth, services=services, faults=partial(faults.mishap, name), seconds=STEP_TIME)
            timed_agent = self.timed_agents[name] = TimedAgent(agent=agent, now=lambda: world.now)
            self._join(agent.profile(lease=FOREVER, valid_for=FOREVER), timed_agent.carry_out)
        if faults.share:
            self._join(observer.profile, observer.carry_out)
        world.add("tm", TaskManager("tm", repository="repository", registry="registry"), self._plan)
        world.run(5)

    def _join(self, profile: Profile, carry_out: CarryOut) -> None:
        manager = ServiceManager(profile, repository="repository", registry="registry")
        self.world.add(f"devices/{profile.name}", manager, carry_out)

    def _watch(self, address: str, event: Input) -> None:
        """Kill the Service Manager of an agent that has left."""
        name = address.removeprefix("devices/")
        if name in self.timed_agents and self.timed_agents[name].agent.is_offline and self.world.alive(address):
            self.world.kill(address)

    @property
    def transaction(self) -> TaskState | None:
        manager = self.world.components["tm"]
        assert isinstance(manager, TaskManager)
        return manager.state.tasks.get(self.client.task)

    def run(self) -> TaskState | None:
        """Return the task once it has ended or is given up, or None if neither happens. Fault runs check the compensation."""
        header = Header(sender="client", recipient="tm", message_id="client/task", reply_to="client")
        self.world.send(Message(header=header, body=Submit(effect=str(self.imported.goal), policy=Policy.TIME)))

        def has_ended() -> bool:
            return (transaction := self.transaction) is not None and (transaction.outcome is not None or transaction.ending is not None)

        return self.transaction if self.world.run(LONGEST, has_ended) else None

    def _plan(self, task: object) -> Work:
        assert isinstance(task, Problem), "a Task Manager's only background work is planning"
        started_at = time.perf_counter()
        plan = plan_in_process(task, self.limit)
        self.planning += time.perf_counter() - started_at
        self.plans.append(plan)
        yield 0.0, plan

    def still_possible(self) -> Plan | NoPlan:
        """Plan from the current state of the world to the goal, with the agents that are left."""
        start, departed = self.imported.problem(), {name for name, timed_agent in self.timed_agents.items() if timed_agent.agent.is_offline}
        services = tuple(
            AvailableService(available.service_type, tuple(name for name in available.providers if name not in departed))
            for available in start.services
        )
        return plan_in_process(Problem(ontology=start.ontology, map=self.truth.map, goal=start.goal, services=services), self.limit)


def run_problem(place: Path, limit: float, share: float = 0.0, seed: int = 0) -> Result:
    """Run the problem in the folder `place`, with `domain.pddl` and `problem.pddl`. `limit`: seconds to find the first plan."""
    result = Result(domain=place.parent.name, problem=place.name)
    started_at = time.perf_counter()
    try:
        imported = read(place / "domain.pddl", place / "problem.pddl")
    except SomrsError as error:
        result.trouble = str(error)
        return result
    result.importing = time.perf_counter() - started_at
    result.agents = len(imported.agents)
    faults = Faults(share, f"{seed}/{result.name}", [*imported.agents])
    problem_run = ProblemRun(imported, faults, limit - result.importing)
    gc.collect()
    started_at = time.perf_counter()
    transaction = problem_run.run()
    whole = time.perf_counter() - started_at
    _note(result, problem_run, transaction, whole)
    result.trouble = _trouble(result, problem_run, transaction, place)
    return result


def _note(result: Result, problem_run: ProblemRun, transaction: TaskState | None, whole: float) -> None:
    first = problem_run.plans[0] if problem_run.plans else None
    result.planning = result.importing + problem_run.planning
    result.coordinating = whole - problem_run.planning
    result.plans, result.messages = len(problem_run.plans), len(problem_run.world.messages)
    result.mishaps, result.leaver = problem_run.faults.mishaps, problem_run.faults.leaver if problem_run.faults.has_departed else None
    if isinstance(first, Plan):
        result.steps = len(first.steps)
        result.cost = sum(_cost(problem_run, step) for step in first.steps)
    if transaction is None:
        return
    result.notes = [
        f"{event.at - transaction.submitted_at:9.1f} {event.step or '':14} {sentence(event.event)}" for event in transaction.events
    ]
    result.accomplished = transaction.outcome is Outcome.ACCOMPLISHED
    times = [time for timed_agent in problem_run.timed_agents.values() for time in timed_agent.times]
    if result.accomplished and times:
        result.makespan = round((max(times) - min(times)) / STEP_TIME, 1)


def _trouble(result: Result, problem_run: ProblemRun, transaction: TaskState | None, place: Path) -> str:
    """Return the reason why the problem did not pass, or an empty string."""
    first = problem_run.plans[0] if problem_run.plans else None
    if transaction is None:
        return "the task did not come to an end"
    if not isinstance(first, Plan):
        return first.explanation if first is not None else f"nothing was planned: {join_reasons(transaction.reasons)}"
    wrong = objections(*classical(place / "domain.pddl", place / "problem.pddl"), problem_run.imported.pddl_plan(first.topological()))
    if wrong:
        return "; ".join(wrong)
    if (twice := _twice(transaction)) is not None:
        return f"two participants executed {twice}"
    if not problem_run.faults.share and problem_run.truth.rejected:
        return f"the world rejected {problem_run.truth.rejected[0]}"
    reached = formula_holds(problem_run.imported.goal, problem_run.truth.map, problem_run.imported.ontology)
    if result.accomplished:
        return "" if reached else "the task was accomplished, but the goal does not hold in the world"
    if not problem_run.faults.share:
        return join_reasons(transaction.reasons)
    rest = problem_run.still_possible()
    if isinstance(rest, Plan):
        return f"given up ({join_reasons(transaction.reasons)[:200]}), although {len(rest.steps)} more steps reach the goal"
    if rest.undecided:
        return f"given up, and the planner cannot decide whether the goal is out of reach: {rest.explanation}"
    result.out_of_reach = True
    return ""


def _twice(transaction: TaskState) -> str | None:
    """Return a step that was completed twice, or None."""
    completed: set[str] = set()
    for work in transaction.log:
        if work.state is State.COMPLETED:
            if work.key in completed:
                return f"{work.label} ({work.step})"
            completed.add(work.key)
    return None


def _cost(problem_run: ProblemRun, step: Step) -> float:
    inputs = {name: str(term) for name, term in step.inputs.items()}
    return problem_run.truth.cost(step.service_type, inputs, step.provider or next(iter(problem_run.timed_agents)))
