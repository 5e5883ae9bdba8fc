"""Names on the link of a world with several maps: each client speaks in those of its own."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct

from somrs.devices.simulator.link.commands import Approach, DriveTo, Fault, Insert, LookAt, ObjectState, Place, RobotState
from somrs.devices.simulator.link.lines import Answer, Break, Hello, Look, Picture, Refused, State, Ways, encode_line, read_by_client
from somrs.devices.simulator.server.link_names import LinkNames
from somrs.errors import FormulaError
from somrs.ontology.files.loading import upper
from somrs.ontology.qualified_names import translated

BARN, ONTOLOGY = LinkNames("Barn"), upper()
NAMES = st.from_regex(r"[A-Z][a-z0-9]{0,8}", fullmatch=True)
FULL_NAMES = st.builds("{}:{}".format, st.sampled_from(("Barn", "Yard", "FarBarn", "Barn2")), NAMES)


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        (Approach(object="Jar1"), Approach(object="Barn:Jar1")),
        (Place(support="Yard:Ramp", x=1.0, y=2.0), Place(support="Yard:Ramp", x=1.0, y=2.0)),
        (Insert(container="Box1"), Insert(container="Barn:Box1")),
        (LookAt(x=1, y=2, z=0), LookAt(x=1, y=2, z=0)),
        (DriveTo(x=1, y=2), DriveTo(x=1, y=2)),
        (Hello(version=1, robot="Robot1", map="Barn"), Hello(version=1, robot="Barn:Robot1", map="Barn")),
        (Break(robot="Robot1", fault=Fault.DRIVE), Break(robot="Barn:Robot1", fault=Fault.DRIVE)),
        (Look(object="Yard:Jar1"), Look(object="Yard:Jar1")),
        (Picture(), Picture()),
        (Picture(subject="Room1", robot="Robot1"), Picture(subject="Barn:Room1", robot="Barn:Robot1")),
        (
            Ways(robot="Robot1", stops=("Door1/handles", (1.0, 2.0), "Yard:Ramp"), situation="Door1.Open = TRUE AND Jar1 isOn Yard:Ramp"),
            Ways(
                robot="Barn:Robot1",
                stops=("Barn:Door1/handles", (1.0, 2.0), "Yard:Ramp"),
                situation="Barn:Door1.Open = TRUE AND Barn:Jar1 isOn Yard:Ramp",
            ),
        ),
    ],
)
def test_what_a_client_says_is_meant_of_its_own_map(said: Struct, meant: Struct) -> None:
    assert BARN.from_client(said, ONTOLOGY) == meant


def test_a_situation_that_is_no_formula_is_refused() -> None:
    with pytest.raises(FormulaError):
        BARN.from_client(Ways(robot="Robot1", stops=(), situation="AND"), ONTOLOGY)


@given(FULL_NAMES, FULL_NAMES)
def test_what_a_client_is_told_has_the_names_of_its_own_map(name: str, other_name: str) -> None:
    own_name, other_own_name = translated(name, "", "Barn"), translated(other_name, "", "Barn")
    state = RobotState(time=1, x=0, y=0, yaw=0, holding=name, hindrance=f"waits for {other_name}")
    told = read_by_client(BARN.to_client(encode_line(State(state=state))))
    assert told == State(state=msgspec.structs.replace(state, holding=own_name, hindrance=f"waits for {other_own_name}"))
    seen = ObjectState(object=name, x=0, y=0, z=0, yaw=0, support=other_name)
    told = read_by_client(BARN.to_client(encode_line(Answer(id=1, object_state=seen, robots={name: state}, shut=(other_name,)))))
    assert isinstance(told, Answer)
    assert told.object_state == msgspec.structs.replace(seen, object=own_name, support=other_own_name)
    assert told.robots is not None
    assert [*told.robots] == [own_name]
    assert told.shut == (other_own_name,)
    refused = Refused(reason="unknown-robot", description=f"there is no robot {name}; the robots here are: {other_name}, {name}")
    told = read_by_client(BARN.to_client(encode_line(refused)))
    assert told == Refused(
        reason="unknown-robot", description=f"there is no robot {own_name}; the robots here are: {other_own_name}, {own_name}"
    )


@given(NAMES)
def test_names_of_the_own_map_come_back(name: str) -> None:
    assert translated(BARN.from_client(Approach(object=name), ONTOLOGY).object, "", "Barn") == name


def test_a_picture_stays_as_it_is() -> None:
    picture = Answer(id=1, png=bytes(range(256)) * 20)
    assert read_by_client(BARN.to_client(encode_line(picture))) == picture
