"""A plan that is being made: first the services on offer are discovered, then the planner is asked, for one that leaves alone what
other tasks have, and keeps what still stands of the plan `before`. When there is none, it is found out whether there would be one
without them: then they have to be waited for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.component import Ask, Withdraw
from somrs.planner.model.plan import NoPlan, Plan
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.directory import Offer
from somrs.task_manager.claims import Held, claim
from somrs.task_manager.offered import Offered
from somrs.task_manager.setting import Setting, problem
from somrs.task_manager.workflow import Progress, Workflow

Made = Callable[[object, float], None]
"""Called with what the planner answered, with who has what is needed, or with a text that says why it could not be asked."""


class Draft:
    """`name` begins the planner's questions, `task` is what transaction `id` wants. A draft that is withdrawn calls nobody.
    `holds`: what the plan needs is the task's from then on."""

    def __init__(
        self,
        name: str,
        id: str,
        task: Submit,
        offered: Offered,
        setting: Setting,
        made: Made,
        before: Workflow | None = None,
        *,
        holds: bool = True,
    ) -> None:
        self.question = name
        self._before, self._holds = before, holds
        self._name, self._id, self._task, self._offered, self._setting = name, id, task, offered, setting
        self._made: Made | None = made
        self._avoided: frozenset[str] = frozenset()
        self._regardless = False
        self._asked = 0

    def begin(self, now: float) -> None:
        self._setting.questions.discover(self._discovered, now)

    def _discovered(self, offers: tuple[Offer, ...] | str, now: float) -> None:
        if self._made is None:
            return
        if isinstance(offers, str):
            self._made(offers, now)
            return
        self._offered.discovered(offers)
        self._avoided = self._setting.claims.taken(self._id)
        self._ask(now)

    def _ask(self, now: float) -> None:
        assert self._made is not None, "a draft that was withdrawn asks nothing"
        avoided = self._avoided if not self._regardless else frozenset()
        try:
            task = problem(self._task, self._setting.replica, self._offered.usable, avoided, self._setting.quotes)
        except FormulaError as error:
            self._made(f"the task does not fit the map any more: {error}", now)
            return
        task = replace(task, lost=tuple(self._offered.lost_to_it))
        if self._before is not None:
            left = self._before.rest
            promised = frozenset(run.step.id for run in left if run.progress is Progress.ARRANGED)
            task = replace(task, rest=tuple(run.step for run in left), promised=promised)
        self._asked += 1
        self.question = self._name if self._asked == 1 else f"{self._name}.{self._asked}"
        self._setting.effects.append(Ask(self.question, task))

    def answered(self, value: object, now: float) -> None:
        """What the planner found."""
        if self._made is None:
            return
        if isinstance(value, NoPlan) and self._avoided and not self._regardless:
            self._regardless = True
            self._ask(now)
        elif isinstance(value, Plan):
            self._found(value, self._made, now)
        else:
            self._made(value, now)

    def _found(self, plan: Plan, made: Made, now: float) -> None:
        claims = self._setting.claims
        wanted = claim(plan.steps, parse(self._task.effect), self._setting.replica.ontology)
        conflicts = claims.conflicts(self._id, wanted)
        if not conflicts:
            if self._holds:
                claims.hold(self._id, wanted)
            made(plan, now)
            return
        met = frozenset[str]().union(*conflicts.values())
        if self._regardless or met <= self._avoided:
            made(Held(claim=wanted, by=conflicts, plan=plan), now)
        else:  # it changes what others rely on, or they have taken it meanwhile
            self._avoided |= met
            self._ask(now)

    def withdraw(self) -> None:
        """It is out of date, or not wanted any more."""
        self._made = None
        self._setting.effects.append(Withdraw(self.question))
