"""Draw the tables of `states.py` as a page of Mermaid diagrams and Markdown tables.

`python -m somrs.protocol.frp.diagram docs/reference/frp-states.md` writes the page; without an argument, the command prints it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from somrs.protocol.frp import states
from somrs.protocol.frp.states import Entry, Kind, MessageType, Sends, Table
from somrs.protocol.messages.frp import Cancel, End, Progress, Query, State

PAGE = Path("docs/reference/frp-states.md")

_HEAD = """# The states of the Failure Recovery Protocol

Made from the tables in `src/somrs/protocol/frp/states.py` by `python -m somrs.protocol.frp.diagram docs/reference/frp-states.md`.
[The explanation of the protocol](../explanation/failure-recovery-protocol.md) describes its purpose and how to read it.

In the diagrams, `?Execute` is a received message, `!Completed` a message that is sent unasked, and `?Stop !Stopped` a received message with
its immediate answer. In the tables, `→ State` is a transition, `news` is new information in the same state, `again` means "already done:
answer again", and `·` means "too late: ignore".
"""


def page() -> str:
    """Return the whole page."""
    return "\n".join(
        [
            _HEAD,
            "## The participant",
            "",
            "The diagram omits End and Cancel, which lead from every state to Ended, and Query, which changes nothing.",
            "",
            *_mermaid(states.PARTICIPANT, states.PARTICIPANT_SENDS, {}, frozenset((End, Cancel, Query))),
            "",
            *_grid(states.PARTICIPANT, states.TO_PARTICIPANT),
            "",
            *_unbegun(),
            "",
            "## The coordinator's view of a participant",
            "",
            "`silent` is the coordinator's own transition, after a timeout.",
            "",
            *_mermaid(states.COORDINATOR, states.COORDINATOR_SENDS, states.ABANDONED_STATES, frozenset()),
            "",
            *_grid(states.COORDINATOR, states.TO_COORDINATOR),
            "",
        ]
    )


def _unbegun() -> Iterator[str]:
    """Yield the answers to an Execute that must not be carried out."""
    yield "An Execute that comes after its `begin_by`, or does not say that the condition of the Terms holds, starts nothing:"
    yield ""
    yield "| state | transition and answer |"
    yield "|---|---|"
    for state, answer in states.UNBEGUN.items():
        yield f"| **{state}** | → {states.PARTICIPANT_SENDS[state][answer]} !{answer.__name__} |"


def _mermaid(table: Table, sends: Sends, silent: dict[State, State], excluded: frozenset[MessageType]) -> Iterator[str]:
    """Yield a state diagram with one arrow for each pair of states, labelled with all messages that lead from one to the other."""
    arrows: dict[tuple[State, State], list[str]] = {}
    for state, after_sending in sends.items():
        for message, target in after_sending.items():
            if message is not Progress:
                arrows.setdefault((state, target), []).append(f"!{message.__name__}")
    for state, row in table.items():
        for message, entry in row.items():
            if entry.kind is Kind.MOVES and entry.next_state is not state and message not in excluded:
                answer = f" !{entry.answer.__name__}" if entry.answer else ""
                arrows.setdefault((state, entry.next_state), []).append(f"?{message.__name__}{answer}")
    for state, target in silent.items():
        arrows.setdefault((state, target), []).append("silent")
    yield "```mermaid"
    yield "stateDiagram-v2"
    yield "    direction TB"
    yield f"    [*] --> {State.NEW}"
    for (state, target), labels in arrows.items():
        yield f"    {state} --> {target}: {', '.join(labels)}"
    yield f"    {State.ENDED} --> [*]"
    yield "```"


def _grid(table: Table, messages: tuple[MessageType, ...]) -> Iterator[str]:
    """Yield the whole table, with a row for each state and a column for each message."""
    yield f"| | {' | '.join(message.__name__ for message in messages)} |"
    yield f"|---|{'---|' * len(messages)}"
    for state, row in table.items():
        yield f"| **{state}** | {' | '.join(_cell(state, row[message]) for message in messages)} |"


def _cell(state: State, entry: Entry) -> str:
    answer = f" !{entry.answer.__name__}" if entry.answer else ""
    if entry.kind is Kind.LATE:
        return f"·{answer}"
    if entry.kind is Kind.REPEATED:
        return f"again{answer}"
    return f"→ {entry.next_state}{answer}" if entry.next_state is not state else "news"


def main(arguments: list[str]) -> None:
    if arguments:
        Path(arguments[0]).write_text(page(), encoding="utf-8")
    else:
        print(page(), end="")


if __name__ == "__main__":
    main(sys.argv[1:])
