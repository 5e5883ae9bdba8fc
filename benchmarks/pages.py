"""Measures how long pages take in a real browser until they are usable: on the paper's scenario, on a map of 5,000 objects, and of a task
with more than 1,000 messages; and how long a change takes to reach another viewer. Medians, in milliseconds.

It uses real processes, and Chromium without a screen. `gui.py` runs it; it also runs alone as `python benchmarks/pages.py`.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import statistics
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright
from rich.console import Console
from rich.table import Table

from somrs.access.rights import PersonRole
from somrs.access.store import AccessStore
from somrs.cli.import_commands import import_site
from somrs.deployment.system import System
from somrs.ontology.files.dump import dump_map
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.objects import Fact, Object
from somrs.ontology.types import Value

SCENARIO = Path(__file__).parents[1] / "src" / "somrs" / "demo" / "data" / "scenario-1.yaml"
DOMAIN = Path(__file__).parents[1] / "examples" / "parcels" / "domain.pddl"
CHROMIUM = "/usr/bin/chromium"
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
ROUNDS = 5
SIDE = 50
"""The number of tables along each side of the large hall; each has a jar on it."""
PARCELS = 45
TASK_TIME = 600.0
"""Seconds for a task with this number of parcels."""

Measure = Callable[[], float]


def main() -> None:
    table = Table(title="Pages: milliseconds until they are usable", title_justify="left")
    for column in ("", "first", "median", "worst"):
        table.add_column(column, justify="left" if not column else "right")
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS])
        with tempfile.TemporaryDirectory() as folder:
            scenario(browser, Path(folder), table)
        with tempfile.TemporaryDirectory() as folder:
            hall(browser, Path(folder), table)
        with tempfile.TemporaryDirectory() as folder:
            long_task(browser, Path(folder), table)
        browser.close()
    Console(width=120).print(table)


class Running:
    """A system whose event loop runs in another thread, because Playwright uses the loop of this one. `url`: of its windows."""

    def __init__(self, site: list[Path], data: Path) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._system = System(site, data, speed="max", windows=True)
        self.url, self._session, self._cookie = "", "", ""

    def __enter__(self) -> Running:
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._system.start(), self._loop).result()
        self.url = self._system.addresses.gui or ""
        store = AccessStore(self._system.data)
        store.add_account("Benchmark", PersonRole.ADMINISTRATOR)
        self._session, self._cookie = store.open_session("Benchmark"), store.read().cookie
        return self

    def __exit__(self, *exception: object) -> None:
        asyncio.run_coroutine_threadsafe(self._system.stop(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def page(self, browser: Browser) -> Page:
        """A page of a browser with an empty cache, in which an administrator has signed in."""
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.add_cookies([{"name": self._cookie, "value": self._session, "url": self.url}])
        return context.new_page()

    def ask(self, path: str, body: object = None) -> Any:
        headers = {"Authorization": f"Bearer {self._session}", "Content-Type": "application/json"}
        data = json.dumps(body).encode() if body is not None else None
        with urllib.request.urlopen(urllib.request.Request(f"{self.url}/api{path}", data=data, headers=headers), timeout=60) as answer:
            return json.load(answer)


def row(table: Table, name: str, times: list[float]) -> None:
    first, *rest = times
    table.add_row(name, f"{first:.0f}", f"{statistics.median(rest or times):.0f}", f"{max(times):.0f}")


def open_page(page: Page, url: str, usable: str) -> float:
    """Return the milliseconds from the request for the page until the element `usable` is visible."""
    started_at = time.perf_counter()
    page.goto(url, wait_until="commit")
    page.locator(usable).first.wait_for(state="visible", timeout=120_000)
    return (time.perf_counter() - started_at) * 1000


def scenario(browser: Browser, folder: Path, table: Table) -> None:
    with Running([SCENARIO], folder / "data") as running:
        for name, path, usable in (
            ("first page", "/", "text=Parts of the system"),
            ("map", "/map", "[data-name=Table002]"),
            ("ontology", "/ontology", "[role=treeitem]"),
            ("new task", "/define", "[data-name=Table002]"),
            ("tasks", "/tasks", "text=New task"),
            ("fleet", "/fleet", "text=Robot1"),
            ("history", "/history", "text=Export"),
        ):
            page = running.page(browser)
            row(table, name, [open_page(page, running.url + path, usable) for _ in range(ROUNDS)])
            page.context.close()


def hall_map() -> Map:
    """Return a storey with 2,500 tables in rows, and a jar on each."""
    width = 3.0 * (SIDE + 1)
    floor: dict[str, Value] = {"PositionX": width / 2, "PositionY": width / 2, "PositionZ": -0.1, "Shape.Form": "Box", "Shape.Height": 0.1}
    objects = [
        Object(name="Building1", type="Building"),
        Object(name="Storey1", type="Storey"),
        Object(name="Floor1", type="Floor", values={**floor, "Shape.Width": width, "Shape.Depth": width}),
    ]
    facts = [Fact("isPartOf", ("Storey1", "Building1")), Fact("isPartOf", ("Floor1", "Storey1"))]
    shape: dict[str, Value] = {"Shape.Form": "Box", "Shape.Width": 1.2, "Shape.Depth": 0.7, "Shape.Height": 0.75}
    for n in range(SIDE * SIDE):
        position: dict[str, Value] = {"PositionX": 3.0 * (n % SIDE + 1), "PositionY": 3.0 * (n // SIDE + 1), "PositionZ": 0.0}
        objects += [
            Object(name=f"Table{n}", type="Table", values={**position, **shape}),
            Object(name=f"Jar{n}", type="Jar", values={**position, "PositionZ": 0.75, "Color": "Red"}),
        ]
        facts.append(Fact("isOn", (f"Jar{n}", f"Table{n}")))
    return Map(objects, facts)


def hall(browser: Browser, folder: Path, table: Table) -> None:
    file = folder / "hall.yaml"
    file.write_text(dump_map(hall_map(), upper()), encoding="utf-8")
    with Running([file], folder / "data") as running:
        url, page, other_page = running.url, running.page(browser), running.page(browser)
        row(table, "map of 5,000 objects", [open_page(page, f"{url}/map", "[data-name=Table0]") for _ in range(ROUNDS)])
        open_page(other_page, f"{url}/map", "[data-name=Table0]")
        row(table, "  a change of one object, until another viewer sees it", [change_object(running, other_page, n) for n in range(ROUNDS)])
        open_page(page, f"{url}/map", "[data-name=Table0]")
        row(table, "  one step of the mouse wheel, until it is drawn", [zoom_page(page) for _ in range(ROUNDS)])
        row(table, "new task, 5,000 objects", [open_page(page, f"{url}/define", "[data-name=Table0]") for _ in range(ROUNDS)])
        row(table, "ontology, 5,000 objects", [open_page(page, f"{url}/ontology", "[role=treeitem]") for _ in range(ROUNDS)])


def change_object(running: Running, other_page: Page, n: int) -> float:
    started_at = time.perf_counter()
    cup = {"name": f"Cup{n}", "type": "Cup", "values": {"PositionX": 3.4, "PositionY": 3.0, "PositionZ": 0.75}}
    placement = {"type": "FactAdded", "fact": {"relation": "isOn", "arguments": [f"Cup{n}", "Table0"]}}
    running.ask("/map/changes", {"changes": [{"type": "ObjectAdded", "object": cup}, placement], "author": "benchmark"})
    other_page.locator(f"[data-name=Cup{n}]").first.wait_for(state="attached", timeout=60_000)
    return (time.perf_counter() - started_at) * 1000


def zoom_page(page: Page) -> float:
    """Return the milliseconds of a zoom step until the next frame is drawn."""
    page.mouse.move(400, 400)
    started_at = time.perf_counter()
    page.mouse.wheel(0, -120)
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return (time.perf_counter() - started_at) * 1000


def parcels() -> str:
    names = [f"p{n}" for n in range(PARCELS)]
    return f"""(define (problem many) (:domain parcels)
  (:objects market mill harbour - place {" ".join(names)} - parcel (:private van1 van1 - van) (:private van2 van2 - van))
  (:init (at van1 mill) (street van1 mill market) (street van1 market mill) {" ".join(f"(lies {name} mill)" for name in names)}
    (at van2 harbour) (street van2 harbour market) (street van2 market harbour)
    (= (total-cost) 0) (= (km mill market) 4) (= (km market mill) 4) (= (km harbour market) 3) (= (km market harbour) 3))
  (:goal (and {" ".join(f"(lies {name} harbour)" for name in names)}))
  (:metric minimize (total-cost)))"""


def long_task(browser: Browser, folder: Path, table: Table) -> None:
    problem, site = folder / "problem.pddl", folder / "parcels.yaml"
    problem.write_text(parcels(), encoding="utf-8")
    with contextlib.redirect_stdout(io.StringIO()):
        import_site([DOMAIN, problem], site)
    with Running([site], folder / "data") as running:
        goal = " AND ".join(f"p{n} lies harbour" for n in range(PARCELS))
        task = running.ask("/tasks", {"effect": goal})["task"]
        deadline = time.monotonic() + TASK_TIME
        while (answer := running.ask(f"/tasks/{task}"))["view"]["outcome"] is None and time.monotonic() < deadline:
            time.sleep(0.5)
        page = running.page(browser)
        name = f"a task with {answer['messages']} messages and {len(answer['view']['steps'])} steps"
        row(table, name, [open_page(page, f"{running.url}/tasks/{task}", ".somrs-msg") for _ in range(ROUNDS)])


if __name__ == "__main__":
    main()
