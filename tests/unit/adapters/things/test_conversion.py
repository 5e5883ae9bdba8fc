"""Values in messages: what is written for a value is read as this value, and what makes no sense is said."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.things.conversion import Conversion
from somrs.adapters.things.json_path import json_steps, json_value
from somrs.adapters.things.registers import Register, Table, parse_register
from somrs.errors import InputError
from somrs.ontology.types import AttributeType, Kind

TEMPERATURE = AttributeType(name="Temperature", kind=Kind.NUMBER, unit="degC")
ON = AttributeType(name="On", kind=Kind.TRUTH)
MODE = AttributeType(name="Mode", kind=Kind.ENUMERATION, values=("Heating", "Off"))


@given(
    st.floats(-1000, 1000),
    st.floats(0.001, 1000),
    st.floats(-1000, 1000),
    st.sampled_from([None, "degF", "K"]),
)
def test_what_is_written_for_a_number_is_read_as_this_number(number: float, scale: float, offset: float, unit: str | None) -> None:
    conversion = Conversion(attribute=TEMPERATURE, scale=scale, offset=offset, unit=unit)
    value = conversion.read(conversion.write(number))
    assert isinstance(value, float)
    assert math.isclose(value, number, rel_tol=1e-6, abs_tol=1e-6)


@pytest.mark.parametrize(
    ("attribute", "values", "raw", "value"),
    [
        (TEMPERATURE, {}, "21.5", 21.5),
        (TEMPERATURE, {}, 21, 21.0),
        (ON, {}, "ON", True),
        (ON, {}, 0, False),
        (ON, {}, True, True),
        (ON, {"7": True, "8": False}, 8, False),
        (MODE, {}, "heating", "Heating"),
        (MODE, {"heat": "Heating"}, "heat", "Heating"),
    ],
)
def test_a_value_is_read(attribute: AttributeType, values: dict[str, str | bool], raw: object, value: object) -> None:
    assert Conversion(attribute=attribute, values=dict(values)).read(raw) == value


@pytest.mark.parametrize(
    ("attribute", "raw", "expected"),
    [
        (TEMPERATURE, "warm", "'warm' is not a number"),
        (TEMPERATURE, "nan", "not a finite number"),
        (TEMPERATURE, {"a": 1}, "no single value"),
        (ON, "perhaps", "neither true nor false"),
        (MODE, "cool", "none of Heating, Off"),
    ],
)
def test_what_makes_no_sense_is_said(attribute: AttributeType, raw: object, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        Conversion(attribute=attribute).read(raw)


def test_units_are_converted() -> None:
    assert Conversion(attribute=TEMPERATURE, unit="degF").read("68") == 20.0


ENCODINGS = st.sampled_from([("int16", 16), ("uint16", 16), ("int32", 32), ("uint32", 32), ("int64", 64)])


@given(ENCODINGS, st.booleans(), st.data())
def test_an_integer_in_registers_is_read_as_it_was_written(encoding: tuple[str, int], swapped: bool, data: st.DataObject) -> None:
    name, bits = encoding
    low, high = (0, 2**bits - 1) if name.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    number = data.draw(st.integers(low, min(high, 2**52)))
    register = Register(table=Table.HOLDING, address=3, encoding=name, swapped=swapped)
    words = register.encode(number)
    assert len(words) == register.count
    assert register.decode(words) == number


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_a_float_in_registers_is_read_as_it_was_written(number: float) -> None:
    register = parse_register("holding 0", "float32 swapped")
    assert register.decode(register.encode(number)) == number


def test_a_number_that_does_not_fit_is_not_written() -> None:
    with pytest.raises(ValueError, match="70000 does not fit into uint16"):
        parse_register("holding 1", None).encode(70000)


def test_one_bit_of_a_register_is_read() -> None:
    assert parse_register("input 1", "bit 3").decode([0b1000]) is True
    assert parse_register("input 1", "bit 2").decode([0b1000]) is False


@pytest.mark.parametrize(
    ("text", "encoding", "expected"),
    [
        ("register 3", None, "is not a register"),
        ("holding 65536", None, "is not a register"),
        ("holding 3", "int8", "is not an encoding"),
        ("coil 3", "int16", "is one bit"),
    ],
)
def test_what_is_no_register_is_said(text: str, encoding: str | None, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        parse_register(text, encoding)


@pytest.mark.parametrize(
    ("path", "value"),
    [("a.b", 1), ("$.a.b", 1), ("$['a']['b']", 1), ("list[1].c", 2), ("$", "all"), ("a.x", None), ("list[7]", None), ("a.b.c", None)],
)
def test_a_path_names_a_value_of_a_document(path: str, value: object) -> None:
    document = {"a": {"b": 1}, "list": [0, {"c": 2}]}
    assert json_value("all" if value == "all" else document, json_steps(path)) == value


@pytest.mark.parametrize("path", ["a..b", "a[x]", "$.*", "a b"])
def test_what_is_no_path_is_said(path: str) -> None:
    with pytest.raises(InputError, match="is not a path"):
        json_steps(path)
