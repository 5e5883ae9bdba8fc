"""Zone sets and maps of a vehicle: what it is to have is compared with what it says that it has."""

from __future__ import annotations

from dataclasses import dataclass

from msgspec import Struct

from somrs.adapters.vda5050.control.condition import is_idle, words_about
from somrs.adapters.vda5050.control.exchange import Refused, Send
from somrs.adapters.vda5050.control.listener import Listener
from somrs.adapters.vda5050.control.novelty import Novelty
from somrs.adapters.vda5050.control.outbox import RESEND, Outbox
from somrs.adapters.vda5050.messages.header import Topic, Version
from somrs.adapters.vda5050.messages.orders import Action, ActionParameter, BlockingType, ZoneSet, ZoneSetContent
from somrs.adapters.vda5050.messages.states import ActionStatus, MapStatus, State
from somrs.adapters.vda5050.zoning.sets import OWN

RETRY = 60.0
"""Seconds after which something is tried again that the vehicle could not do, or does not show to have done."""


class MapPackage(Struct, frozen=True, kw_only=True):
    """A map that a vehicle is to have: its version, from where it is downloaded (None: it is brought by hand), and the hash of the file."""

    map_id: str
    version: str
    link: str | None = None
    hash: str | None = None

    @property
    def parameters(self) -> dict[str, str]:
        return {"mapId": self.map_id, "mapVersion": self.version}


@dataclass(kw_only=True)
class Step:
    """Something that the vehicle was told: by an instant action, or by a zone set (None)."""

    action: Action | None
    sending_time: float
    start_time: float


class Provision:
    """`zone_sets`, `packages`: what the vehicle is to have. What is brought by others stays, except earlier versions of the same maps."""

    def __init__(self, vehicle: Listener, outbox: Outbox) -> None:
        self._vehicle, self._outbox = vehicle, outbox
        self.zone_sets: tuple[ZoneSetContent, ...] = ()
        self.packages: tuple[MapPackage, ...] = ()
        self._steps: dict[tuple[str, str], Step] = {}
        self._due: set[tuple[str, str]] = set()
        self._told = Novelty()

    def reconcile(self, state: State, now: float) -> None:
        """Send what the vehicle does not show to have done."""
        self._due = set()
        for package in self.packages:
            self._provide_map(package, state, now)
        if self._vehicle.version is Version.V3_0:
            for zone_set in self.zone_sets:
                self._provide_zone_set(zone_set, state, now)
            self._delete_zone_sets(state, now)
        self._steps = {key: step for key, step in self._steps.items() if key in self._due}

    def missing_map(self, map_ids: set[str], state: State) -> str | None:
        """A map that a vehicle does not have, of those that it needs; None if it has all, or does not say which it has."""
        if state.maps is None or (not state.maps and self._vehicle.version is not Version.V3_0):
            return None
        enabled = {stored.map_id for stored in state.maps if stored.map_status is MapStatus.ENABLED} | {self._vehicle.map_id}
        return min(map_ids - enabled, default=None)

    # Maps (3.0, 6.3)

    def _provide_map(self, package: MapPackage, state: State, now: float) -> None:
        stored = {item.map_version: item.map_status for item in state.maps or () if item.map_id == package.map_id}
        if package.version not in stored:
            if package.link is not None:
                link = {"mapDownloadLink": package.link, **({"mapHash": package.hash} if package.hash is not None else {})}
                self._act("downloadMap", package.parameters | link, state, now)
            elif state.maps is not None:
                self._tell(
                    f"does not have version {package.version} of its map {package.map_id}: bring it, or give its `link` in the settings"
                )
        elif stored[package.version] is MapStatus.DISABLED:
            if is_idle(state):
                self._act("enableMap", package.parameters, state, now)
        else:
            for version, status in stored.items():
                if status is MapStatus.DISABLED:
                    self._act("deleteMap", {"mapId": package.map_id, "mapVersion": version}, state, now)

    # Zone sets (3.0, 6.4.2)

    def _provide_zone_set(self, zone_set: ZoneSetContent, state: State, now: float) -> None:
        stored = {item.zone_set_id: item.zone_set_status for item in state.zone_sets or () if item.map_id == zone_set.map_id}
        if not zone_set.zones and not any(name.startswith(OWN) for name in stored):
            return  # the vehicle has none either
        status = stored.get(zone_set.zone_set_id)
        if status is None:
            self._send_zone_set(zone_set, now)
        elif status is MapStatus.DISABLED:
            self._act("enableZoneSet", {"zoneSetId": zone_set.zone_set_id}, state, now)

    def _send_zone_set(self, zone_set: ZoneSetContent, now: float) -> None:
        key = "zoneSet", zone_set.zone_set_id
        self._due.add(key)
        step = self._steps.get(key)
        if step is not None and now < step.sending_time + (RESEND if now < step.start_time + 3 * RESEND else RETRY):
            return
        if step is not None and now >= step.start_time + 3 * RESEND:
            self._tell(f"does not show that it has the zone set {zone_set.zone_set_id} of its map {zone_set.map_id}")
        self._steps[key] = Step(action=None, sending_time=now, start_time=step.start_time if step is not None else now)
        self._outbox.add(Send(topic=Topic.ZONE_SET, message=ZoneSet(zone_set=zone_set)))

    def _delete_zone_sets(self, state: State, now: float) -> None:
        wanted = {zone_set.zone_set_id for zone_set in self.zone_sets}
        maps = {zone_set.map_id for zone_set in self.zone_sets}
        for item in state.zone_sets or ():
            is_left_over = item.zone_set_id.startswith(OWN) and item.zone_set_id not in wanted and item.map_id in maps
            if is_left_over and item.zone_set_status is MapStatus.DISABLED:
                self._act("deleteZoneSet", {"zoneSetId": item.zone_set_id}, state, now)

    # Instant actions

    def _act(self, action_type: str, parameters: dict[str, str], state: State, now: float) -> None:
        """Send an instant action; again if it is lost, and later if the vehicle could not carry it out."""
        factsheet = self._vehicle.factsheet
        if factsheet is not None and (supported := factsheet.action(action_type)) is None:
            self._tell(f"has no {action_type}, which {' '.join(parameters.values())} needs")
            return
        if factsheet is not None and supported is not None and supported.action_parameters:
            known_keys = {parameter.key for parameter in supported.action_parameters}
            parameters = {key: value for key, value in parameters.items() if key in known_keys}
        key = action_type, " ".join(parameters.values())
        self._due.add(key)
        step = self._steps.get(key)
        if step is None or step.action is None:
            written = tuple(ActionParameter(key=name, value=value) for name, value in parameters.items())
            action = self._outbox.action(action_type, BlockingType.NONE, written)
            self._steps[key] = Step(action=action, sending_time=now, start_time=now)
            self._outbox.send_action(action)
            return
        shown = state.action(step.action.action_id)
        if shown is None and now >= step.sending_time + RESEND:
            step.sending_time = now
            self._outbox.send_action(step.action)
        elif shown is not None and shown.action_status is ActionStatus.RETRIABLE:
            if now >= step.sending_time + RETRY:
                step.sending_time = now
                self._outbox.instant("retry", ActionParameter(key="actionId", value=step.action.action_id))
        elif shown is not None and shown.action_status.is_final:
            if shown.action_status is ActionStatus.FAILED:
                self._tell(f"{key[0]} {key[1]} failed: {words_about(state, step.action.action_id)}")
            if now >= step.sending_time + RETRY:
                del self._steps[key]

    def _tell(self, words: str) -> None:
        if self._told.is_new(words):
            self._outbox.add(Refused(description=words))
