"""The first page, and what all pages have in common."""

from __future__ import annotations

import json
import re
import urllib.request
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, expect

from somrs.gui.shell import PAGE_LINKS

from .conftest import WIDTHS, RunningSystem, fits, resize, sign_in


def test_every_page_is_one_click_away_and_fits_every_window(system: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(system.url)
    with urllib.request.urlopen(f"{system.url}/api/map") as answer:
        version = json.load(answer)["version"]
    expect(page.get_by_text(f"version {version}").first).to_be_visible()
    assert not page.evaluate("Vue.isReactive(mounted_app.elements[0])"), "updates take twice as long"
    for place in PAGE_LINKS:
        page.get_by_role("navigation").get_by_role("link", name=place.label).click()
        page.wait_for_url(f"**{place.path}")
        assert page.get_by_role("navigation").locator("[aria-current=page]").get_attribute("aria-label") == place.label
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


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("/map?storey=Attic&object=Jar002", "There is no storey Attic; the storeys are Storey001."),
        ("/map?version=999999", "The map has no version 999999; it has the versions 0 to "),
    ],
    ids=["storey", "version"],  # part of the names of files
)
def test_what_is_wrong_in_the_address_of_a_page_is_said(
    system: RunningSystem, window: Callable[..., Page], address: str, problem: str
) -> None:
    page = window(f"{system.url}{address}")
    banner = page.get_by_role("alert").filter(has_text="The address of this page has a mistake")
    expect(banner).to_contain_text(problem)
    assert fits(page)
    expect(banner.get_by_role("link", name="Open the page without parameters")).to_have_attribute("href", address.partition("?")[0])


@pytest.mark.parametrize(
    ("address", "problems"),
    [
        ("/map?object=Robt1", ["There is no object Robt1 on the map; did you mean Robot1 or Robot2?"]),
        ("/map?object=Nope", ["There is no object Nope on the map", "find one by its name"]),
        ("/map?view=5d", ["There is no view 5d; the views are plan and 3d."]),
        ("/map?objekt=Jar002", ["This page has no parameter “objekt”; it takes object, storey, view, version."]),
        ("/ontology?new=thing", ["There is no kind of definition thing; the kinds are types, "]),
        ("/ontology?typ=Jar", ["This page has no parameter “typ”"]),
        ("/history?outcome=won", ["There is no outcome won; the outcomes are accomplished, failed, cancelled."]),
        ("/history?since=yesterday", ["'yesterday' is not a time"]),
        ("/history?rows=many", ["rows=many: give a number of tasks from 1 to 50."]),
        ("/define?goal=Jar002%20isOn%20Table001", ["This page has no parameter “goal”; it takes effect."]),
        ("/fleet?robot=Robot1", ["This page has no parameter “robot”; it takes none."]),
    ],
    ids=lambda value: re.sub(r"\W+", " ", value).strip() if isinstance(value, str) else "",
)
def test_each_mistake_in_an_address_is_named(system: RunningSystem, address: str, problems: list[str]) -> None:
    """The server writes this into the page, so no browser has to draw it once more."""
    with urllib.request.urlopen(f"{system.url}{address}") as answer:
        served_page = answer.read().decode()
    for problem in problems:
        assert problem in served_page


def test_what_is_wrong_in_the_address_is_left_behind_by_the_link(system: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(f"{system.url}/map?objekt=Jar002")
    banner = page.get_by_role("alert").filter(has_text="The address of this page has a mistake")
    banner.get_by_role("link", name="Open the page without parameters").click()
    page.wait_for_url(f"{system.url}/map")
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    expect(banner).to_be_hidden()


def test_an_address_without_a_page_says_so_and_what_was_meant(system: RunningSystem, browser: Browser) -> None:
    """Not in a `window`, in which the status 404 would be an error."""
    with browser.new_context() as profile:
        sign_in(profile, system.url)
        page = profile.new_page()
        answer = page.goto(f"{system.url}/flet")
        assert answer is not None
        assert answer.status == 404
        expect(page.get_by_role("heading", level=1)).to_have_text("There is no page /flet")
        expect(page.get_by_role("status").filter(has_text="Did you mean /fleet?")).to_be_visible()
        page.get_by_role("navigation").get_by_role("link", name="Fleet").click()
        page.wait_for_url("**/fleet")
        assert page.request.get(f"{system.url}/look/none.css").text() == "Not Found"


def test_the_address_of_the_map_has_the_version_that_is_shown(system: RunningSystem, window: Callable[..., Page]) -> None:
    update = {"situation": 'Table002.Label = "Here"', "author": "test"}
    request = urllib.request.Request(f"{system.url}/api/map/changes", json.dumps(update).encode(), {"Content-Type": "application/json"})
    with urllib.request.urlopen(request):
        pass
    page = window(f"{system.url}/map?version=0&object=Jar002")
    expect(page.get_by_role("status").filter(has_text="Version 0: the initial map")).to_be_visible()
    expect(page.get_by_text("As it was at version 0")).to_be_visible()
    page.get_by_role("button", name="Back to now").click()
    page.wait_for_url("**/map?object=Jar002")
    page.get_by_role("button", name="One version back").click()
    page.wait_for_url(re.compile(r"/map\?version=\d+&object=Jar002$"))


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
