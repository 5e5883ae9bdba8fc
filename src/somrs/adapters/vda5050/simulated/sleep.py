"""The hibernation of a simulated vehicle (3.0, 6.2.3.1)."""

from __future__ import annotations

from somrs.adapters.vda5050.messages.states import ConnectionState
from somrs.adapters.vda5050.simulated.exchange import Garbled, Input, Instructed, Ordered, Responded, Zoned


class Sleep:
    """`action_id`: of the action by which it falls asleep, when it stands; None: it does not. `is_asleep`: it sends no states."""

    def __init__(self) -> None:
        self.action_id: str | None = None
        self.is_asleep = False

    @property
    def connection_state(self) -> ConnectionState:
        return ConnectionState.HIBERNATING if self.is_asleep else ConnectionState.ONLINE

    def ignores(self, input: Input) -> bool:
        """Whether it does not respond: asleep, it takes nothing but stopHibernation."""
        if not self.is_asleep:
            return False
        if isinstance(input, Instructed):
            return all(action.action_type != "stopHibernation" for action in input.actions.actions)
        return isinstance(input, Ordered | Zoned | Responded | Garbled)

    def wake(self) -> None:
        self.action_id, self.is_asleep = None, False
