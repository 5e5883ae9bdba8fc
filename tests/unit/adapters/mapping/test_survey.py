"""Where a robot looks next, on what it has seen."""

from __future__ import annotations

import math

import numpy as np

from somrs.adapters.mapping.survey import Survey
from somrs.devices.simulator.link.commands import Scan

SCAN = Scan(rays=360, range=4.0)


def looked(*, opening: float) -> Survey:
    """The survey of a robot in a square room of 4 m, in the east wall of which no ray returns from an opening of this width, m."""
    survey, ranges = Survey(radius=0.25), list[float | None]()
    for angle in -math.pi + (np.arange(SCAN.rays) + 0.5) * math.tau / SCAN.rays:
        distance = 2.0 / max(abs(math.cos(angle)), abs(math.sin(angle)))
        is_open = math.cos(angle) > 0 and abs(math.tan(angle)) * 2.0 < opening / 2
        ranges.append(None if is_open else distance)
    survey.add_scan(0.0, 0.0, 0.0, SCAN, ranges)
    return survey


def distances(survey: Survey) -> list[float]:
    """Where the robot would look, one after the other, if it saw nothing new: how far away from each frontier."""
    distances = list[float]()
    while (view := survey.next_view((0.0, 0.0))) is not None:
        survey.note_looked_at(view)
        distances += [math.dist(view.stand, frontier.middle) for frontier in view.frontiers]
        assert len(distances) < 50, "it comes to an end"
    return distances


def test_what_was_looked_at_in_vain_is_looked_at_from_elsewhere_and_then_given_up() -> None:
    survey = looked(opening=1.0)
    (first, *later) = distances(survey)
    assert first <= 4.0
    assert later
    assert survey.next_view((0.0, 0.0)) is None
    assert len(distances(looked(opening=0.0))) < len(later)
