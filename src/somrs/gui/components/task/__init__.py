"""A task: its plan, messages, timeline, story and terms, each an element of its own."""

MODULES = {"somrs-task": "modules"}
"""What they are made of, as the browser finds it."""
