"""The mistakes in the geometry of a map, as problems of its files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from somrs.errors import Problem

if TYPE_CHECKING:
    from somrs.ontology.files.loaded import LoadedModel

MOST_OF_A_KIND = 12
"""How many problems of one kind are printed: the others of the kind mostly have the same cause."""


def geometry_problems(loaded: LoadedModel) -> list[Problem] | None:
    """What is wrong with the geometry of the map; None if the libraries that this needs are not installed."""
    try:
        from somrs.space.findings import find_mistakes
    except ModuleNotFoundError:  # numpy and scipy come with the simulator
        return None
    if loaded.map is None:
        return []
    problems = []
    for finding in find_mistakes(loaded.map, loaded.ontology):
        file, line = loaded.written(finding.subject)
        problems.append(Problem(file=file, line=line, subject=finding.subject, rule=finding.rule, message=finding.message))
    return problems


def printed(problems: Sequence[Problem]) -> Iterator[str]:
    """The problems as lines, of each kind not more than fit on a screen."""
    counts: Counter[str] = Counter()
    for problem in problems:
        counts[problem.rule] += 1
        if counts[problem.rule] <= MOST_OF_A_KIND:
            yield str(problem)
    for rule, count in counts.items():
        if count > MOST_OF_A_KIND:
            yield f"... and {count - MOST_OF_A_KIND} more [{rule}]; --json lists all"
