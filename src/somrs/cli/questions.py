"""What `somrs questions` and `somrs answer` do."""

from __future__ import annotations

import time
from pathlib import Path

from somrs.client import terminal
from somrs.client.questions import open_questions, put_answer


def questions(data: Path, *, json: bool) -> None:
    """List the open questions."""
    found = open_questions(data)
    if json:
        terminal.print_json(found)
    elif not found:
        print("nobody asks anything")
    else:
        rows = ((one.number, one.person, one.text, f"{max(0.0, one.until - time.time()):.0f} s") for one in found)
        terminal.console().print(terminal.table("Open questions", ("number", "to", "question", "time left"), rows))
        print("Answer with: somrs answer NUMBER FORMULA, such as `Jar002 isOn Table001`")


def answer(number: int, formula: str | None, data: Path) -> None:
    """Answer a question; None: the person cannot tell. Raises UsageError when the answer will not do, with what is wrong."""
    put_answer(number, formula, data)
    print("thank you")
