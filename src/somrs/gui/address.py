"""What the address of a page asks for and the page does not have."""

from __future__ import annotations

from collections.abc import Collection

from nicegui import ui


class AddressBanner:
    """A banner at the top of a page with the mistakes in its address, and a link to the page without parameters.

    `path`: the page; `parameters`: the parameters that it takes. The banner is hidden while there is nothing to say.
    """

    def __init__(self, path: str, parameters: Collection[str]) -> None:
        with ui.element("div").classes("somrs-address").props('role="alert"') as self._element:
            ui.icon("link_off").props('aria-hidden="true"')
            self._problems = ui.element("div").classes("somrs-address-problems")
            with self._problems:
                ui.label("The address of this page has a mistake").classes("somrs-address-head")
            ui.link("Open the page without parameters", path)
            close = ui.button(icon="close", on_click=self._close).props('flat round dense size=sm aria-label="Close"')
            close.tooltip("Close")
        self._element.visible = False
        request = ui.context.client.request
        for name in request.query_params if request is not None else ():
            if name not in parameters:
                takes = f"it takes {', '.join(parameters)}" if parameters else "it takes none"
                self.report(f"This page has no parameter “{name}”; {takes}.")

    def report(self, problem: str) -> None:
        """Show a problem: what the address asks for, and what there is."""
        with self._problems:
            ui.label(problem)
        self._element.visible = True

    def _close(self) -> None:
        self._element.visible = False
