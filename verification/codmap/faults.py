"""Draws the faults of a problem's execution from a seed, so that a run can be repeated."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field

from somrs.devices.symbolic.agent import Mishap
from somrs.ontology.objects import Change, objects_of
from somrs.service_manager.sdk.orders import Order

LEAVING = 0.2
"""The share of the problems in which one agent leaves permanently."""

EARLY = 20
"""The agent leaves at its first execution after up to this many executions of all agents."""


@dataclass
class Faults:
    """The faults. A `share` of the executions fail, half of them with a part of their effect. `leaver` leaves without a message, if set."""

    share: float
    seed: str
    agents: Sequence[str]
    leaver: str | None = None
    works: int = 0
    mishaps: int = 0
    has_departed: bool = False
    _departure: int = 0
    _dice: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self._dice = random.Random(f"{self.seed}/works")
        dice = random.Random(f"{self.seed}/leaver")
        if self.share > 0 and len(self.agents) > 1 and dice.random() < LEAVING:
            self.leaver, self._departure = dice.choice(sorted(self.agents)), dice.randrange(EARLY)

    def mishap(self, agent: str, order: Order) -> Mishap | None:
        """Return the fault of the agent's next execution, if any."""
        self.works += 1
        if agent == self.leaver and self.works > self._departure:
            self.has_departed = True
            return Mishap(select_changes=self._select_changes, goes_offline=True)
        if self._dice.random() >= self.share:
            return None
        self.mishaps += 1
        return Mishap(select_changes=self._select_changes) if self._dice.random() < 0.5 else Mishap()

    def _select_changes(self, changes: Sequence[Change]) -> Sequence[Change]:
        """Select the objects that change. An object changes completely or not at all, so that it is never without a place."""
        is_changed = {objects_of(change)[0]: self._dice.random() < 0.5 for change in changes}
        return [change for change in changes if is_changed[objects_of(change)[0]]]
