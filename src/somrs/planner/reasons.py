"""The reasons why there is no plan, as they are collected: for people in `texts`, for programs in the other fields."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from somrs.planner.model.plan import NoPlan, Obstacle


@dataclass(slots=True, eq=False)
class Reasons:
    """The fields are those of `NoPlan`. Each reason is given once, in the order in which they came."""

    unreachable: list[str] = field(default_factory=list)
    missing: dict[str, None] = field(default_factory=dict)
    unoffered: dict[str, None] = field(default_factory=dict)
    texts: dict[str, None] = field(default_factory=dict)
    obstacles: set[Obstacle] = field(default_factory=set)
    lost: dict[str, None] = field(default_factory=dict)

    def say(self, text: str) -> None:
        self.texts[text] = None

    def note_missing(self, *conditions: str) -> None:
        """What would have to hold."""
        self.missing.update(dict.fromkeys(conditions))

    def note_unoffered(self, service_types: Iterable[str]) -> None:
        """No device offers services of these types now."""
        self.obstacles.add(Obstacle.NOT_OFFERED)
        self.unoffered.update(dict.fromkeys(service_types))

    def note_lost(self, services: Iterable[str]) -> None:
        """These services would help, and were lost."""
        self.lost.update(dict.fromkeys(services))

    def no_plan(self, *, undecided: bool) -> NoPlan:
        """The answer to a request for a plan. `undecided`: there may be a plan nevertheless."""
        return NoPlan(
            explanation="; ".join(self.texts),
            unreachable=tuple(self.unreachable),
            missing=tuple(self.missing),
            unoffered=tuple(self.unoffered),
            undecided=undecided,
            separate_reasons=tuple(self.texts),
            obstacles=tuple(obstacle for obstacle in Obstacle if obstacle in self.obstacles),
            lost=tuple(self.lost),
        )
