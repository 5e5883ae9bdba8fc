"""The first page, and what all pages have in common."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Callable

from playwright.sync_api import Page, expect

from .conftest import WIDTHS, Running, every_look, fits, resize, shoot

PLACES = ["Map", "Ontology", "New task", "Tasks", "Fleet", "History"]


def test_every_page_is_one_click_away_and_fits_every_window(system: Running, window: Callable[..., Page]) -> None:
    page = window(system.url)
    with urllib.request.urlopen(f"{system.url}/api/map") as answer:
        version = json.load(answer)["version"]
    for said in (f"version {version}", "No task is under way.", "Robot2", "simulator"):
        expect(page.get_by_text(said).first).to_be_visible()
    for look in every_look(page):
        shoot(page, f"start-{look}")
    for place in PLACES:
        page.get_by_role("navigation").get_by_role("link", name=place).click()
        page.wait_for_url("**/" + {"New task": "define"}.get(place, place.lower()))
        assert page.get_by_role("navigation").locator("[aria-current=page]").get_attribute("aria-label") == place
        for size in WIDTHS:
            resize(page, size)
            assert fits(page), f"{place} is wider than the window"


def test_the_api_describes_itself(system: Running, window: Callable[..., Page]) -> None:
    page = window(f"{system.url}/api/")
    page.get_by_text("/map/query").first.wait_for()
    with urllib.request.urlopen(f"{system.url}/api/openapi.json") as answer:
        described = json.load(answer)
    assert described["openapi"].startswith("3.1")
    assert all(one["summary"] for path in described["paths"].values() for one in path.values())
