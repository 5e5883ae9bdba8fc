"""The start page: the site, what currently runs, and links to the other pages."""

from __future__ import annotations

from nicegui import ui

from somrs.api.fleet import Devices
from somrs.api.remote import LiveApi
from somrs.api.system import PartView, SystemView
from somrs.client.hub import News
from somrs.gui.device_card import state
from somrs.gui.icons import Badge, Sign
from somrs.gui.news import follow
from somrs.gui.pages.task_text import task_sign
from somrs.gui.shell import PAGE_LINKS, page

MOST_TASKS = 6
"""Number of tasks shown."""

DESCRIPTIONS = {
    "/map": "Floor plan and 3D view, now and in the past: view, search, edit.",
    "/ontology": "Types of objects, attributes, relations and services.",
    "/define": "Enter a goal, preview the plan and its price, and start it.",
    "/tasks": "Running tasks: who does what, what failed, and how the system recovered.",
    "/fleet": "Devices, their services and their current work.",
    "/history": "Ended tasks: search, read, export.",
}


def register(api: LiveApi) -> None:
    @ui.page("/")
    async def start() -> None:
        with page("Start", "/", api), ui.element("div").classes("somrs-start"):
            head = ui.element("div").classes("somrs-start-head")
            with ui.element("div").classes("somrs-start-ways"):
                for place in PAGE_LINKS:
                    with ui.link(target=place.path).classes("somrs-start-way somrs-sheet"):
                        ui.icon(place.icon).props('aria-hidden="true"')
                        with ui.element("div"):
                            ui.label(place.label).classes("somrs-start-label")
                            ui.label(DESCRIPTIONS[place.path]).classes("somrs-soft")
            with ui.element("div").classes("somrs-start-now"):
                tasks, fleet, parts = (_sheet(title) for title in ("Running tasks", "Fleet", "Parts of the system"))

        async def show_system(news: News | None = None) -> None:
            system = news.value if news is not None and isinstance(news.value, SystemView) else await api.system.read()
            head.clear()
            with head:
                ui.label(system.site or "SO-MRS").classes("somrs-title").props("role=heading aria-level=1")
                ui.label(f"{system.objects} objects of {system.types} types, map version {system.map_version}").classes("somrs-soft")
            parts.clear()
            with parts:
                for part in system.parts:
                    _part(part)

        async def show_tasks(news: News | None = None) -> None:
            task_list = await api.tasks.list(running=True, limit=MOST_TASKS)
            tasks.clear()
            with tasks:
                for task in task_list.rows:
                    with ui.link(target=f"/tasks/{task.task}").classes("somrs-start-row"):
                        Badge(task_sign(task.phase, task.outcome))
                        ui.label(task.effect).classes("somrs-formula")
                if not task_list.rows:
                    ui.label("No task is running.").classes("somrs-soft")

        async def show_fleet(news: News | None = None) -> None:
            device_list = news.value if news is not None and isinstance(news.value, Devices) else await api.fleet.devices()
            fleet.clear()
            with fleet:
                for device in device_list.devices:
                    with ui.element("div").classes("somrs-start-row"):
                        Badge(state(device))
                        ui.label(device.name)
                        ui.label(", ".join(dict.fromkeys(service.type for service in device.services))).classes("somrs-soft")
                if not device_list.devices:
                    ui.label("There are no devices on the map, and no services on offer.").classes("somrs-soft")

        for topic, refresh in (("system", show_system), ("tasks", show_tasks), ("fleet", show_fleet)):
            follow(api.context.hub, topic, refresh, refresh)


def _sheet(title: str) -> ui.element:
    with ui.element("section").classes("somrs-sheet"):
        ui.label(title).classes("somrs-start-label").props("role=heading aria-level=2")
        return ui.element("div").classes("somrs-start-rows")


def _part(part: PartView) -> None:
    with ui.element("div").classes("somrs-start-row"):
        Badge(Sign("check_circle", "Responds", "good") if part.milliseconds is not None else Sign("error", "No response", "bad"))
        ui.label(part.name)
        ui.label(f"{part.milliseconds:g} ms" if part.milliseconds is not None else part.problem).classes("somrs-soft")
