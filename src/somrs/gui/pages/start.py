"""The first page: what runs here, what it does just now, and the ways on."""

from __future__ import annotations

from nicegui import ui

from somrs.api.fleet import Devices
from somrs.api.remote import LiveApi
from somrs.api.system import PartView, SystemView
from somrs.client.hub import News
from somrs.gui.device_card import state
from somrs.gui.icons import Badge, Sign
from somrs.gui.news import follow
from somrs.gui.pages.task_words import sign
from somrs.gui.shell import PLACES, page

MOST_TASKS = 6
"""Tasks that are shown here."""

ABOUT = {
    "/map": "The floor plan and the scene as they are, and as they were: look, search, edit.",
    "/ontology": "The words that things, devices and services are described with.",
    "/define": "Say what is to be so, see the plan and what it costs, and start it.",
    "/tasks": "What is under way: who does what, what failed, and how it was answered.",
    "/fleet": "Devices and services, as they come and go.",
    "/history": "Tasks that are over: find them, read them, export them.",
}


def register(desk: LiveApi) -> None:
    @ui.page("/")
    async def start() -> None:
        with page("Start", "/", desk), ui.element("div").classes("somrs-start"):
            head = ui.element("div").classes("somrs-start-head")
            with ui.element("div").classes("somrs-start-ways"):
                for place in PLACES:
                    with ui.link(target=place.path).classes("somrs-start-way somrs-sheet"):
                        ui.icon(place.icon).props('aria-hidden="true"')
                        with ui.element("div"):
                            ui.label(place.label).classes("somrs-start-label")
                            ui.label(ABOUT[place.path]).classes("somrs-soft")
            with ui.element("div").classes("somrs-start-now"):
                tasks, fleet, parts = (_sheet(title) for title in ("Under way", "Fleet", "Parts of the system"))

        async def show_system(news: News | None = None) -> None:
            seen = news.value if news is not None and isinstance(news.value, SystemView) else await desk.system.read()
            head.clear()
            with head:
                ui.label(seen.site or "SO-MRS").classes("somrs-title").props("role=heading aria-level=1")
                ui.label(f"{seen.objects} objects of {seen.types} types, map version {seen.map_version}").classes("somrs-soft")
            parts.clear()
            with parts:
                for part in seen.parts:
                    _part(part)

        async def show_tasks(news: News | None = None) -> None:
            found = await desk.tasks.list(running=True, limit=MOST_TASKS)
            tasks.clear()
            with tasks:
                for task in found.rows:
                    with ui.link(target=f"/tasks/{task.task}").classes("somrs-start-row"):
                        Badge(sign(task.phase, task.outcome))
                        ui.label(task.effect).classes("somrs-formula")
                if not found.rows:
                    ui.label("No task is under way.").classes("somrs-soft")

        async def show_fleet(news: News | None = None) -> None:
            seen = news.value if news is not None and isinstance(news.value, Devices) else await desk.fleet.devices()
            fleet.clear()
            with fleet:
                for device in seen.devices:
                    with ui.element("div").classes("somrs-start-row"):
                        Badge(state(device))
                        ui.label(device.name)
                        ui.label(", ".join(dict.fromkeys(one.type for one in device.services))).classes("somrs-soft")
                if not seen.devices:
                    ui.label("There are no devices on the map, and nobody offers anything.").classes("somrs-soft")

        for topic, show in (("system", show_system), ("tasks", show_tasks), ("fleet", show_fleet)):
            follow(desk.context.hub, topic, show, show)


def _sheet(title: str) -> ui.element:
    with ui.element("section").classes("somrs-sheet"):
        ui.label(title).classes("somrs-start-label").props("role=heading aria-level=2")
        return ui.element("div").classes("somrs-start-rows")


def _part(part: PartView) -> None:
    with ui.element("div").classes("somrs-start-row"):
        Badge(Sign("check_circle", "Answers", "good") if part.milliseconds is not None else Sign("error", "Silent", "bad"))
        ui.label(part.name)
        ui.label(f"{part.milliseconds:g} ms" if part.milliseconds is not None else part.problem).classes("somrs-soft")
