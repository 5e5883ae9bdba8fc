"""The first page, and what all pages have in common."""

from __future__ import annotations

import json
import re
import urllib.request
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from .conftest import WIDTHS, RunningSystem, every_look, fits, resize, take_screenshot

PLACES = ["Map", "Ontology", "New task", "Tasks", "Fleet", "History"]


def test_every_page_is_one_click_away_and_fits_every_window(system: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(system.url)
    with urllib.request.urlopen(f"{system.url}/api/map") as answer:
        version = json.load(answer)["version"]
    for text in (f"version {version}", "No task is running.", "Robot2", "simulator"):
        expect(page.get_by_text(text).first).to_be_visible()
    for look in every_look(page):
        take_screenshot(page, f"start-{look}")
    for place in PLACES:
        page.get_by_role("navigation").get_by_role("link", name=place).click()
        page.wait_for_url("**/" + {"New task": "define"}.get(place, place.lower()))
        assert page.get_by_role("navigation").locator("[aria-current=page]").get_attribute("aria-label") == place
        for size in WIDTHS:
            resize(page, size)
            assert fits(page), f"{place} is wider than the window"


def test_the_api_describes_itself(system: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(f"{system.url}/api/")
    page.get_by_text("/map/query").first.wait_for()
    with urllib.request.urlopen(f"{system.url}/api/openapi.json") as answer:
        described = json.load(answer)
    assert described["openapi"].startswith("3.1")
    assert all(operation["summary"] for path in described["paths"].values() for operation in path.values())


WATCH_PLACES = """
window.moved = () => seen.filter(({element, at}) => {
    const now = element.getBoundingClientRect();
    return element.isConnected && now.width && Math.hypot(now.x - at.x, now.y - at.y) > 2;
}).map(({words}) => words);
window.seen = [];
const look = () => {
    for (const element of document.querySelectorAll("button, a, input, [role=switch], [role=tab]")) {
        const at = element.getBoundingClientRect();
        if (!at.width || !at.height || at.y > 120 || seen.some((one) => one.element === element)) continue;
        seen.push({element, at, words: element.getAttribute("aria-label") || element.textContent});
    }
    requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""
"""What can be pressed in the head of a page, and is not where it was when it was first shown."""


@pytest.mark.parametrize(
    ("path", "read"),
    [
        ("/", re.compile(r"version \d+")),
        ("/map", re.compile(r"\d+ objects")),
        ("/ontology", re.compile("PhysicalObject")),
        ("/define", re.compile("Robot2")),
        ("/tasks", re.compile(r"There are no tasks yet|ago|just now|Jar00")),
        ("/fleet", re.compile("Robot2")),
        ("/history", re.compile("No task has ended|Jar00")),
    ],
    ids=["start", "map", "ontology", "define", "tasks", "fleet", "history"],
)
def test_what_can_be_pressed_stays_where_it_is_while_the_page_is_read(
    system: RunningSystem, window: Callable[..., Page], path: str, read: re.Pattern[str]
) -> None:
    """Who presses early would press something else."""
    page = window("about:blank")
    page.add_init_script(WATCH_PLACES)
    page.goto(f"{system.url}{path}")
    expect(page.get_by_role("main").last).to_contain_text(read)
    page.wait_for_load_state("networkidle")
    assert page.evaluate("seen.length") > 8
    assert page.evaluate("moved()") == []
