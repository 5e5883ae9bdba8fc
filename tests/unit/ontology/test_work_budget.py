"""The work that formulas may take, and that what leads to nothing is tried once. The twin tries every assignment."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.formula import Name
from somrs.entish.parse import parse
from somrs.ontology import truth
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.truth import bindings, formula_holds
from somrs.ontology.work_budget import ExcessiveWork, WorkBudget
from tests.support.examples import examples
from tests.support.small_ontology import ONTOLOGY

COMPARE = {"<": float.__lt__, ">": float.__gt__, "=": float.__eq__}

Comparisons = list[tuple[int, str, int]]
"""Numbers of variables, and how the positions of their objects compare."""


def jars(positions: list[float]) -> Map:
    return Map([Object(name=f"Jar{number}", type="Jar", values={"PositionX": x}) for number, x in enumerate(positions)])


def formula_of(comparisons: Comparisons) -> str:
    return " AND ".join(f"?A{first}.PositionX {sign} ?A{second}.PositionX" for first, sign, second in comparisons)


def plain_bindings(comparisons: Comparisons, positions: list[float]) -> Iterator[dict[str, Name]]:
    variables = sorted({variable for first, _, second in comparisons for variable in (first, second)})
    for choice in itertools.product(range(len(positions)), repeat=len(variables)):
        objects = dict(zip(variables, choice, strict=True))
        if all(COMPARE[sign](positions[objects[first]], positions[objects[second]]) for first, sign, second in comparisons):
            yield {f"A{variable}": Name(f"Jar{number}") for variable, number in objects.items()}


@examples(100)
@given(
    st.lists(st.tuples(st.integers(0, 4), st.sampled_from([*COMPARE]), st.integers(0, 4)), min_size=1, max_size=6),
    st.lists(st.sampled_from([0.0, 1.0, 2.0, 3.0]), min_size=1, max_size=4),
)
def test_what_led_to_nothing_is_left_out_and_nothing_else(comparisons: Comparisons, positions: list[float]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truth, "REMEMBERED_WORK", 0)
        rows = [*bindings(parse(formula_of(comparisons)), jars(positions), ONTOLOGY)]
    plain_rows = [*plain_bindings(comparisons, positions)]
    assert len(rows) == len(plain_rows)
    assert all(row in plain_rows for row in rows)


def test_a_ring_of_comparisons_is_no_matter_of_years() -> None:
    ring = formula_of([(number, ">", (number + 1) % 9) for number in range(9)])
    budget = WorkBudget(2_000_000)
    assert [*bindings(parse(ring), jars([float(x) for x in range(31)]), ONTOLOGY, budget=budget)] == []


CLIQUE = formula_of([(first, "<", second) for second in range(12) for first in range(second)])

PAIRS = " AND ".join(f"?A{number}.PositionX <= ?B{number}.PositionX" for number in range(4))
NESTED = "".join(f"FORALL ?A{number}: Jar (EXISTS ?B{number}: Jar (" for number in range(4)) + PAIRS + "))" * 4


@pytest.mark.parametrize(
    "text",
    [
        CLIQUE,
        f"NOT ({CLIQUE})",
        f"EXISTS ?A0: Jar ({CLIQUE})",
        NESTED,
        f"({CLIQUE}) OR ?A0.PositionX = 77",
    ],
    ids=["clique", "none", "witness", "nested", "alternatives"],
)
def test_what_takes_too_much_work_is_refused_with_what_to_do(text: str) -> None:
    with pytest.raises(ExcessiveWork) as refusal:
        formula_holds(parse(text), jars([float(x % 11) for x in range(31)]), ONTOLOGY)
    assert "steps" in refusal.value.problem
    assert "name objects or types" in refusal.value.hint


def test_evaluations_share_a_budget() -> None:
    map, budget = jars([float(x) for x in range(31)]), WorkBudget(1000)
    with pytest.raises(ExcessiveWork):
        any(formula_holds(parse("?A.PositionX > 30"), map, ONTOLOGY, budget) for _ in range(1000))
