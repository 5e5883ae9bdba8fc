"""Renders a run as a message sequence chart in text: a lane for each side, time from top to bottom, an arrow for each arriving message."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from verification.model_check.explore import StateSpace, Violation
from verification.model_check.pair import SEPARATE, ClassPair, PairSpace
from verification.model_check.quotient import Quotient
from verification.model_check.sides import Action
from verification.model_check.system import Link, LinkState, Transition

WIDTH = 44
"""The distance between two lanes, in columns."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """An event in a lane; `source` is the sender's lane, if the event is the arrival of a message."""

    lane: int
    text: str
    source: int | None = None


def single_chart(space: StateSpace, violation: Violation) -> list[str]:
    """Return the chart of a shortest run of one participant that violates the property. The participant is to the right."""
    lines: list[Line] = []
    state = space.link.first
    for transition in [*space.path_to(violation.state), *([violation.last_transition] if violation.last_transition is not None else [])]:
        lines += _lines(space.link, state, transition, tm=0, sm=1)
        state = transition.target
    return [*_drawn(("Task Manager", "participant"), lines), f"  => {violation.reason}"]


def pair_chart(space: PairSpace, state: int, reason: str) -> list[str]:
    """Return the chart of a shortest run of two participants, one to the left of the Task Manager and one to the right."""
    link = space.quotient.space.link
    lines: list[Line] = []
    for left_transition, left_state, right_transition, right_state in _lift_path(space.quotient, space.path_to(state)):
        if left_transition is not None:
            lines += _lines(link, left_state, left_transition, tm=1, sm=0)
        if right_transition is not None:
            lines += _lines(link, right_state, right_transition, tm=1, sm=2, joint=left_transition is not None)
    return [*_drawn(("participant A", "Task Manager", "participant B"), lines), f"  => {reason}"]


def _lift_path(quotient: Quotient, path: list[ClassPair]) -> Iterator[tuple[Transition | None, LinkState, Transition | None, LinkState]]:
    """Yield the run of two parts that the run of their quotients represents: at each step the move of the left, the right, or both."""
    link = quotient.space.link
    classes = {state: quotient.classes[index] for index, state in enumerate(quotient.space.states)}
    left_state, right_state = link.first, link.first
    for target in path[1:]:
        left_transitions, right_transitions = list(link.transitions(left_state)), list(link.transitions(right_state))
        match = next(_matching(classes, left_state, right_state, left_transitions, right_transitions, target))
        yield match[0], left_state, match[1], right_state
        left_state, right_state = match[0].target if match[0] else left_state, match[1].target if match[1] else right_state


def _matching(
    classes: dict[LinkState, int],
    left_state: LinkState,
    right_state: LinkState,
    left_transitions: list[Transition],
    right_transitions: list[Transition],
    target: ClassPair,
) -> Iterator[tuple[Transition | None, Transition | None]]:
    for transition in left_transitions:
        if transition.joint in (*SEPARATE, "claim") and sorted((classes[transition.target], classes[right_state])) == [*target]:
            yield transition, None
    for transition in right_transitions:
        if transition.joint in (*SEPARATE, "claim") and sorted((classes[left_state], classes[transition.target])) == [*target]:
            yield None, transition
    for transition in left_transitions:
        for other_transition in right_transitions:
            is_joint = transition.joint.rstrip("+-") == other_transition.joint.rstrip("+-") not in (*SEPARATE, "claim")
            if is_joint and sorted((classes[transition.target], classes[other_transition.target])) == [*target]:
                yield transition, other_transition


def _lines(link: Link, state_before: LinkState, transition: Transition, *, tm: int, sm: int, joint: bool = False) -> Iterator[Line]:
    """Yield the lines of one move. With `joint`, the first line has been drawn for the other participant."""
    action = transition.action
    if not isinstance(action, Action):
        post = link.participant_inbox if transition.actor == "down" else link.coordinator_inbox
        yield Line(lane=tm if transition.actor == "down" else sm, text=f"{post.description(action.token)} {action.word}")
        return
    at_tm = transition.actor in ("tm", "to tm")
    lane, source = (tm, sm) if at_tm else (sm, tm)
    old_state = (link.coordinator(state_before) if at_tm else link.participant(state_before)).session.state
    new_state = (link.coordinator(transition.target) if at_tm else link.participant(transition.target)).session.state
    change = f" [{new_state}]" if new_state is not old_state else ""
    message_names = [(link.participant_inbox if at_tm else link.coordinator_inbox).description(token) for token in action.tokens]
    answers = f", sends {', '.join(message_names)}" if message_names and not action.description.startswith("sends ") else ""
    addressee = f" to {'AB'[sm // 2]}" if at_tm and tm == 1 else ""
    description = action.description if action.description != "gives it up" or tm == 0 else f"gives up {'AB'[sm // 2]}"
    if transition.actor.startswith("to"):
        yield Line(lane=lane, source=source, text=f"{action.description.removeprefix('receives ')}{change}{answers}")
    elif joint:
        yield Line(lane=lane, text=f"  and{answers}{addressee if message_names else ''}{change}")
    else:
        yield Line(lane=lane, text=f"{description}{answers}{addressee if message_names else ''}{change}")


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
