"""The first page: what needs attention, what runs, who is ready, and a task to try.

`page.py` is the page. `rows.py` makes rows of what the API answers, `row_list.py` shows them, `example_goal.py` finds the task to try.
"""

from __future__ import annotations

from somrs.gui.pages.start.page import register

__all__ = ["register"]
