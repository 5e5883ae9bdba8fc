"""The zone set that a vehicle is to have on one of its maps."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import msgspec

from somrs.adapters.vda5050.frames import Frame, sent_angle
from somrs.adapters.vda5050.messages.factsheets import Factsheet
from somrs.adapters.vda5050.messages.identifiers import fitting_id
from somrs.adapters.vda5050.messages.orders import Vertex, Zone, ZoneAction, ZoneSetContent, ZoneType
from somrs.adapters.vda5050.zoning.site import SiteZone
from somrs.space.shafts import SAME_FLOOR

OWN = "somrs-"
"""How the ids of all zone sets begin that are made here."""

IMPORTANCE = [
    ZoneType.BLOCKED, ZoneType.RELEASE, ZoneType.LINE_GUIDED, ZoneType.COORDINATED_REPLANNING, ZoneType.SPEED_LIMIT, ZoneType.DIRECTED,
    ZoneType.ACTION,
]  # fmt: skip
"""Which zones come first: a vehicle may not be able to take all."""

CENTIMETRES = 2


def zone_set(frame: Frame, zones: Sequence[SiteZone], factsheet: Factsheet) -> ZoneSetContent:
    """The zones of the types that a vehicle supports. The same zones have the same id, and others another one (3.0, 6.4.2)."""
    on_floor = [zone for zone in zones if frame.level is None or abs(zone.level - frame.level) < SAME_FLOOR]
    limits = factsheet.protocol_limits.maximum_string_lengths
    written = [
        _written(zone, zone_type, frame, fitting_id(zone.name, limits), factsheet)
        for zone in on_floor
        if (zone_type := _type_for(zone, factsheet)) is not None
    ]
    written.sort(key=lambda zone: (IMPORTANCE.index(ZoneType(zone.zone_type)), zone.zone_id))
    unique = [*{zone.zone_id: zone for zone in reversed(written)}.values()][::-1]
    kept = tuple(unique[: factsheet.protocol_limits.maximum_array_lengths.zone_set_zones or None])
    digest = hashlib.sha256(msgspec.json.encode([frame.map_id, kept])).hexdigest()[:12]
    return ZoneSetContent(map_id=frame.map_id, zone_set_id=fitting_id(f"{OWN}{frame.map_id}-{digest}", limits), zones=kept)


def _type_for(zone: SiteZone, factsheet: Factsheet) -> ZoneType | None:
    """The type that a zone has for a vehicle; None if it is of no use for it.

    A vehicle that finds paths of its own keeps to the lines that it is given, or asks before it plans another path.
    """
    if zone.zone_type is ZoneType.ACTION and not any(is_possible(action, factsheet) for action in zone.actions.all):
        return None
    specification = factsheet.type_specification
    supported = specification.supported_zones or ()
    if zone.zone_type is not ZoneType.LINE_GUIDED:
        return zone.zone_type if zone.zone_type in supported else None
    if specification.navigation_types[:1] != ("FREELY_NAVIGATING",):
        return None
    if ZoneType.LINE_GUIDED in supported and factsheet.takes("trajectory"):
        return ZoneType.LINE_GUIDED
    return ZoneType.COORDINATED_REPLANNING if ZoneType.COORDINATED_REPLANNING in supported else None


def is_possible(action: ZoneAction, factsheet: Factsheet) -> bool:
    """Whether a vehicle has an action in zones."""
    supported = factsheet.action(action.action_type)
    return supported is not None and "ZONE" in supported.action_scopes


def impossible_actions(zones: Sequence[SiteZone], factsheet: Factsheet) -> list[str]:
    """The actions of zones that a vehicle does not have there, which are left out."""
    unmet = [f"{action.action_type} in {zone.name}" for zone in zones for action in zone.actions.all if not is_possible(action, factsheet)]
    return list(dict.fromkeys(unmet))


def _written(zone: SiteZone, zone_type: ZoneType, frame: Frame, zone_id: str, factsheet: Factsheet) -> Zone:
    corners = [frame.from_site(*corner) for corner in zone.outline]
    direction, has_actions = zone.direction, zone_type is ZoneType.ACTION
    entry, during, exit = (
        tuple(action for action in actions if is_possible(action, factsheet)) if has_actions else None
        for actions in (zone.actions.entry, zone.actions.during, zone.actions.exit)
    )
    return Zone(
        zone_id=zone_id,
        zone_type=zone_type.value,
        zone_descriptor=zone.name,
        vertices=tuple(Vertex(x=round(x, CENTIMETRES), y=round(y, CENTIMETRES)) for x, y in corners),
        maximum_speed=zone.maximum_speed,
        entry_actions=entry,
        during_actions=during,
        exit_actions=exit,
        release_loss_behavior="CONTINUE" if zone_type is ZoneType.RELEASE else None,
        direction=sent_angle(direction - frame.yaw) if direction is not None else None,
        directed_limitation="RESTRICTED" if zone_type is ZoneType.DIRECTED else None,
    )
