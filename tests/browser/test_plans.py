"""The preview shows several plans for a task side by side, with what services quote for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.support.paths import SCENARIO_1

from .conftest import RunningSystem, fits, resize, take_screenshot

OpenPage = Callable[..., Page]
SERVICES = """\
services:
  HandOver:
    inputs: {Object: Graspable, Destination: Support}
    precondition: "?Object isOn ?Source"
    effect: "?Object isOn ?Destination"
map: Scenario1
"""
MOST_PREVIEWS = 10
"""Each allows services more time than the one before, if they were late."""
PERSON = "  Anna: {type: Person, at: [6, 4, 0], Price: 15 EUR, Offers: HandOver}\n"


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """Scenario 1, with a person who hands things over."""
    folder = tmp_path_factory.mktemp("plans")
    site = folder / "site.yaml"
    text = Path(SCENARIO_1).read_text(encoding="utf-8")
    site.write_text(text.replace("map: Scenario1\n", SERVICES).replace("  Entrance:", f"{PERSON}  Entrance:"), encoding="utf-8")
    running = RunningSystem(folder / "data", site)
    try:
        yield running
    finally:
        running.stop()
    assert "Traceback" not in running.log_text(), f"a program of the system raised an error: see {running.log}"


def preview(page: Page) -> Locator:
    """Request a preview, and again as long as services answer too late for it: the machine may be busy. Its comparison of plans."""
    plans = page.get_by_role("group", name="Plans that were compared")
    for _ in range(MOST_PREVIEWS):
        page.get_by_role("button", name="Preview").first.click()
        expect(page.get_by_role("group", name="Terms by step")).to_be_visible()
        if page.get_by_text("has not answered yet").or_(page.get_by_text("Not every step has terms")).count() == 0:
            break
        page.reload()
    return plans


def test_plans_are_shown_side_by_side(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/define?effect=Jar002+isOn+Platform001")
    plans = preview(page)
    expect(plans.get_by_role("row")).to_contain_text(["Steps", "Robot1.TransferObject", "Anna.HandOver"])
    expect(plans.get_by_role("row", name="Robot1.TransferObject")).to_contain_text("Chosen")
    expect(plans.get_by_role("row", name="Anna.HandOver")).to_contain_text("15 EUR")
    for size in ("1280", "390"):
        resize(page, size)
        plans.scroll_into_view_if_needed()
        assert fits(page)
        take_screenshot(page, f"plans-compared-{size}")
