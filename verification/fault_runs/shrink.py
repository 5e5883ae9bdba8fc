"""A failing story made as short as it can be and still fail in the same way: first what goes wrong, then the tasks, then the devices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

from verification.fault_runs.story import Character, Fault, Story, Wish

T = TypeVar("T")

MOST_TRIES = 600
"""So many stories are played at most."""


def shrunk(story: Story, fails: Callable[[Story], bool]) -> Story:
    """The shortest story found."""
    tries = 0

    def still(candidate: Story) -> bool:
        nonlocal tries
        tries += 1
        return tries <= MOST_TRIES and fails(candidate)

    for _ in range(2):
        story = _with_faults(story, fewest(story.faults, partial(_fails, still, _with_faults, story)))
        story = _with_wishes(story, fewest(story.wishes, partial(_fails, still, _with_wishes, story)))
        story = _with_devices(story, fewest(story.devices, partial(_fails, still, _with_devices, story)))
    plain = tuple(replace(wish, handlers=(), cancelled=None, deadline=None, priority=0, previewed=False) for wish in story.wishes)
    for simpler in (replace(story, planning=0.0), replace(story, wishes=plain), replace(story, planning=0.0, wishes=plain)):
        if simpler != story and still(simpler):
            story = simpler
    return story


def _fails(still: Callable[[Story], bool], made: Callable[[Story, list[T]], Story], story: Story, kept: list[T]) -> bool:
    return still(made(story, kept))


def _with_faults(story: Story, faults: list[Fault]) -> Story:
    return replace(story, faults=tuple(faults))


def _with_wishes(story: Story, wishes: list[Wish]) -> Story:
    return replace(story, wishes=tuple(wishes))


def _with_devices(story: Story, devices: list[Character]) -> Story:
    return replace(story, devices=tuple(devices))


def fewest(all: Sequence[T], fails: Callable[[list[T]], bool]) -> list[T]:
    """Delta debugging (Zeller and Hildebrandt 2002): a list of which nothing can be left out any more without `fails` becoming false."""
    kept, parts = [*all], 2
    if kept and fails([]):
        return []
    while len(kept) >= 2:
        size = -(-len(kept) // parts)
        for start in range(0, len(kept), size):
            without = kept[:start] + kept[start + size :]
            if fails(without):
                kept, parts = without, max(parts - 1, 2)
                break
        else:
            if size == 1:
                break
            parts = min(parts * 2, len(kept))
    return kept
