"""Objects of a running task that have another name on the map now: they were renamed, or turned out to be other objects.

What the task still has to do speaks of them by their new names. Services that are at work know the old names: the Repository understands
their reports, and the plan is made anew when they have ended.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.entish import Formula
from somrs.entish.formula import names as names_in
from somrs.entish.parse import parse
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology
from somrs.protocol.messages.submission import with_formulas
from somrs.task_manager.execution.workflow import Progress, StepRun
from somrs.task_manager.recovery.observation import LookQueue
from somrs.task_manager.transaction.state import GoalExecution, TaskState


class TaskRenamer:
    """Gives objects their new names in the state of a task. `names`: the new names by the old ones."""

    def __init__(self, names: Mapping[str, str], ontology: Ontology) -> None:
        self._names = names
        self._renamer = Renamer((Renaming(section=Section.OBJECTS, name=name, to=to) for name, to in names.items()), ontology)

    def rename(self, state: TaskState) -> list[GoalExecution]:
        """Rename the objects. Returns the goals whose plans have to be made anew."""
        outdated = [execution for execution in state.executions if self._is_outdated(execution)]
        state.task = with_formulas(state.task, self._text)
        for execution in state.executions:
            execution.goal = self._text(execution.goal)
            if execution.look is not None:
                execution.look.object = self._name(execution.look.object)
        for work in state.log:
            work.concerned = tuple(map(self._name, work.concerned))
            work.prior_situation = self._renamer.formula(work.prior_situation) if work.prior_situation is not None else None
            work.situation = self._text(work.situation) if work.situation is not None else None
        self._rename_looks(state.look_queue)
        return outdated

    def _is_outdated(self, execution: GoalExecution) -> bool:
        """Whether the goal, or what is left of its plan, speaks of a renamed object."""
        return self._speaks_of(parse(execution.goal)) or any(
            run.progress is not Progress.COMPLETED and self._is_about(run) for run in execution
        )

    def _is_about(self, run: StepRun) -> bool:
        inputs = {name for term in run.step.inputs.values() for name in names_in(term)}
        return not inputs.isdisjoint(self._names) or self._speaks_of(run.step.effect)

    def _speaks_of(self, formula: Formula) -> bool:
        return not self._names.keys().isdisjoint(names_in(formula))

    def _rename_looks(self, looks: LookQueue) -> None:
        looks.unseen = [structs.replace(unseen, object=self._name(unseen.object)) for unseen in looks.unseen]
        if looks.current_look is not None:
            looks.current_look.object = self._name(looks.current_look.object)

    def _name(self, name: str) -> str:
        return self._names.get(name, name)

    def _text(self, text: str) -> str:
        return self._renamer.text(text) or text
