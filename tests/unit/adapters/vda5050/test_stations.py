"""Loads are picked and dropped at stations as the map has them, in the words of the vehicles."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from somrs.adapters.vda5050.messages.factsheets import Factsheet, LoadSet, SupportedParameter
from somrs.adapters.vda5050.messages.states import Load
from somrs.adapters.vda5050.simulated.factsheet import factsheet
from somrs.adapters.vda5050.stations import Handled, StationTypes, lifting_problem, parameters_of, unmet_parameters

SHELF = ("StorageRack", "Furniture", "Support", "PhysicalObject")


@pytest.mark.parametrize(
    ("types", "expected"),
    [
        (StationTypes(), "StorageRack"),
        (StationTypes(default="station"), "station"),
        (StationTypes(words={"Furniture": "rack"}), "rack"),
        (StationTypes(default="station", words={"Shelf1": "conveyor", "Furniture": "rack"}), "conveyor"),
    ],
)
def test_the_type_of_a_station_is_that_of_the_support_unless_the_site_has_another_word(types: StationTypes, expected: str) -> None:
    assert types.word("Shelf1", SHELF) == expected


def test_floors_and_places_are_floor_locations() -> None:
    types = StationTypes()
    assert [types.word("", ()), types.word("Ground", ("Floor",)), types.word("Bay1", ("Place", "Anything"))] == ["floor"] * 3
    assert StationTypes(words={"Floor": "bay"}).word("", ()) == "bay"
    assert StationTypes(default="rack").word("", ()) == "rack"


def handled(action_type: str = "pick", **changes: Any) -> Handled:
    values: dict[str, Any] = {"station": "Shelf1", "station_type": "rack", "load_type": None, "height": 1.2345, "loads": ()}
    return Handled(action_type=action_type, thing="Crate1", **{**values, **changes})


def sheet_with(*keys: str, load_positions: tuple[str, ...] = (), longest_load_id: int | None = None, **load_set: Any) -> Factsheet:
    """A factsheet whose pick and drop have these parameters."""
    sheet = factsheet()
    parameters = tuple(SupportedParameter(key=key, value_data_type="STRING", is_optional=False) for key in keys)
    actions = tuple(
        msgspec.structs.replace(action, action_parameters=parameters) if action.action_type in ("pick", "drop") else action
        for action in sheet.protocol_features.mobile_robot_actions
    )
    limits = sheet.protocol_limits
    lengths = msgspec.structs.replace(limits.maximum_string_lengths, maximum_load_id_length=longest_load_id)
    loads = LoadSet(set_name="DEFAULT", load_type="EPAL", **load_set)
    return msgspec.structs.replace(
        sheet,
        protocol_features=msgspec.structs.replace(sheet.protocol_features, mobile_robot_actions=actions),
        protocol_limits=msgspec.structs.replace(limits, maximum_string_lengths=lengths),
        load_specification=msgspec.structs.replace(sheet.load_specification, load_positions=load_positions, load_sets=(loads,)),
    )


def values(load: Handled, sheet: Factsheet | None) -> dict[str, Any]:
    return {parameter.key: parameter.value for parameter in parameters_of(load, sheet)}


def test_the_height_is_sent_to_those_who_list_it() -> None:
    assert "height" not in values(handled(), factsheet())
    assert values(handled(), sheet_with("height", "loadId")) == {"height": 1.234, "loadId": "Crate1"}
    assert values(handled(height=None), sheet_with("height", "loadId")) == {"loadId": "Crate1"}


def test_the_load_handling_device_is_a_free_one_or_the_one_with_the_load() -> None:
    sheet = sheet_with("lhd", load_positions=("front", "back"))
    carried = (Load(load_id="Crate7", load_position="front"), Load(load_id="Crate1", load_position="back"))
    assert values(handled(), sheet) == {"lhd": "front"}
    assert values(handled(loads=carried[:1]), sheet) == {"lhd": "back"}
    assert values(handled("drop", loads=carried), sheet) == {"lhd": "back"}
    assert values(handled(), sheet_with("lhd", "loadId")) == {"loadId": "Crate1"}


def test_the_name_of_a_load_fits() -> None:
    assert len(values(handled(), sheet_with("loadId", longest_load_id=4))["loadId"]) == 4
    assert values(handled(), sheet_with("loadId", longest_load_id=6)) == {"loadId": "Crate1"}


def test_what_a_vehicle_needs_and_does_not_get_is_named() -> None:
    assert unmet_parameters(sheet_with("side", "height")) == ["side of pick", "side of drop"]
    assert unmet_parameters(factsheet()) == []


@pytest.mark.parametrize(
    ("height", "load_set", "problem"),
    [
        (0.5, {}, None),
        (1.5, {"maximum_loadhandling_height": 1.5}, None),
        (1.6, {"maximum_loadhandling_height": 1.5}, "handles loads at 0 to 1.5 m over the floor, and not at 1.60 m"),
        (
            0.0,
            {"minimum_loadhandling_height": 0.4, "maximum_loadhandling_height": 2.0},
            "handles loads at 0.4 to 2 m over the floor, and not at 0.00 m",
        ),
    ],
)
def test_a_vehicle_handles_loads_as_high_as_its_factsheet_says(height: float, load_set: dict[str, Any], problem: str | None) -> None:
    assert lifting_problem(height, None, sheet_with(**load_set)) == problem
    assert lifting_problem(height, "EPAL", sheet_with(**load_set)) == problem
    assert lifting_problem(height, "INDU", sheet_with(**load_set)) is None
    assert lifting_problem(height, None, None) is None
