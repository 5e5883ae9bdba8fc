"""The instant actions that a simulated vehicle has received (3.0, 6.2.1)."""

from __future__ import annotations

from enum import Enum, auto

import msgspec

from somrs.adapters.vda5050.messages.orders import Action
from somrs.adapters.vda5050.messages.states import ActionState, ActionStatus


class Ending(Enum):
    """What ends an instant action that is running."""

    STANDS = auto()
    """The vehicle stands."""
    DOES_NOTHING = auto()
    """The vehicle stands, and what it was working on has stopped."""
    IS_DISCONNECTED = auto()
    """The vehicle is not connected with the charger."""


class InstantLog:
    """`states`: those of the actions, by id."""

    def __init__(self) -> None:
        self.states: dict[str, ActionState] = {}
        self._running: dict[str, Ending] = {}

    def note(self, action: Action, status: ActionStatus, ending: Ending | None = None) -> None:
        """Note an action. `ending`: what ends it, if it is running."""
        self.states[action.action_id] = ActionState(action_id=action.action_id, action_type=action.action_type, action_status=status)
        if ending is not None:
            self._running[action.action_id] = ending

    def end(self, action_id: str, status: ActionStatus) -> None:
        self.states[action_id] = msgspec.structs.replace(self.states[action_id], action_status=status)

    def is_waiting(self, ending: Ending) -> bool:
        return ending in self._running.values()

    def has_come(self, ending: Ending) -> None:
        """What ends some actions is so."""
        for action_id in [action_id for action_id, awaited in self._running.items() if awaited is ending]:
            del self._running[action_id]
            self.end(action_id, ActionStatus.FINISHED)

    def drop_ended(self) -> None:
        self.states = {key: state for key, state in self.states.items() if not state.action_status.is_final}
