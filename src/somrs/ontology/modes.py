"""The modes of a building and of its lifts and doors: in a fire or an emergency, robots stand still; what is out of order is not used."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum

from somrs.ontology.map import Map
from somrs.ontology.objects import Change, ValueSet
from somrs.ontology.types import IN_SERVICE, MODE, OUT_OF_ORDER, PAUSED, PAUSED_FOR, WORKING, Ontology, Value
from somrs.ontology.values import value_of


class Mode(StrEnum):
    """The values of the attribute `Mode`."""

    NORMAL = "Normal"
    FIRE = "Fire"
    """There is a fire alarm in the building: robots stay where they may stand, and get no new work."""
    EMERGENCY = "Emergency"
    """As `FIRE`, for another reason."""
    OUT_OF_ORDER = OUT_OF_ORDER
    """Nobody uses the lift or the door."""


BUILDING, LIFT, DOOR, AUTOMATIC_DOOR, MOBILE_ROBOT = "Building", "Lift", "Door", "AutomaticDoor", "MobileRobot"

BUILDING_MODES = (Mode.NORMAL, Mode.FIRE, Mode.EMERGENCY)
PASSAGE_MODES = (Mode.NORMAL, Mode.OUT_OF_ORDER)
"""The modes of a lift or a door."""

_REASONS = {Mode.NORMAL: "", Mode.FIRE: "fire alarm in {}", Mode.EMERGENCY: "emergency in {}"}


def modes(map: Map) -> dict[str, Mode]:
    """The objects with another mode than Normal, by name."""
    abnormal = (mode for mode in Mode if mode is not Mode.NORMAL)
    return dict(sorted((name, mode) for mode in abnormal for name in map.with_value(MODE, mode.value)))


def hold_reason(modes: Mapping[str, Mode]) -> str:
    """Why robots stand still: the fire alarms and emergencies, such as `fire alarm in Building1`. Empty if there are none."""
    return " and ".join(reason_of(name, mode) for name, mode in sorted(modes.items()) if mode in (Mode.FIRE, Mode.EMERGENCY))


def is_stopped(device: str, map: Map, ontology: Ontology) -> bool:
    """Whether an operator has stopped a device, or paused the task for which it works."""
    return value_of(device, PAUSED, map, ontology) is True or value_of(device, PAUSED_FOR, map, ontology) is not None


def stands_still(device: str, map: Map, ontology: Ontology) -> bool:
    """Whether a device must not move now: an operator has stopped it, or it is a robot in a fire or an emergency."""
    if is_stopped(device, map, ontology):
        return True
    object = map.objects.get(device)
    return object is not None and ontology.is_subtype(object.type, MOBILE_ROBOT) and bool(hold_reason(modes(map)))


def freed_devices(changes: Iterable[Change], map: Map, ontology: Ontology) -> set[str]:
    """The devices that may work again by these changes of the map, which are made."""
    allowed: dict[str, tuple[Value | None, ...]] = {
        PAUSED: (False, None),
        PAUSED_FOR: (None,),
        IN_SERVICE: (True, None),
        MODE: (Mode.NORMAL.value, None),
    }
    values = [change for change in changes if isinstance(change, ValueSet)]
    freed = {change.object for change in values if change.value in allowed.get(change.path, ())}
    repaired = (change.object for change in values if change.path == WORKING and change.value is not False)
    freed |= {name for name in repaired if _opens_by_itself(name, map, ontology)}  # robots that need it refused
    if any(ontology.is_subtype(object.type, BUILDING) for name in freed if (object := map.objects.get(name)) is not None):
        kinds = (type for type in ontology.types if ontology.is_subtype(type, MOBILE_ROBOT))
        freed |= {robot for kind in kinds for robot in map.of_type(kind)}
    return freed


def closed_passages(map: Map, ontology: Ontology) -> tuple[str, ...]:
    """The lifts and doors that nobody uses, by name: those that are out of order, and lifts and automatic doors that do not work or are out
    of service.

    Another door that does not work may stand open.
    """
    closed = {name for name, mode in modes(map).items() if mode is Mode.OUT_OF_ORDER}
    idle = {name for path in (WORKING, IN_SERVICE) for name in map.with_value(path, False)}
    return tuple(sorted(closed | {name for name in idle if _opens_by_itself(name, map, ontology)}))


def _opens_by_itself(name: str, map: Map, ontology: Ontology) -> bool:
    """Whether it is a lift or a door that opens for robots."""
    object = map.objects.get(name)
    return object is not None and any(ontology.is_subtype(object.type, kind) for kind in (LIFT, AUTOMATIC_DOOR))


def out_of_order(names: Sequence[str]) -> str:
    """Such as `Door1 and Door2 are out of order`."""
    return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} out of order"


def why_closed(passages: Sequence[str], zones: Sequence[str]) -> str:
    """Why ways are closed, such as `Door1 is out of order and Zone1 is a no-go zone`. `passages`: lifts and doors that are out of order."""
    reasons = [out_of_order(passages)] if passages else []
    if zones:
        reasons.append(f"{' and '.join(zones)} {'is a no-go zone' if len(zones) == 1 else 'are no-go zones'}")
    return " and ".join(reasons)


def reason_of(name: str, mode: Mode) -> str:
    """The reason for which something waits, for users."""
    return out_of_order([name]) if mode is Mode.OUT_OF_ORDER else _REASONS[mode].format(name)
