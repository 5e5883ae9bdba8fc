"""Elements that show a task: plan, messages, timeline, story, terms and the list of tasks."""

MODULES = {"somrs-task": "modules"}
"""JavaScript modules shared by these elements, by import name."""
