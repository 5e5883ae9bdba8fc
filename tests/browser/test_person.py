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
from .test_define import call_api, change_map
from .test_tasks import is_ended, wait_for_task

OpenPage = Callable[..., Page]
PERSON = '  Anna: {type: Person, at: [6, 4, 0], Label: Anna Kowalska, Price: 1 EUR, Offers: "TransferObject, LookAt (1 EUR, 1 min)"}\n'


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
    with urllib.request.urlopen(
        urllib.request.Request(f"{system.url}/api{path}", data=data, headers={"Content-Type": "application/json"})
    ) as answer:
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
    """The task's page, once it is over: drawing robots at work takes more time than their work."""
    page.goto("about:blank")
    wait_for_task(system, task, is_ended)
    page.goto(f"{system.url}/tasks/{task}")
    expect(page.get_by_text("Accomplished").first).to_be_visible()


def test_a_person_finds_the_page_by_code_and_does_a_step(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person", "390", webgl=False)
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
    expect(card).to_contain_text("Jar002 (red jar) is on Table001", timeout=WORK_TIME)
    expect(card).to_contain_text("Transfer object")
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
    page = window(f"{system.url}/person/{code(system)}", "390", webgl=False)
    task = submit(system, "Jar002 isOn Platform001")
    assignment(page).get_by_role("button", name="Decline").click(timeout=WORK_TIME)
    expect(assignment(page)).to_have_count(0)
    outcome(page, system, task)  # a robot has found the jar where the person put it before
    page.goto(f"{system.url}/person/{code(system)}")
    task = submit(system, "Carton001 isOn Table001")
    assignment(page).get_by_role("button", name="Accept").click(timeout=WORK_TIME)
    assignment(page).get_by_role("button", name="I could not").click()
    page.get_by_label("Why not?").fill("I have to leave")
    page.get_by_role("button", name="Send").click()
    expect(page.get_by_text("Choose what is so now.")).to_be_visible()
    take_screenshot(page, "person-390-could-not")
    page.get_by_role("radio", name="Something else (a formula)").click()
    page.get_by_role("textbox", name="Formula").fill("Carton001 isOn Tabel002")
    page.get_by_role("button", name="Send").click()
    expect(page.get_by_text("did you mean Table002")).to_be_visible()
    take_screenshot(page, "person-390-problem")
    page.get_by_role("radio", name="It is somewhere else").click()
    choose_place(page, "Carton001", "Table002")
    page.get_by_role("button", name="Send").click()
    expect(assignment(page)).to_have_count(0)
    outcome(page, system, task)


def choose_place(page: Page, thing: str, place: str) -> None:
    picker = page.get_by_role("combobox", name=f"Where is {thing}?")
    picker.fill(place)
    page.get_by_role("option", name=place).first.click()


def test_who_works_on_a_cancelled_task_is_told_to_stop_and_says_what_is_so(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person/{code(system)}", "390", webgl=False)
    task = submit(system, "Jar002 isOn Table002")
    assignment(page).get_by_role("button", name="Accept").click(timeout=WORK_TIME)
    expect(assignment(page)).to_contain_text("accepted")
    call_api(system, "POST", f"/tasks/{task}/cancel", {})
    stopped = assignment(page)
    expect(stopped).to_contain_text("Stop: Transfer object")
    for scheme in SCHEMES:
        page.emulate_media(color_scheme=scheme)
        assert fits(page)
        take_screenshot(page, f"person-390-stop-{scheme}")
    stopped.get_by_role("radio", name="Nothing has changed").click()
    stopped.get_by_role("button", name="Send").click()
    expect(assignment(page)).to_have_count(0)
    page.goto(f"{system.url}/tasks/{task}")
    expect(page.get_by_text("Cancelled").first).to_be_visible(timeout=WORK_TIME)


def test_a_person_who_looks_says_what_is_there(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person/{code(system)}", "390", webgl=False)
    task = str(call(system, "/tasks", {"effect": "?It: Jar isOn Cupboard001", "recognise": True})["task"])
    card = assignment(page)
    card.get_by_role("button", name="Accept").click(timeout=WORK_TIME)
    expect(card).to_contain_text("Nothing so far")
    known = page.get_by_role("combobox", name="Add a thing that you see")
    known.fill("Jar003")
    page.get_by_role("option", name="Jar003").first.click()
    page.get_by_role("combobox", name="Type of a new thing").fill("jar")
    page.get_by_role("option", name="jar", exact=True).first.click()
    page.get_by_role("combobox", name="Colour of a new thing").fill("Brown")
    page.get_by_role("option", name="Brown").first.click()
    page.get_by_role("button", name="Add", exact=True).click()
    expect(card).to_contain_text("new: brown jar")
    assert fits(page)
    take_screenshot(page, "person-390-look")
    card.get_by_role("button", name="Done").click()
    expect(card).to_have_count(0)
    outcome(page, system, task)
    rows = call(system, "/map/query?formula=?It:%20Jar%20isOn%20Cupboard001")["rows"]
    assert {"Jar003"} < {row["bindings"]["It"] for row in rows}, "and the new one has a name of its own"
    assert call(system, "/map/query?formula=?It:%20Jar%20isOn%20Cupboard001%20AND%20?It.Color%20=%20Brown")["rows"]


def test_who_does_not_answer_counts_as_not_available_until_the_page_says_otherwise(system: RunningSystem, window: OpenPage) -> None:
    change_map(system, {"type": "ValueSet", "object": "Anna", "path": "AnswerTime", "value": 1})
    page = window(f"{system.url}/person/{code(system)}", "390", webgl=False)
    page.get_by_role("button", name="Alerts off").click()
    expect(page.get_by_role("button", name="Alerts on")).to_be_visible()
    task = submit(system, "Carton001 isOn Platform001")
    missed = page.get_by_role("region", name="Missed")
    expect(missed).to_contain_text("You did not answer in time", timeout=WORK_TIME)
    take_screenshot(page, "person-390-missed")
    outcome(window("about:blank", webgl=False), system, task)
    change_map(system, {"type": "ValueSet", "object": "Anna", "path": "AnswerTime", "value": 600})
    missed.get_by_role("button", name="I am available again").click()
    expect(missed).to_be_hidden()
    expect(page.get_by_role("status").first).to_contain_text("There is nothing to do")


def test_who_is_not_available_is_asked_nothing(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person/{code(system)}", "390", webgl=False)
    page.get_by_role("switch", name="Available").click()
    expect(page.get_by_role("status").first).to_contain_text("You are not available")
    outcome(window("about:blank", webgl=False), system, submit(system, "Jar003 isOn Table001"))
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


def test_a_switch_goes_back_with_the_reason_if_it_is_refused(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/person/{code(system)}", "390", webgl=False)
    switch = page.get_by_role("switch", name="Available")
    expect(switch).to_be_checked()
    version = call(system, "/map/changes", {"changes": [{"type": "ObjectRemoved", "name": "Anna"}], "author": "a test"})["version"]
    try:
        with system.paused("gui"):
            switch.click()
            expect(switch).not_to_be_checked()
        expect(page.get_by_text("there is no person Anna on the map")).to_be_visible()
        expect(switch).to_be_checked()
        colours = "(button) => [button, button.closest('.q-notification')].map((element) => getComputedStyle(element).color)"
        assert len({*page.get_by_role("button", name="Close").evaluate(colours)}) == 1, "the button is as readable as the reason"
        take_screenshot(page, "person-390-refused")
    finally:
        call(system, f"/map/undo/{version}?author=nobody", {})
