"""Alerts by sound, vibration and a notice of the browser, for a page that its user does not look at all the time."""

from __future__ import annotations

from nicegui.element import Element


class Alert(Element, component="alert.js"):
    """A switch for alerts; the browser remembers it."""

    def announce(self, text: str) -> None:
        """Alert the user, if alerts are on."""
        self.run_method("announce", text)
