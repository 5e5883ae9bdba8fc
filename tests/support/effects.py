"""What a part of a component does."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

from somrs.kernel.component import Effect, Send

T = TypeVar("T")


def run_effects(generator: Generator[Effect, None, T]) -> tuple[list[Effect], T]:
    """Return the effects, and the result."""
    effects: list[Effect] = []
    while True:
        try:
            effects.append(next(generator))
        except StopIteration as end:
            return effects, end.value


def bodies(effects: list[Effect]) -> list[object]:
    """Return the bodies that are sent, in order."""
    return [effect.message.body for effect in effects if isinstance(effect, Send)]
