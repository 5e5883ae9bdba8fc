"""The actions of zones that a simulated vehicle performs when it enters, crosses and leaves them (3.0, table 6)."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping

import msgspec

from somrs.adapters.vda5050.messages.orders import Zone, ZoneAction
from somrs.adapters.vda5050.messages.states import ActionState, ActionStatus


class ZoneActionLog:
    """`states`: those of the actions, by the ids that the vehicle gives them. Actions at the border of a zone take no time."""

    def __init__(self) -> None:
        self.states: dict[str, ActionState] = {}
        self._occupied: dict[str, Zone] = {}
        self._running: dict[str, list[str]] = {}
        self._numbers = itertools.count(1)

    def move(self, occupied: Mapping[str, Zone]) -> None:
        """The vehicle touches these zones, by id."""
        entered = [zone for name, zone in occupied.items() if name not in self._occupied]
        departed = [zone for name, zone in self._occupied.items() if name not in occupied]
        self._occupied = {**occupied}
        for zone in departed:
            for action_id in self._running.pop(zone.zone_id, []):
                self.states[action_id] = msgspec.structs.replace(self.states[action_id], action_status=ActionStatus.FINISHED)
            self._perform(zone.exit_actions or (), ActionStatus.FINISHED)
        for zone in entered:
            self._perform(zone.entry_actions or (), ActionStatus.FINISHED)
            self._running[zone.zone_id] = self._perform(zone.during_actions or (), ActionStatus.RUNNING)

    def drop_ended(self) -> None:
        self.states = {key: state for key, state in self.states.items() if not state.action_status.is_final}

    def _perform(self, actions: Iterable[ZoneAction], status: ActionStatus) -> list[str]:
        ids = []
        for action in actions:
            ids.append(action_id := f"zone-action-{next(self._numbers)}")
            self.states[action_id] = ActionState(action_id=action_id, action_type=action.action_type, action_status=status)
        return ids
