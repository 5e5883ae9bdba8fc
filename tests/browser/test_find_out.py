"""Questions: asked on New task, answered by a patrol robot, and shown on the task's page. And a plan that has to know something first."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.support.paths import SCENARIO_2

from .conftest import WORK_TIME, RunningSystem, every_look, fits, take_screenshot
from .test_define import change_map, field, write


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[RunningSystem]:
    """Scenario 2, with a patrol robot and a camera. One for each test: a patrol robot that has looked for a thing stays and watches."""
    running = RunningSystem(tmp_path / "data", SCENARIO_2)
    yield running
    running.stop()


def open_define(system: RunningSystem, window: Callable[..., Page]) -> Page:
    page = window(f"{system.url}/define", "1280", webgl=False)
    page.locator("[data-name=Jar003]").first.wait_for(state="attached")
    return page


@pytest.mark.looks
def test_what_is_so_is_asked_and_the_answer_says_who_saw_it(watched: RunningSystem, window: Callable[..., Page]) -> None:
    page = open_define(watched, window)
    write(page, "?It: Jar isOn Cupboard001")
    page.get_by_role("button", name="Find out").click()
    expect(page.get_by_text("Nothing is moved.")).to_be_visible()
    page.get_by_role("button", name="Preview", exact=True).click()
    plan = page.get_by_role("group", name="Plan preview")
    expect(plan.get_by_role("button", name=re.compile("LookAt"))).to_have_count(1)  # one look at the place, not one at each jar
    expect(plan.get_by_text("finds out ?Thing isOn")).to_be_visible()
    take_screenshot(page, "find-out-define-1280-light")
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_url(re.compile("/tasks/"))
    answers = page.get_by_role("group", name="Answers")
    expect(answers.get_by_role("row")).to_have_count(3, timeout=WORK_TIME)
    expect(answers.get_by_role("cell", name="Jar002 isOn Cupboard001")).to_be_visible()
    expect(answers.get_by_role("cell", name="Patrol1")).to_have_count(2)
    for look in every_look(page):
        assert fits(page)
        take_screenshot(page, f"find-out-answers-{look}")


def test_a_plan_that_has_to_know_first_shows_what_it_finds_out_and_what_is_foreseen(
    watched: RunningSystem, window: Callable[..., Page]
) -> None:
    change_map(watched, {"type": "ValueSet", "object": "Jar003", "path": "Unknown", "value": True})
    page = open_define(watched, window)
    write(page, "Jar003 isOn Platform001")
    expect(field(page)).to_have_value("Jar003 isOn Platform001")
    page.get_by_role("button", name="Preview", exact=True).click()
    plan = page.get_by_role("group", name="Plan preview")
    expect(plan.get_by_text("finds out Jar003")).to_be_visible()
    expect(plan.locator(".somrs-node-foreseen")).to_have_count(1)
    plan.get_by_role("button", name=re.compile("RecognizeSituation")).click()
    expect(page.get_by_text("Jar003 isOn Somewhere").first).to_be_visible()
    expect(page.get_by_text("As foreseen;").first).to_be_visible()
    take_screenshot(page, "find-out-plan-1280-light")
