"""The History page: tasks that are over, found and exported."""

from __future__ import annotations

import csv
import io
import json
import re
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from .conftest import PATIENCE, RunningSystem, every_look, fits, take_screenshot
from .test_fleet import state_task

OpenPage = Callable[..., Page]

FAILS = "Carton001 isOn Jar002"
"""Nothing can be put on a jar."""


def end_of(system: RunningSystem, effect: str) -> str:
    """Have a task end that needs no robot; its id."""
    task = state_task(system, effect)
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        with urllib.request.urlopen(f"{system.url}/api/records?limit=20") as answer:
            if any(record["task"] == task for record in json.load(answer)["records"]):
                return task
        time.sleep(0.1)
    raise AssertionError(f"{effect} did not end")


@pytest.fixture(scope="module")
def ended(system: RunningSystem) -> list[str]:
    """Three tasks that are over, the last first."""
    return [end_of(system, effect) for effect in (FAILS, 'Building001.Label = "History" OR Storey001 isPartOf Building001', FAILS)][::-1]


def rows(page: Page) -> list[str]:
    return [row.inner_text() for row in page.locator("tbody tr").all()]


@pytest.mark.looks
def test_tasks_that_are_over_are_listed_with_how_they_ended(system: RunningSystem, window: OpenPage, ended: list[str]) -> None:
    page = window(f"{system.url}/history")
    first = page.locator("tbody tr").first
    expect(first).to_contain_text(FAILS)
    expect(first).to_contain_text("Failed")
    expect(first).to_contain_text("no plan")
    expect(page.locator("tbody tr").nth(1)).to_contain_text("Accomplished")
    for look in every_look(page):
        assert fits(page)
        take_screenshot(page, f"history-{look}")


def test_filters_narrow_the_list_and_are_in_the_address(system: RunningSystem, window: OpenPage, ended: list[str]) -> None:
    page = window(f"{system.url}/history")
    page.get_by_label("Goal contains").fill("building001")
    expect(page.get_by_text(FAILS)).to_have_count(0)
    expect(page.locator("tbody tr")).to_have_count(1)
    page.get_by_label("Outcome", exact=True).click()
    page.get_by_role("option", name="Failed").click()
    expect(page.get_by_text("No ended task matches these filters.")).to_be_visible()
    take_screenshot(page, "history-nothing")
    expect(page).to_have_url(re.compile("text=building001"))
    expect(page).to_have_url(re.compile("outcome=failed"))
    page.reload()
    expect(page.get_by_label("Goal contains")).to_have_value("building001")
    page.get_by_role("button", name="Show all").click()
    expect(page.locator("tbody tr").first).to_contain_text(FAILS)
    page.get_by_label("Device", exact=True).fill("Nobody7")
    page.keyboard.press("Enter")
    expect(page.get_by_text("No ended task matches these filters.")).to_be_visible()


def test_pages_go_on_and_back_without_losing_any(system: RunningSystem, window: OpenPage, ended: list[str]) -> None:
    page = window(f"{system.url}/history?rows=1")
    links = page.locator("tbody a")
    expect(links).to_have_attribute("href", f"/tasks/{ended[0]}")
    expect(page.get_by_role("navigation", name="Pages").get_by_role("status")).to_contain_text("1 to 1 of")
    for task in (*ended[1:],):
        page.get_by_role("button", name="Older").click()
        expect(links).to_have_attribute("href", f"/tasks/{task}")
    expect(page.get_by_role("navigation", name="Pages").get_by_role("status")).to_contain_text("3 to 3 of")
    for task in (ended[1], ended[0]):
        page.get_by_role("button", name="Newer").click()
        expect(links).to_have_attribute("href", f"/tasks/{task}")
    expect(page.get_by_role("button", name="Newer")).to_be_disabled()


def test_a_task_that_ends_meanwhile_appears_and_a_row_opens_it(system: RunningSystem, window: OpenPage, ended: list[str]) -> None:
    page = window(f"{system.url}/history")
    expect(page.locator("tbody a").first).to_have_attribute("href", f"/tasks/{ended[0]}")
    task = end_of(system, FAILS)
    ended.insert(0, task)
    expect(page.locator("tbody a").first).to_have_attribute("href", f"/tasks/{task}")
    page.locator("tbody tr").first.get_by_text("Failed").click()
    page.wait_for_url(f"**/tasks/{task}")


def test_what_is_listed_can_be_exported(system: RunningSystem, window: OpenPage, ended: list[str]) -> None:
    page = window(f"{system.url}/history?outcome=failed")
    expect(page.locator("tbody tr").first).to_be_visible()
    page.get_by_role("button", name="Export").first.click()
    with page.expect_download() as download:
        page.get_by_text("CSV, a row for each task").click()
    text = Path(download.value.path()).read_text("utf-8")
    records = list(csv.DictReader(io.StringIO(text)))
    assert {row["outcome"] for row in records} == {"failed"}
    assert records[0]["task"] == ended[0]
    assert download.value.suggested_filename.endswith(".csv")
