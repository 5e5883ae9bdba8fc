"""Answers that are kept for those who ask the same are those that a new search gives."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.ontology.check import check
from somrs.ontology.effects import apply_effect
from somrs.ontology.map import Map
from somrs.protocol.messages.knowledge import QueryMap, Rows
from somrs.repository import map_answers
from somrs.repository.map_answers import MapAnswers
from tests.support.lab import lab

QUESTIONS = st.builds(
    QueryMap,
    formula=st.sampled_from(["?It: Jar isOn Table1", "?It: Jar isOn ?Place", "Jar1.Color = ?Color", "Robot1.Price = ?Price"]),
    limit=st.integers(0, 2),
    skip=st.integers(0, 2),
    situation=st.sampled_from([None, "Jar1 isOn Table2", "Jar1.Color = Blue"]),
)
CHANGES = st.sampled_from(["Jar1 isOn Table1", "Jar1 isOn Table2", "Jar1.Color = Red", "Robot1.Price = 7"])


@given(st.lists(QUESTIONS | CHANGES, min_size=5, max_size=30))
def test_answers_that_are_kept_are_those_of_a_new_search(inputs: list[QueryMap | str]) -> None:
    ontology, map = lab()
    answers, version = MapAnswers(), 0
    for entry in inputs:
        if isinstance(entry, str):
            map, version = apply_effect(check(entry, ontology, map), map, ontology), version + 1
        else:
            assert answers.answer(entry, map, ontology, version) == MapAnswers().answer(entry, map, ontology, version)


def test_pages_are_the_parts_of_a_whole_answer() -> None:
    ontology, map = lab()
    formula = "?It: PhysicalObject = ?It"
    whole = MapAnswers().answer(QueryMap(formula=formula), map, ontology, 3)
    assert isinstance(whole, Rows)
    assert len(whole.rows) > 3
    queries = [QueryMap(formula=formula, limit=2, skip=skip) for skip in range(0, len(whole.rows), 2)]
    pages = [page for query in queries if isinstance(page := MapAnswers().answer(query, map, ontology, 3), Rows)]
    assert [row for page in pages for row in page.rows] == [*whole.rows]
    assert [page.more for page in pages] == [True] * (len(queries) - 1) + [False]


def test_the_robots_that_are_asked_for_a_quote_have_the_map_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    ontology, map = lab()
    searches: list[QueryMap] = []
    search = map_answers._rows

    def count(query: QueryMap, map: Map, *arguments: object) -> object:
        searches.append(query)
        return search(query, map, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(map_answers, "_rows", count)
    answers = MapAnswers()
    for _ in range(25):
        answers.answer(QueryMap(formula="?It: Jar isOn Table1"), map, ontology, 3)
    assert len(searches) == 1
    for number in range(2 * map_answers.KEPT):
        answers.answer(QueryMap(formula="?It: Jar isOn Table1", limit=number), map, ontology, 3)
    assert len(answers._rows) == map_answers.KEPT, "not all questions of a long quiet time"
