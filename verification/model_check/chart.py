"""A run as a message sequence chart in text: a lane for each side, time going down, an arrow where a message arrives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from verification.model_check.explore import Falls, Space
from verification.model_check.pair import Both, PairSpace
from verification.model_check.quotient import Quotient
from verification.model_check.sides import Step
from verification.model_check.system import Link, LinkState, Move

WIDTH = 44
"""Columns from lane to lane."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """Something that happens in a lane; `source` is the lane from which a message arrives."""

    lane: int
    text: str
    source: int | None = None


def chart_of_one(space: Space, falls: Falls) -> list[str]:
    """How one participant's part comes to break the property. The participant is to the right of the Task Manager."""
    lines: list[Line] = []
    state = space.link.first
    for move in [*space.way(falls.state), *([falls.last] if falls.last is not None else [])]:
        lines += _lines(space.link, state, move, tm=0, sm=1)
        state = move.after
    return [*_drawn(("Task Manager", "participant"), lines), f"  => {falls.why}"]


def chart_of_two(space: PairSpace, state: int, why: str) -> list[str]:
    """How two participants come to break the property, one to the left of the Task Manager and one to the right."""
    link = space.quotient.space.link
    lines: list[Line] = []
    for left, left_before, right, right_before in _lifted(space.quotient, space.way(state)):
        if left is not None:
            lines += _lines(link, left_before, left, tm=1, sm=0)
        if right is not None:
            lines += _lines(link, right_before, right, tm=1, sm=2, joint=left is not None)
    return [*_drawn(("participant A", "Task Manager", "participant B"), lines), f"  => {why}"]


def _lifted(quotient: Quotient, way: list[Both]) -> Iterator[tuple[Move | None, LinkState, Move | None, LinkState]]:
    """The run of two parts that the run of their quotients stands for: at each step what the one does, the other, or both."""
    link = quotient.space.link
    of = {state: quotient.of[at] for at, state in enumerate(quotient.space.states)}
    one, other = link.first, link.first
    for wanted in way[1:]:
        mine, its = list(link.moves(one)), list(link.moves(other))
        found = next(_matching(of, one, other, mine, its, wanted))
        yield found[0], one, found[1], other
        one, other = found[0].after if found[0] else one, found[1].after if found[1] else other


def _matching(
    of: dict[LinkState, int], one: LinkState, other: LinkState, mine: list[Move], its: list[Move], wanted: Both
) -> Iterator[tuple[Move | None, Move | None]]:
    for move in mine:
        if move.joint in ("", "claim") and sorted((of[move.after], of[other])) == [*wanted]:
            yield move, None
    for move in its:
        if move.joint in ("", "claim") and sorted((of[one], of[move.after])) == [*wanted]:
            yield None, move
    for move in mine:
        for also in its:
            same = move.joint.rstrip("+-") == also.joint.rstrip("+-") not in ("", "claim")
            if same and sorted((of[move.after], of[also.after])) == [*wanted]:
                yield move, also


def _lines(link: Link, before: LinkState, move: Move, *, tm: int, sm: int, joint: bool = False) -> Iterator[Line]:
    """The lines of one move. `joint`: the first line of it was drawn for the other participant already."""
    step = move.step
    if not isinstance(step, Step):
        post = link.down if move.who == "down" else link.up
        yield Line(lane=tm if move.who == "down" else sm, text=f"{post.name(step.token)} {step.word}")
        return
    at_tm = move.who in ("tm", "to tm")
    lane, source = (tm, sm) if at_tm else (sm, tm)
    was = (link.coordinator(before) if at_tm else link.participant(before)).session.state
    now = (link.coordinator(move.after) if at_tm else link.participant(move.after)).session.state
    becomes = f" [{now}]" if now is not was else ""
    said = [(link.down if at_tm else link.up).name(token) for token in step.says]
    answers = f", says {', '.join(said)}" if said and not step.what.startswith("says ") else ""
    about = f" to {'AB'[sm // 2]}" if at_tm and tm == 1 else ""
    what = step.what if step.what != "gives it up" or tm == 0 else f"gives up {'AB'[sm // 2]}"
    if move.who.startswith("to"):
        yield Line(lane=lane, source=source, text=f"{step.what.removeprefix('hears ')}{becomes}{answers}")
    elif joint:
        yield Line(lane=lane, text=f"  and{answers}{about if said else ''}{becomes}")
    else:
        yield Line(lane=lane, text=f"{what}{answers}{about if said else ''}{becomes}")


def _drawn(names: tuple[str, ...], lines: list[Line]) -> list[str]:
    def row(marks: dict[int, str], width: int) -> str:
        text = ""
        for lane, mark in sorted(marks.items()):
            text = text.ljust(lane * width) + mark
        return "  " + text.rstrip()

    drawn = [row(dict(enumerate(names)), WIDTH)]
    for line in lines:
        lanes = dict.fromkeys(range(len(names)), "|")
        if line.source is None:
            lanes[line.lane] = f"| {line.text}"
        elif line.source < line.lane:
            lanes[line.source] = "|" + "-" * (WIDTH - 2) + ">"
            lanes[line.lane] = f"| {line.text}"
        else:
            lanes[line.lane] = "|<" + f" {line.text} ".ljust(WIDTH - 2, "-")
        drawn.append(row(lanes, WIDTH))
    return drawn
