"""The first page as a board: what needs attention, what runs, who is ready, and a task to try, while all this changes."""

from __future__ import annotations

import json
import time
import urllib.request
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from somrs.devices.person.questions import Questions

from .conftest import PATIENCE, WORK_TIME, RunningSystem, every_look, fits, take_screenshot

OpenPage = Callable[..., Page]


def call(system: RunningSystem, method: str, path: str, body: object = None) -> Any:
    content = json.dumps(body).encode() if body is not None else None
    request = urllib.request.Request(f"{system.url}/api{path}", data=content, headers={"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        return json.loads(answer.read() or b"null")


def part(page: Page, title: str) -> Locator:
    return page.get_by_role("region", name=title)


def row(page: Page, title: str, text: str) -> Locator:
    return part(page, title).get_by_role("listitem").filter(has_text=text)


@pytest.mark.looks
def test_an_idle_system_needs_nobody_and_offers_a_task_to_try(system: RunningSystem, window: OpenPage) -> None:
    page = window(system.url)
    expect(page.get_by_text("Nothing needs attention.")).to_be_visible()
    expect(page.get_by_text("No task is running.")).to_be_visible()
    expect(row(page, "Devices", "Robot1, Robot2")).to_contain_text("Ready")
    expect(row(page, "Parts of the system", "Simulator")).to_contain_text("Responds")
    for label in ("Map", "Ontology", "New task", "Tasks", "Fleet", "History"):
        expect(page.get_by_role("main").get_by_role("link", name=label, exact=True)).to_have_count(0)
    for look in every_look(page):
        assert fits(page)
        take_screenshot(page, f"start-{look}")
    example = part(page, "Try a task").get_by_role("link")
    goal = example.inner_text()
    assert call(system, "POST", "/tasks/preview", {"effect": goal})["steps"], "there is a plan for it"
    example.click()
    page.wait_for_url("**/define?effect=*")
    expect(page.get_by_role("textbox", name="Formula")).to_have_value(goal)


def test_tasks_are_followed_and_one_that_failed_stays_until_its_goal_is_accomplished(system: RunningSystem, window: OpenPage) -> None:
    page = window(system.url)
    expect(page.get_by_text("No task is running.")).to_be_visible()
    task = call(system, "POST", "/tasks", {"effect": "Jar003 isOn Table001"})["task"]
    running = row(page, "Running tasks", "Jar003 isOn Table001")
    expect(running.get_by_role("progressbar")).to_be_visible()
    expect(running).to_contain_text("of 1 step")
    expect(row(page, "Devices", "TransferObject: Jar003 and Table001")).to_contain_text("Busy")
    assert (running.get_by_role("link").get_attribute("href") or "").endswith(f"/tasks/{task.rpartition(':')[2]}")
    expect(page.get_by_text("No task is running.")).to_be_visible(timeout=WORK_TIME)

    # It fails at once as nothing can bring it about, and later needs nothing to be done.
    call(system, "POST", "/tasks", {"effect": 'Shelf001.Label = "Here"'})
    failed = row(page, "Needs attention", "Shelf001.Label")
    expect(failed).to_contain_text("Failed")
    take_screenshot(page, "start-failed")
    failed.get_by_role("link").click()
    page.wait_for_url("**/tasks/*")
    page.go_back()
    expect(failed).to_be_visible()
    call(system, "POST", "/map/changes", {"situation": 'Shelf001.Label = "Here"', "author": "test"})
    call(system, "POST", "/tasks", {"effect": 'Shelf001.Label = "Here"'})
    expect(failed).to_have_count(0)
    expect(page.get_by_text("Nothing needs attention.")).to_be_visible()


def test_a_device_that_breaks_and_a_question_are_shown_until_somebody_has_seen_to_them(system: RunningSystem, window: OpenPage) -> None:
    page = window(system.url)
    expect(page.get_by_text("Nothing needs attention.")).to_be_visible()
    call(system, "POST", "/fleet/Robot2/faults/gripper")
    broken = row(page, "Needs attention", "Robot2")
    expect(broken).to_contain_text("Not working")
    expect(broken).to_contain_text("Faults: gripper stuck.")
    expect(row(page, "Devices", "Robot2")).to_contain_text("Not working")
    questions = Questions(system.data)
    number = questions.ask("Person001", "Jar002", "Where is Jar002 now?", 600.0)
    question = part(page, "Needs attention").get_by_role("region", name=f"Question {number}")
    expect(question).to_contain_text("Where is Jar002 now?")
    expect(page.get_by_text("Nothing needs attention.")).to_be_hidden()
    take_screenshot(page, "start-attention")
    call(system, "POST", "/fleet/Robot2/faults/gripper?repair=true")
    expect(broken).to_have_count(0)
    question.get_by_role("button", name="I don't know").click()
    deadline = time.monotonic() + PATIENCE
    while (open_question := questions.read(number)) is None or open_question.answer is None:
        assert time.monotonic() < deadline, "no answer came"
        page.wait_for_timeout(50)
    questions.end(number, "taken")
    questions.close()
    expect(question).to_have_count(0)
    expect(page.get_by_text("Nothing needs attention.")).to_be_visible()


def test_an_outage_and_a_standing_order_that_fails_need_attention(system: RunningSystem, window: OpenPage) -> None:
    page = window(system.url)
    expect(page.get_by_text("Nothing needs attention.")).to_be_visible()
    with system.without_program("scheduler"):
        expect(row(page, "Needs attention", "Scheduler")).to_contain_text("No response")
        expect(row(page, "Parts of the system", "No response")).to_contain_text("Scheduler")
    expect(row(page, "Needs attention", "Scheduler")).to_have_count(0)
    task = {"effect": "Shelf001 isOn Table001"}
    order = call(system, "POST", "/orders", {"name": "Tidy up", "when": {"type": "Once", "at": time.time() + 1}, "task": task})
    failing = row(page, "Needs attention", "Tidy up")
    expect(failing).to_contain_text("Failed")
    call(system, "DELETE", f"/orders/{order['id']}")
    expect(failing).to_have_count(0)
