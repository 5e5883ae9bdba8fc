"""Wishes as the page for new tasks has them: lines that are formulas, drafts that are tasks, tasks that become templates."""

from __future__ import annotations

from datetime import datetime
from types import SimpleNamespace
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.formula import Formula
from somrs.entish.parse import parse
from somrs.errors import UsageError
from somrs.gui.pages.define.blanks import mentioned_things, propose_blank_names, replace_with_blanks
from somrs.gui.pages.define.draft import Draft, Procedure, Repeat
from somrs.gui.pages.define.goal_lines import Line, add_placement, is_same_formula, lines_of, text_of
from somrs.gui.pages.define.orders import repeat_of, schedule_of
from somrs.kernel.replica import Replica
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.services import Handler, Occasion
from somrs.ontology.types import Kind
from somrs.protocol.messages.orders import Blank, Daily, Every, Once, StandingOrder, Template
from somrs.protocol.messages.submission import Policy, Submit
from somrs.scheduling.templates import check, fill_template
from tests.support.small_ontology import ONTOLOGY, formulas

MAP = Map(
    [
        Object(name="Jar1", type="Jar"),
        Object(name="Jar2", type="Jar"),
        Object(name="Table1", type="Table"),
        Object(name="Table2", type="Table"),
        Object(name="Robot1", type="PioneerP3DX"),
    ]
)
REPLICA = cast(Replica, SimpleNamespace(map=MAP, ontology=upper()))


# Lines


@pytest.mark.parametrize(
    "text",
    [
        "Jar1 isOn Table1",
        "NOT Jar1 isHeldBy Robot1",
        "Jar1 isOn Table1\nAND Jar2.Color = Red",
        "Jar1.Shape.Height >= 10 cm",
        'Jar1.Label = "the \\"sugar\\", ż"',
        "Robot1.Working = TRUE\nAND NOT Robot1.Charge < 20 %",
    ],
)
def test_lines_say_what_the_formula_says(text: str) -> None:
    lines = lines_of(text, upper())
    assert lines is not None
    assert text_of(lines) == text


@pytest.mark.parametrize(
    "text", ["?x isOn Table1", "Jar1 isOn Table1 OR Jar1 isOn Table2", "connects(A, B, C)", "Jar1.Weight = Jar2.Weight", "Jar1 isOn", ""]
)
def test_other_formulas_are_no_lines(text: str) -> None:
    assert lines_of(text, upper()) is None


@given(formulas)
def test_lines_never_say_something_else(formula: Formula) -> None:
    lines = lines_of(str(formula), ONTOLOGY)
    if lines is not None:
        assert parse(text_of(lines)) == parse(str(formula))


def test_what_is_not_chosen_yet_says_nothing() -> None:
    assert text_of([Line(thing="Jar1", relation="isOn"), Line(thing="Jar1", path="Weight", value="much"), Line()]) == ""
    assert Line(thing="Jar1", path="Label", kind=Kind.TEXT).text == 'Jar1.Label = ""'


def test_a_thing_is_wished_to_be_in_one_place_only() -> None:
    ontology = upper()
    lines_before = lines_of("Jar1 isOn Table1 AND Jar2 isOn Table1 AND Jar1.Color = Red AND NOT Jar1 isOn Table2", ontology)
    assert lines_before is not None
    lines_after = add_placement(lines_before, Line(thing="Jar1", relation="isHeldBy", related_thing="Robot1"), ontology)
    assert is_same_formula(text_of(lines_after), "Jar2 isOn Table1 AND Jar1.Color = Red AND NOT Jar1 isOn Table2 AND Jar1 isHeldBy Robot1")


# Drafts

handlers = st.builds(
    Handler,
    on=st.sampled_from(Occasion),
    effect=st.just("?Object isOn Table1"),
    when=st.sampled_from([None, "?Object isOn Table2"]),
    service_type=st.sampled_from([None, "TransferObject"]),
)
tasks = st.builds(
    Submit,
    effect=st.just("Jar1 isOn Table1"),
    precondition=st.sampled_from([None, "Jar1 isOn Table2"]),
    policy=st.sampled_from(Policy),
    time_value=st.sampled_from([0.01, 0.5, 2.0]),
    deadline=st.none() | st.sampled_from([0.5, 30.0, 90.0, 600.0, 7200.0]),
    handlers=st.lists(handlers, max_size=3).map(tuple),
    priority=st.integers(min_value=-1, max_value=2),
)


@given(tasks)
def test_a_task_on_the_page_is_the_task(task: Submit) -> None:
    draft = Draft()
    draft.load_task(task)
    assert draft.task() == task


@pytest.mark.parametrize(
    ("draft", "problem"),
    [
        (Draft(effect="a isOn b", deadline="soon"), "the deadline must be a number above 0, not soon"),
        (Draft(effect="a isOn b", deadline="-3"), "the deadline must be a number above 0"),
        (Draft(effect="a isOn b", policy=Policy.WEIGHTED, time_value=""), "the cost per second must be a number of EUR, not empty"),
        (Draft(effect="a isOn b", procedures=[Procedure(effect="a isOn")]), "the handler for failure: the formula ends too early"),
    ],
)
def test_what_is_none_is_said(draft: Draft, problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        draft.task()


def test_numbers_may_have_a_comma() -> None:
    assert Draft(effect="a isOn b", deadline="1,5", deadline_unit="min").task().deadline == 90


# Templates


@given(tasks)
def test_a_task_made_a_template_and_filled_in_is_the_task_again(task: Submit) -> None:
    things = mentioned_things(task, MAP)
    assert things[:2] == ["Jar1", "Table1"]
    blanks = propose_blank_names({thing: MAP.objects[thing].type for thing in things})
    blanked_task = replace_with_blanks(task, blanks)
    template = Template(
        name="t",
        task=blanked_task,
        blanks=tuple(Blank(name=name, type=MAP.objects[thing].type, default=thing) for thing, name in blanks.items()),
    )
    check(blanked_task, template.blanks, REPLICA)
    assert fill_template(template, {}, REPLICA) == task
    assert fill_template(template, {"Jar": "Jar2"}, REPLICA).effect == "Jar2 isOn Table1"


def test_only_whole_names_become_blanks() -> None:
    task = Submit(effect='Jar1 isOn Table1 AND Jar1.Label = "Jar1" AND Jar1-old isOn ?Jar1  # Jar1')
    assert replace_with_blanks(task, {"Jar1": "Jar"}).effect == '{Jar} isOn Table1 AND {Jar}.Label = "Jar1" AND Jar1-old isOn ?Jar1  # Jar1'


# Orders


@pytest.mark.parametrize("schedule", [Every(minutes=30), Daily(at="07:30", days=(0, 4)), Once(at=datetime(2030, 1, 2, 8, 15).timestamp())])
def test_the_time_of_an_order_on_the_page_is_its_time(schedule: Every | Daily | Once) -> None:
    assert schedule_of(repeat_of(StandingOrder(id="1", name="Round", when=schedule))) == schedule


def test_an_order_without_a_time_is_none() -> None:
    with pytest.raises(UsageError, match="enter the date"):
        schedule_of(Repeat(recurrence="once", time=""))
