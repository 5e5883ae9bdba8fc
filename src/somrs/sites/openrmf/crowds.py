"""The people of simulated crowds (`crowd_sim`), and their lanes: an option of the import."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from somrs.sites.draft import Draft, pose
from somrs.sites.notes import Rank
from somrs.sites.openrmf.document import Document, number
from somrs.sites.openrmf.levels import Level
from somrs.sites.plan import Box, clearance

_RADIUS, _SPACING = 0.25, 0.7
_LARGEST_GROUP = 1000


def add_crowds(document: Document, draft: Draft, levels: list[Level]) -> None:
    """Add the people of each group around the point at which it starts, where there is room."""
    with document.reading("crowd_sim", ("crowd_sim",)):
        for x, y, count in _groups(document):
            spots = _spots(levels[0], x, y, count)
            for point in spots:
                draft.add(draft.numbered("Pedestrian"), "Pedestrian", pose(Box(*point, 0, 0), levels[0].elevation))
            if len(spots) < count:
                draft.notes.add(Rank.LEFT_OUT, f"{count - len(spots)} people", f"there is no room for them around ({x:g}, {y:g})")


def note_crowds(document: Document, draft: Draft, levels: list[Level]) -> None:
    """Note that people and their lanes are left out."""
    with document.reading("crowd_sim", ("crowd_sim",)):
        people = sum(count for _, _, count in _groups(document))
        lanes = sum(len(level.data.get("human_lanes") or ()) for level in levels)
        if people or lanes:
            draft.notes.add(Rank.LEFT_OUT, f"{people} people, {lanes} lanes", "the crowd is left out; --crowds imports it")


def _groups(document: Document) -> Iterator[tuple[float, float, int]]:
    """Where each group of people starts, in metres, and how many they are. Groups with names are robots."""
    crowd = document.data.get("crowd_sim") or {}
    for group in crowd.get("agent_groups") or ():
        if not group.get("agents_name"):
            count = int(number(group["agents_number"]))
            if not 0 <= count <= _LARGEST_GROUP:
                raise ValueError(f"a group has 0 to {_LARGEST_GROUP} people, not {count}")
            yield number(group["x"]), number(group["y"]), count


def _spots(level: Level, x: float, y: float, count: int) -> list[tuple[float, float]]:
    """Free points on rings around the start."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"a group starts at a point in metres, not at ({x}, {y})")
    spots: list[tuple[float, float]] = []
    solid: list[Any] = level.solid()
    for ring in range(40):
        for step in range(max(1, 6 * ring)):
            if len(spots) == count:
                return spots
            angle = 2 * math.pi * step / max(1, 6 * ring)
            point = x + ring * _SPACING * math.cos(angle), y + ring * _SPACING * math.sin(angle)
            if clearance(point, solid) >= _RADIUS:
                spots.append(point)
    return spots
