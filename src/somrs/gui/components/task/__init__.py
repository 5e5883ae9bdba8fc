"""Elements that show a task: plan, messages, timeline, story, terms and the list of tasks."""

from __future__ import annotations

from pathlib import Path

from somrs.gui.components import publish_modules

publish_modules(Path(__file__).parent / "modules")
