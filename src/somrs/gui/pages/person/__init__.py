"""The page of a person who does steps of tasks, for a phone."""

from somrs.gui.pages.person.page import register

__all__ = ["register"]
