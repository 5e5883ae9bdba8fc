"""The page of a person who does steps of tasks, on a phone: found by link or code, and what happens to the task."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.support.paths import SCENARIO_1

from .conftest import SCHEMES, WORK_TIME, RunningSystem, fits, take_screenshot

OpenPage = Callable[..., Page]
PERSON = "  Anna: {type: Person, at: [6, 4, 0], Label: Anna Kowalska, Price: 1 EUR, Offers: TransferObject}\n"


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """Scenario 1, with a person who is cheaper than the robots."""
    folder = tmp_path_factory.mktemp("people")
    site = folder / "site.yaml"
    text = Path(SCENARIO_1).read_text(encoding="utf-8")
    site.write_text(text.replace("  Entrance:", f"{PERSON}  Entrance:"), encoding="utf-8")
    running = RunningSystem(folder / "data", site)
    try:
        yield running
    finally:
        running.stop()
    assert "Traceback" not in running.log_text(), f"a program of the system raised an error: see {running.log}"


def call(system: RunningSystem, path: str, body: object | None = None) -> Any:
    data = json.dumps(body).encode() if body is not None else None
    with urllib.request.urlopen(urllib.request.Request(f"{system.url}/api{path}", data=data)) as answer:
        content = answer.read()
    return json.loads(content) if content else None


def code(system: RunningSystem) -> str:
    [anna] = call(system, "/people")["people"]
    return str(anna["code"])


def submit(system: RunningSystem, effect: str) -> str:
    return str(call(system, "/tasks", {"effect": effect})["task"])


def assignment(page: Page) -> Locator:
    return page.get_by_role("region", name="Assignment")


def outcome(page: Page, system: RunningSystem, task: str) -> None:
    page.goto(f"{system.url}/tasks/{task}")
    expect(page.get_by_text("Accomplished").first).to_be_visible(timeout=WORK_TIME)


def test_a_person_finds_the_page_by_code_and_does_a_step(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person", "390")
    page.get_by_role("button", name="Open").click()
    expect(page.get_by_role("alert")).to_contain_text("Enter the code first")
    page.get_by_label("Code").last.fill("nobody")
    page.get_by_role("button", name="Open").click()
    expect(page.get_by_role("alert")).to_contain_text("There is no page with the code nobody")
    page.get_by_label("Code").last.fill(code(system).lower())
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Anna Kowalska")).to_be_visible()
    expect(page.get_by_role("status").first).to_contain_text("There is nothing to do")
    take_screenshot(page, "person-390-idle")
    task = submit(system, "Jar002 isOn Table001")
    card = assignment(page)
    expect(card).to_contain_text("Jar002 (red Jar)", timeout=WORK_TIME)
    expect(card).to_contain_text("Jar002 isOn Table001")
    expect(page.get_by_role("region", name="Where")).to_be_visible()
    for scheme in SCHEMES:
        page.emulate_media(color_scheme=scheme)
        assert fits(page)
        take_screenshot(page, f"person-390-{scheme}")
    card.get_by_role("button", name="Accept").click()
    expect(card).to_contain_text("accepted")
    take_screenshot(page, "person-390-accepted")
    card.get_by_role("button", name="Done").click()
    expect(card).to_have_count(0)
    outcome(page, system, task)
    rows = call(system, "/map/query?formula=Jar002%20isOn%20?Where")["rows"]
    assert rows == [{"bindings": {"Where": "Table001"}}]


def test_what_a_person_declines_or_cannot_do_others_do(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person/{code(system)}", "390")
    task = submit(system, "Jar002 isOn Platform001")
    assignment(page).get_by_role("button", name="Decline").click(timeout=WORK_TIME)
    expect(assignment(page)).to_have_count(0)
    outcome(page, system, task)  # a robot has found the jar where the person put it before
    page.goto(f"{system.url}/person/{code(system)}")
    task = submit(system, "Carton001 isOn Table001")
    assignment(page).get_by_role("button", name="Accept").click(timeout=WORK_TIME)
    assignment(page).get_by_role("button", name="I could not").click()
    page.get_by_label("Why not?").fill("I have to leave")
    page.get_by_label("What is so now?").fill("Carton001 isOn Tabel002")
    page.get_by_role("button", name="Send").click()
    expect(page.get_by_text("did you mean Table002")).to_be_visible()
    take_screenshot(page, "person-390-problem")
    page.get_by_label("What is so now?").fill("Carton001 isOn Table002")
    page.get_by_role("button", name="Send").click()
    expect(assignment(page)).to_have_count(0)
    outcome(page, system, task)


def test_who_is_not_available_is_asked_nothing(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person/{code(system)}", "390")
    page.get_by_role("switch", name="Available").click()
    expect(page.get_by_role("status").first).to_contain_text("You are not available")
    outcome(window(f"{system.url}/tasks"), system, submit(system, "Jar003 isOn Table001"))
    page.get_by_role("switch", name="Available").click()
    expect(page.get_by_role("status").first).to_contain_text("There is nothing to do")


def test_the_fleet_page_has_the_link_the_code_and_a_picture_of_them(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/fleet")
    people = page.get_by_role("region", name="People")
    expect(people).to_contain_text("Anna")
    expect(people).to_contain_text(code(system))
    expect(people.get_by_role("link", name="Page of Anna")).to_have_attribute("href", f"{system.url}/person/{code(system)}")
    people.get_by_role("button", name="Code for the phone of Anna").click()
    expect(page.get_by_role("img", name="Code that opens the page of Anna on a phone")).to_be_visible()
    take_screenshot(page, "fleet-people")
