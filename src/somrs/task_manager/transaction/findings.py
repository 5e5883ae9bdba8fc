"""The findings of a task that asks what is so: the answers on the map, with the observations of the task that they rest on."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

from somrs.entish import Formula
from somrs.entish.formula import conjuncts, names, substitute
from somrs.entish.parse import parse
from somrs.errors import FormulaError
from somrs.kernel.replica import Replica
from somrs.ontology.truth import bindings
from somrs.protocol.messages.findings import Finding, Findings, Sighting, Unseen
from somrs.protocol.messages.frp import State
from somrs.task_manager.execution.execution_log import ExecutionLog, Work

MOST_ANSWERS = 100
"""The maximum number of answers to a question."""


def findings(question: str, log: ExecutionLog, replica: Replica) -> Findings:
    """The answers to the question on the current map."""
    formula = parse(question)
    observations = [work for work in log if work.state is State.COMPLETED and work.situation is not None]
    failed = [work for work in log if work.state is not State.COMPLETED]
    try:
        rows = [*islice(bindings(formula, replica.map, replica.ontology), MOST_ANSWERS + 1)]
    except FormulaError:  # an object of the question is not on the map any more
        rows = []
    answers = [
        Finding(
            situation=str(answer := substitute(formula, row)),
            bindings={name: str(term) for name, term in row.items()},
            sightings=tuple(_sightings(answer, reversed(observations))),
        )
        for row in rows[:MOST_ANSWERS]
    ]
    return Findings(
        formula=question,
        answers=tuple(sorted(answers, key=lambda answer: not answer.sightings)),
        observations=len(observations),
        unseen=tuple(_unseen(work) for work in failed),
        more=len(rows) > MOST_ANSWERS,
    )


def _sightings(answer: Formula, observations: Iterable[Work]) -> Iterable[Sighting]:
    """What was observed of the objects that the answer is about."""
    objects = set(names(answer))
    for work in observations:
        situation, at = work.situation or "", work.observed_at or work.ended or work.started_at
        if not objects.isdisjoint(_subjects(situation)):
            yield Sighting(service=work.service, at=at, situation=situation)


def _subjects(situation: str) -> set[str]:
    try:
        return {names(part)[0] for part in conjuncts(parse(situation)) if names(part)}
    except FormulaError:
        return set()


def _unseen(work: Work) -> Unseen:
    inputs = {name: str(term) for name, term in work.step.inputs.items()}
    return Unseen(service=work.service, inputs=inputs, reason=work.note or work.state.value.lower())
