"""What `pick` and `drop` say about a load and its station (VDA 5050 3.0, table 4): what is on the map, in the words of the vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from msgspec import Struct

from somrs.adapters.vda5050.messages.factsheets import Factsheet, LoadSet, StringLengths
from somrs.adapters.vda5050.messages.identifiers import fitting_id
from somrs.adapters.vda5050.messages.orders import ActionParameter
from somrs.adapters.vda5050.messages.states import Load

FLOOR = "floor"
"""The type of the stations of vehicles that drop loads on any floor (2.1, 6.8.1: "floor location")."""

ON_FLOOR = ("Floor", "Place")
"""Types of objects that are nothing but the floor."""

LISTED = frozenset({"height", "lhd"})
"""Parameters that are sent to vehicles whose factsheet lists them only."""

SENT = LISTED | {"stationType", "stationName", "loadType", "loadId"}
"""All parameters that are sent."""

INEXACT = 0.005
"""How exact heights are, m."""


class StationTypes(Struct, frozen=True, kw_only=True):
    """`words`: the types of stations by the names of objects on the map, or of their types. `default`: that of all others; None: their
    type on the map, and `floor` for floors and places."""

    default: str | None = None
    words: Mapping[str, str] = {}

    def word(self, support: str, types: Sequence[str]) -> str:
        """The type of a station. `support`: its name; `types`: that on the map, its parent, and so on; none: the floor itself."""
        named = next((self.words[name] for name in (support, *(types or ON_FLOOR[:1])) if name in self.words), None)
        is_floor = not types or any(name in ON_FLOOR for name in types)
        return named or self.default or (FLOOR if is_floor else types[0])


class Handled(Struct, frozen=True, kw_only=True):
    """A load that is picked or dropped. `station`: the name of its support; empty: the floor. `height`: of its underside over the floor,
    in metres; None: not known. `loads`: what the vehicle carries."""

    action_type: str
    thing: str
    station: str
    station_type: str
    load_type: str | None
    height: float | None
    loads: Sequence[Load]


def parameters_of(handled: Handled, factsheet: Factsheet | None) -> tuple[ActionParameter, ...]:
    """The parameters of an action: of those that the factsheet lists, or all but `LISTED` if it lists none."""
    load_sets = factsheet.load_specification.load_sets if factsheet is not None else None
    values: dict[str, Any] = {
        "stationType": handled.station_type,
        "stationName": handled.station or None,
        "loadType": handled.load_type or (load_sets[0].load_type if load_sets else "DEFAULT"),
        "loadId": _fitting_load(handled.thing, factsheet),
        "height": round(handled.height, 3) if handled.height is not None else None,
        "lhd": _device(handled, factsheet),
    }
    supported = factsheet.action(handled.action_type) if factsheet is not None else None
    parameters = (supported.action_parameters or ()) if supported is not None else ()
    keys = {parameter.key for parameter in parameters} or values.keys() - LISTED
    return tuple(ActionParameter(key=key, value=value) for key, value in values.items() if key in keys and value is not None)


def unmet_parameters(factsheet: Factsheet) -> list[str]:
    """The parameters that the vehicle cannot do without, and that are not sent, such as `side of pick`."""
    supported = [action for action_type in ("pick", "drop") if (action := factsheet.action(action_type)) is not None]
    return [
        f"{parameter.key} of {action.action_type}"
        for action in supported
        for parameter in action.action_parameters or ()
        if parameter.is_optional is False and parameter.key not in SENT
    ]


def lifting_problem(height: float, load_type: str | None, factsheet: Factsheet | None) -> str | None:
    """Why a vehicle can neither take a load whose underside is at a height over the floor (m), nor put it there; None: it can."""
    load_sets = (factsheet.load_specification.load_sets or ()) if factsheet is not None else ()
    ranges = [_heights(load_set) for load_set in load_sets if load_type in (None, load_set.load_type)]
    if not ranges or any(low - INEXACT <= height <= high + INEXACT for low, high in ranges):
        return None
    low, high = min(low for low, _ in ranges), max(high for _, high in ranges)
    return f"handles loads at {low:g} to {high:g} m over the floor, and not at {height:.2f} m"


def _heights(load_set: LoadSet) -> tuple[float, float]:
    """Between which heights a load set is handled, m; a highest one of 0 is none."""
    return load_set.minimum_loadhandling_height or 0.0, load_set.maximum_loadhandling_height or float("inf")


def _fitting_load(thing: str, factsheet: Factsheet | None) -> str:
    limits = factsheet.protocol_limits.maximum_string_lengths if factsheet is not None else None
    most = limits.maximum_load_id_length if limits is not None else None
    return fitting_id(thing, StringLengths(maximum_id_length=most)) if most and len(thing) > most else thing


def _device(handled: Handled, factsheet: Factsheet | None) -> str | None:
    """The load handling device that is to take the load, or that has it; None if the factsheet names none."""
    devices = (factsheet.load_specification.load_positions or ()) if factsheet is not None else ()
    taken = {load.load_position for load in handled.loads}
    if handled.action_type == "drop":
        carrying = [load.load_position for load in handled.loads if load.load_id == handled.thing and load.load_position is not None]
        return next((device for device in [*carrying, *devices] if device in taken), next(iter(devices), None))
    return next((device for device in devices if device not in taken), next(iter(devices), None))
