"""The people of the site, with the links to their pages: by address, code, and a picture that a phone's camera reads."""

from __future__ import annotations

import segno
from nicegui import ui

from somrs.api.people import People, PersonView
from somrs.api.remote import LiveApi
from somrs.client.hub import News
from somrs.gui.components.rebuilt import RebuiltElement
from somrs.gui.icons import Badge, Sign
from somrs.gui.news import follow

_HERE_ONLY = "This address works on this machine only. For phones, start the system with `somrs up --host ADDRESS`."


class PeoplePanel:
    """The people, kept up to date."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._base = str(ui.context.client.request.base_url).rstrip("/")
        self._list = RebuiltElement().classes("somrs-people")
        follow(api.context.hub, "people", self._read, self._on_news)

    async def _read(self) -> None:
        self._show(await self._api.people.list())

    async def _on_news(self, news: News) -> None:
        if isinstance(news.value, People):
            self._show(news.value)
        else:
            await self._read()

    def _show(self, people: People) -> None:
        rows = [(person.name, person.code, person.available, len(person.assignments), person.problems) for person in people.people]
        self._list.show(rows, lambda: self._build(people.people))

    def _build(self, people: tuple[PersonView, ...]) -> None:
        for person in people:
            with ui.element("div").classes("somrs-people-row"):
                with ui.element("div").classes("somrs-people-name"):
                    ui.label(person.name)
                    count = len(person.assignments)
                    ui.label(f"{count} to do" if count else "nothing to do").classes("somrs-soft")
                Badge(
                    Sign("check_circle", "Available", "good") if person.available else Sign("do_not_disturb_on", "Not available", "plain")
                )
                if person.code is not None:
                    self._build_link(person.name, person.code)
                for problem in person.problems:
                    ui.label(problem).classes("somrs-trouble somrs-people-problem")
        if not people:
            ui.label("There are no people on the map.").classes("somrs-soft")

    def _build_link(self, name: str, code: str) -> None:
        url = f"{self._base}/person/{code}"
        with ui.dialog() as dialog, ui.card().props(f'aria-label="Page of {name}"').classes("somrs-people-dialog"):
            ui.label(f"Page of {name}").classes("somrs-title").props('role="heading" aria-level="2"')
            picture = segno.make(url, error="m").svg_data_uri(scale=6, border=2, dark="#000", light="#fff")
            ui.element("img").props(f'src="{picture}" alt="Code that opens the page of {name} on a phone"')
            ui.link(url, url).classes("somrs-formula")
            ui.label(f"Or open {self._base}/person and enter the code {code}.")
            if any(host in self._base for host in ("//127.0.0.1", "//localhost", "//[::1]")):
                ui.label(_HERE_ONLY).classes("somrs-soft")
            ui.button("Close", on_click=dialog.close).props("flat no-caps")
        with ui.element("div").classes("somrs-people-link"):
            ui.link("Page", url).props(f'aria-label="Page of {name}"')
            ui.label(code).classes("somrs-formula")
            ui.button(icon="qr_code_2", on_click=dialog.open).props(f'flat round dense aria-label="Code for the phone of {name}"')
