"""The maps and zone sets that a simulated vehicle stores (3.0, 6.3 and 6.4.2)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import msgspec

from somrs.adapters.vda5050.messages.orders import Action, ZoneSetContent, ZoneType
from somrs.adapters.vda5050.messages.states import ActionStatus, MapStatus, StoredMap, StoredZoneSet
from somrs.adapters.vda5050.simulated.problems import Problem

DOWNLOAD_TIME = 2.0
"""Seconds that the download of a map takes."""

Refusal = tuple[Problem, str]


@dataclass(kw_only=True)
class Download:
    """A map that is being downloaded."""

    stored: StoredMap
    ends_at: float


class Storage:
    """`maps`: those that are enabled from the beginning. `can_download`: whether the server of the maps can be reached."""

    def __init__(self, maps: Collection[str]) -> None:
        self.maps = [StoredMap(map_id=map_id, map_version="1", map_status=MapStatus.ENABLED) for map_id in sorted(maps)]
        self.zone_sets: list[StoredZoneSet] = []
        self.contents: dict[str, ZoneSetContent] = {}
        self.can_download = True
        self._downloads: dict[str, Download] = {}

    @property
    def enabled_maps(self) -> set[str]:
        return {stored.map_id for stored in self.maps if stored.map_status is MapStatus.ENABLED}

    def enabled_zones(self, map_id: str) -> ZoneSetContent | None:
        """The zone set that is used on a map."""
        stored = (item for item in self.zone_sets if item.map_id == map_id and item.zone_set_status is MapStatus.ENABLED)
        return next((self.contents[item.zone_set_id] for item in stored), None)

    def take(self, content: ZoneSetContent, supported: Collection[str]) -> Refusal | None:
        """Store a zone set, which is to be enabled afterwards. Returns why it is refused, if it is."""
        if content.zone_set_id in self.contents:
            return Problem.DUPLICATE_ZONE_SET, "there is a zone set of this id"
        names = [zone.zone_id for zone in content.zones]
        if len(names) != len(set(names)):
            return Problem.MALFORMED, "two zones have the same id"
        for zone in content.zones:
            if zone.zone_type not in supported:
                return Problem.MALFORMED, f"the zone {zone.zone_id} is {zone.zone_type}, which is not supported"
            if zone.zone_type == ZoneType.ACTION and None in (zone.entry_actions, zone.during_actions, zone.exit_actions):
                return Problem.MALFORMED, f"the zone {zone.zone_id} does not say which actions there are"
            if len(zone.vertices) < 3:
                return Problem.MALFORMED, f"the zone {zone.zone_id} has less than three vertices"
        self.contents[content.zone_set_id] = content
        stored = StoredZoneSet(zone_set_id=content.zone_set_id, map_id=content.map_id, zone_set_status=MapStatus.DISABLED)
        self.zone_sets.append(stored)
        return None

    def act(self, action: Action, now: float) -> tuple[ActionStatus, Refusal | None]:
        """Carry out an instant action about maps or zone sets."""
        map_id, version, name = (str(action.parameter(key) or "") for key in ("mapId", "mapVersion", "zoneSetId"))
        stored = next((item for item in self.maps if (item.map_id, item.map_version) == (map_id, version)), None)
        zones = next((item for item in self.zone_sets if item.zone_set_id == name), None)
        match action.action_type:
            case "downloadMap" if stored is not None:
                return ActionStatus.FAILED, (Problem.DUPLICATE_MAP, f"{map_id} {version} is here already")
            case "downloadMap" if map_id and action.parameter("mapDownloadLink"):
                downloaded = StoredMap(map_id=map_id, map_version=version, map_status=MapStatus.DISABLED)
                self._downloads[action.action_id] = Download(stored=downloaded, ends_at=now + DOWNLOAD_TIME)
                return ActionStatus.RUNNING, None
            case "enableMap" if stored is not None:
                self.maps = [self._enabled(item, stored) for item in self.maps]
            case "deleteMap" if stored is not None and stored.map_status is MapStatus.DISABLED:
                self.maps.remove(stored)
            case "enableZoneSet" if zones is not None:
                self.zone_sets = [self._enabled_zone_set(item, zones) for item in self.zone_sets]
            case "deleteZoneSet" if zones is not None and zones.zone_set_status is MapStatus.DISABLED:
                self.zone_sets.remove(zones)
                del self.contents[name]
            case _:
                words = f"{action.action_type} is not possible for {name or f'{map_id} {version}'}"
                return ActionStatus.FAILED, (Problem.INVALID_INSTANT_ACTION, words)
        return ActionStatus.FINISHED, None

    def ended_downloads(self, now: float) -> list[tuple[str, ActionStatus]]:
        """The actions whose downloads have ended, and how."""
        ended = [action_id for action_id, download in self._downloads.items() if now >= download.ends_at]
        for action_id in ended:
            stored = self._downloads.pop(action_id).stored
            if self.can_download:
                self.maps.append(stored)
        return [(action_id, ActionStatus.FINISHED if self.can_download else ActionStatus.FAILED) for action_id in ended]

    @staticmethod
    def _enabled(item: StoredMap, chosen: StoredMap) -> StoredMap:
        """At most one version of a map is enabled."""
        if item.map_id != chosen.map_id:
            return item
        return msgspec.structs.replace(item, map_status=MapStatus.ENABLED if item == chosen else MapStatus.DISABLED)

    @staticmethod
    def _enabled_zone_set(item: StoredZoneSet, chosen: StoredZoneSet) -> StoredZoneSet:
        """At most one zone set of a map is enabled."""
        if item.map_id != chosen.map_id:
            return item
        return msgspec.structs.replace(item, zone_set_status=MapStatus.ENABLED if item == chosen else MapStatus.DISABLED)
