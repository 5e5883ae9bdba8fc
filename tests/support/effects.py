"""What a part of a component does."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

from msgspec import structs

from somrs.kernel.component import Effect, Send
from somrs.protocol.messages.observations import Observation

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
    """Return the bodies that are sent, in order, without the times at which they were observed."""
    return [timeless(effect.message.body) for effect in effects if isinstance(effect, Send)]


def timeless(body: object) -> object:
    """Return a report without an observation that says only when it was made."""
    observation = getattr(body, "observation", None)
    if observation is not None and observation == Observation(as_of=observation.as_of, caused=observation.caused):
        return structs.replace(body, observation=None)  # type: ignore[type-var]  # a Struct with an observation
    return body
