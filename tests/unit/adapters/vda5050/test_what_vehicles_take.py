"""Orders have what the vehicle says that it takes: optional parameters, and identifiers."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.adapters.vda5050.control.exchange import Follow, GaveUp, Halted, Refused
from somrs.adapters.vda5050.messages.factsheets import Factsheet, OptionalParameter, StringLengths
from somrs.adapters.vda5050.messages.header import Version
from somrs.adapters.vda5050.messages.identifiers import fitting_id, plain_id
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from tests.support.vda5050_pair import Pair, way

VERSIONS = pytest.mark.parametrize("version", [Version.V2_1, Version.V3_0])


def sheet_without(*parameters: str) -> Factsheet:
    sheet = factsheet()
    features = sheet.protocol_features
    kept_parameters = tuple(item for item in features.optional_parameters if item.parameter.rpartition(".")[2] not in parameters)
    return msgspec.structs.replace(sheet, protocol_features=msgspec.structs.replace(features, optional_parameters=kept_parameters))


@VERSIONS
def test_what_the_vehicle_does_not_take_is_not_sent(version: Version) -> None:
    pair = Pair(version, sheet=sheet_without("theta", "maximumSpeed", "orientation", "allowedDeviationXY"))
    start, end = way("A", "B")
    pair.do(Follow(way=(start, msgspec.structs.replace(end, yaw=1.5, travel="Backward"))))
    pair.run(1)
    pair.halt()
    pair.run_until(Halted)
    assert 0.5 < pair.body.x < 1.5
    pair.follow("A", "B", first=7)
    pair.run(5)
    assert pair.body.x == 2.0, "its order began where it stood"
    assert pair.of(GaveUp) == []


def test_lengths_are_sent_to_who_takes_them_and_what_is_required_and_not_sent_is_named() -> None:
    sheet = factsheet()
    features = sheet.protocol_features
    required = tuple(OptionalParameter(parameter=f"order.edges.{name}", support="REQUIRED") for name in ("length", "direction"))
    features = msgspec.structs.replace(features, optional_parameters=(*features.optional_parameters, *required))
    pair = Pair(Version.V3_0, sheet=msgspec.structs.replace(sheet, protocol_features=features))
    assert pair.of(Refused) == [Refused(description="requires order.edges.direction, which fleet control does not send")]
    pair.follow("A", "B")
    assert [edge.length for order in pair.orders() for edge in order.edges] == [2.0]


@VERSIONS
@pytest.mark.parametrize("limits", [StringLengths(maximum_id_length=12), StringLengths(maximum_id_length=10, id_numerical_only=True)])
def test_identifiers_are_as_the_vehicle_takes_them(version: Version, limits: StringLengths) -> None:
    sheet = factsheet()
    sheet = msgspec.structs.replace(sheet, protocol_limits=msgspec.structs.replace(sheet.protocol_limits, maximum_string_lengths=limits))
    pair = Pair(version, sheet=sheet)
    names = ("Aisle between the shelves", "Bay 7 in the north of the hall", "C")
    pair.follow(*names, released=2)
    pair.run(1)
    pair.follow(*names)
    pair.run(6)
    assert pair.body.x == 4.0
    assert pair.passed() == [1, 2]
    assert pair.of(GaveUp) == []


@given(name=st.text(), length=st.none() | st.integers(1, 40), numerical=st.none() | st.booleans())
def test_an_identifier_fits_and_is_the_same_for_the_same_name(name: str, length: int | None, numerical: bool | None) -> None:
    limits = StringLengths(maximum_id_length=length, id_numerical_only=numerical)
    identifier = fitting_id(name, limits)
    assert identifier == fitting_id(name, limits)
    assert 0 < len(identifier) <= (length or 1000)
    assert identifier.isdigit() if numerical else plain_id(identifier) == identifier


@VERSIONS
def test_nodes_have_the_names_of_places_that_vehicles_were_taught(version: Version) -> None:
    pair = Pair(version)
    start, end = way("A", "B")
    pair.do(Follow(way=(start, msgspec.structs.replace(end, mark="Dock 1"))))
    pair.run(5)
    (order,) = pair.orders()
    assert [node.node_id for node in order.nodes] == ["A", "Dock_1"]
    assert order.edges[0].edge_id == "A-Dock_1"
    assert pair.passed() == [1]


def test_what_is_optional_in_states_is_not_taken_in_orders() -> None:
    sheet = factsheet()
    names = ("state.edgeStates.trajectory", "visualization.mobileRobotPosition.length", "order.nodes.nodePosition.theta", "orientation")
    parameters = tuple(OptionalParameter(parameter=name, support="SUPPORTED") for name in names)
    features = msgspec.structs.replace(sheet.protocol_features, optional_parameters=parameters)
    sheet = msgspec.structs.replace(sheet, protocol_features=features)
    assert [name for name in ("trajectory", "length", "theta", "orientation") if sheet.takes(name)] == ["theta", "orientation"]
