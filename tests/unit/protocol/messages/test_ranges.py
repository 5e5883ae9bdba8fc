"""Every number of every request has a range, and every text a length."""

from __future__ import annotations

import math
import typing
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from somrs.errors import UsageError
from somrs.ontology.objects import Object, ObjectAdded
from somrs.protocol.messages.bodies import REQUESTS, FrpBody
from somrs.protocol.messages.knowledge import QueryMap, UpdateMap
from somrs.protocol.messages.ranges import LONGEST_TEXT, check_ranges
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.traffic import Berth, EnterTraffic
from somrs.protocol.soap.xml import strip_none, union_of
from tests.support.bodies import values_of

NUMBERS = [
    (kind, field.name)
    for kind in {*REQUESTS, *union_of(FrpBody)}
    for field in structs.fields(kind)
    if strip_none(typing.get_type_hints(kind)[field.name]) in (int, float)
]


@given(case=st.sampled_from(sorted(NUMBERS, key=str)), data=st.data())
@pytest.mark.parametrize("number", [math.inf, -math.inf, math.nan, 1e308, -1e308, 10**30, -(10**30)])
def test_numbers_that_make_no_sense(case: tuple[Any, str], data: st.DataObject, number: float) -> None:
    kind, field = case
    body = structs.replace(data.draw(values_of(kind)), **{field: number})
    with pytest.raises(UsageError):
        check_ranges(body)


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (QueryMap(formula="x", limit=-1), "limit is -1; give a number from 0 to 1e\\+06"),
        (Submit(effect="x", deadline=1e308), "deadline is 1e\\+308; give a number from 0.001 to 1e\\+09"),
        (Submit(effect="x" * (LONGEST_TEXT + 1)), f"effect has {LONGEST_TEXT + 1} characters"),
        (UpdateMap(changes=(ObjectAdded(Object(name="Jar1", type="Jar", values={"Weight": math.inf})),)), r"\[Weight\] is inf"),
        (UpdateMap(changes=(ObjectAdded(Object(name="x" * 300_000, type="Jar")),)), "300000 characters"),
        (EnterTraffic(robot="R", place="P", lease=5, berths=(Berth(name="R/1", x=math.nan, y=0, radius=1, places=()),)), "berths.x is nan"),
    ],
)
def test_the_place_and_the_range_are_named(body: object, problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        check_ranges(body)


def test_structures_that_are_too_deep() -> None:
    value: object = 1
    for _ in range(100):
        value = (value,)
    with pytest.raises(UsageError, match="deep"):
        check_ranges(value, "x")
