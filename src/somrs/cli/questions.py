"""The implementations of `somrs questions` and `somrs answer`."""

from __future__ import annotations

import time
from pathlib import Path

from somrs.client import terminal
from somrs.client.questions import open_questions, put_answer


def questions(data: Path, *, json: bool) -> None:
    """List the open questions."""
    questions = open_questions(data)
    if json:
        terminal.print_json(questions)
    elif not questions:
        print("no open questions")
    else:
        rows = (
            (question.number, question.person, question.text, f"{max(0.0, question.until - time.time()):.0f} s") for question in questions
        )
        terminal.console().print(terminal.table("Open questions", ("number", "to", "question", "time left"), rows))
        print("Answer with: somrs answer NUMBER FORMULA. The formula states what holds now. --cannot-tell: you do not know.")


def answer(number: int, formula: str | None, data: Path) -> None:
    """Answer a question; `formula` is None for "cannot tell". Raises UsageError for an unsuitable answer."""
    put_answer(number, formula, data)
    print("answer accepted")
