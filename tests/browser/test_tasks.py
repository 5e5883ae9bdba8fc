"""The Tasks pages: the list, and one task as it goes on, fails, recovers, is cancelled, or cannot be done."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from somrs.client.simulator_link import operator_link
from somrs.devices.simulator.link.commands import Fault
from tests.support.paths import SCENARIO_1

from .conftest import HOLDING_NEWS, WIDTHS, WORK_TIME, RunningSystem, every_look, fits, resize, sign_in, take_screenshot

pytestmark = pytest.mark.long

OpenPage = Callable[..., Page]


def call(system: RunningSystem, path: str, body: object = None, *, post: bool = False) -> Any:
    content = json.dumps(body).encode() if body is not None else b"" if post else None
    request = urllib.request.Request(
        f"{system.url}/api{path}", content, {"Content-Type": "application/json"}, method="POST" if post else "GET"
    )
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def submit_task(system: RunningSystem, effect: str, **options: object) -> str:
    return str(call(system, "/tasks", {"effect": effect, **options}, post=True)["task"])


def wait_for_task(system: RunningSystem, task: str, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The task, once it is so."""
    end = time.monotonic() + WORK_TIME / 1000
    while not condition(task_state := call(system, f"/tasks/{task}")):
        assert time.monotonic() < end, f"it did not come to that: {[event['text'] for event in task_state['events']]}"
        time.sleep(0.1)
    return dict(task_state)


def is_ended(task_state: dict[str, Any]) -> bool:
    return task_state["view"]["outcome"] is not None


def carries(task_state: dict[str, Any]) -> bool:
    notes = (event["event"]["note"] for event in task_state["events"] if event["event"]["type"] == "ProgressNoted")
    return any("carries" in note for note in notes)


def run_command(system: RunningSystem, *arguments: str) -> str:
    """The output of `somrs`."""
    line = [sys.executable, "-m", "somrs.cli.main", *arguments, "--data", str(system.data)]
    return subprocess.run(line, capture_output=True, text=True, check=True, env={**os.environ, "COLUMNS": "120"}).stdout


def formula_holds(system: RunningSystem, formula: str) -> bool:
    return bool(call(system, f"/map/query?formula={urllib.request.quote(formula)}")["rows"])  # type: ignore[attr-defined]


def breaks_down(system: RunningSystem, robot: str, carried: float, fault: Fault = Fault.DRIVE) -> None:
    """Have the robot break down once it has carried something so far (metres): then it does so on its way, however busy the machine is."""

    async def schedule_fault() -> None:
        async with operator_link(system.addresses) as operator:
            await operator.schedule(robot, fault, carried=carried)

    with ThreadPoolExecutor(1) as executor:  # Playwright's own event loop runs in this thread
        executor.submit(asyncio.run, schedule_fault()).result()


def panel(page: Page, title: str) -> Locator:
    return page.locator("details").filter(has=page.get_by_role("heading", name=title, exact=True))


def message(page: Page, type: str) -> Locator:
    return panel(page, "Messages").locator(".somrs-msg").filter(has_text=type)


def show_floor_plan(page: Page) -> None:
    """Show the floor plan instead of the scene; that is remembered."""
    page.get_by_role("button", name="Floor plan").click()
    expect(page.locator(".somrs-task-floor")).to_be_visible()  # so the server has heard of it


@pytest.fixture
def jar_at_home(system: RunningSystem) -> Iterator[None]:
    """Afterwards robots are whole, and the jar is where it was."""
    yield
    call(system, "/fleet/Robot1/faults/drive?repair=true", post=True)
    if not formula_holds(system, "Jar002 isOn Cupboard001"):
        wait_for_task(system, submit_task(system, "Jar002 isOn Cupboard001"), is_ended)
        assert formula_holds(system, "Jar002 isOn Cupboard001")


@pytest.mark.looks
@pytest.mark.usefixtures("jar_at_home")
def test_a_task_is_watched_as_its_robot_fails_and_another_takes_over(system: RunningSystem, window: OpenPage, tmp_path: Path) -> None:
    breaks_down(system, "Robot1", carried=1.5)
    listed = window(f"{system.url}/tasks")
    task = submit_task(system, "Jar002 isOn Platform001", deadline=600, priority=3)
    row = listed.get_by_role("row").filter(has=listed.locator(f'a[href$="{task.rpartition(":")[2]}"]'))
    wait_for_task(system, task, lambda task_state: bool(task_state["view"]["work"]))
    with system.paused("simulator"):  # the robot stays on its way until everything about it has been seen
        expect(row).to_contain_text("of 1 step")
        expect(row).to_contain_text("Urgent (3)")
        page = window(f"{system.url}/tasks", webgl=False)
        page.get_by_role("link", name="Jar002 isOn Platform001").first.focus()
        page.keyboard.press("Enter")
        expect(page.get_by_role("heading", name="Jar002 isOn Platform001")).to_be_visible()
        expect(page.locator("header").filter(has_text="Jar002 isOn Platform001")).to_contain_text("Urgent (3)")
        expect(panel(page, "Plan").get_by_role("button", name="TransferObject, step1, Jar002, Platform001")).to_be_visible()
        take_screenshot(page, "task-under-way-1280-light")

        head = page.locator("header").filter(has_text="Jar002 isOn Platform001")
        expect(head).to_contain_text(re.compile(r"Remaining time\s*about \d"))
        expect(head).to_contain_text(re.compile(r"Cost\s*nothing so far, 10 EUR contracted"))
        show_floor_plan(page)

    story = panel(page, "Story")
    expect(story).to_contain_text("Failure 1: Robot1.TransferObject", timeout=WORK_TIME)
    expect(story).to_contain_text("the drive of Robot1 is dead")
    expect(story).to_contain_text("Resulting situation: Jar002")
    expect(story).to_contain_text("Replacement")
    expect(story).to_contain_text("Robot2.TransferObject completed the step: Jar002 isOn Platform001", timeout=WORK_TIME)
    expect(message(page, "Failed")).to_have_count(1)
    expect(message(page, "Arrange")).to_have_count(3)
    expect(page.locator("header").filter(has_text="Jar002 isOn Platform001")).to_contain_text("Accomplished")
    expect(head).to_contain_text(re.compile(r"Cost\s*25 EUR"))  # the robot that failed is not paid
    assert re.search(r"cost\s+25 EUR", run_command(system, "task", task))
    expect(panel(page, "Timeline")).to_contain_text("Robot2")
    expect(panel(page, "Plan").get_by_role("button", name="TransferObject, step1, Jar002, Platform001, done")).to_be_visible()

    terms = panel(page, "Terms")
    for words in ("10 EUR", "25 EUR", "Chosen, failed", "Chosen, done", "another service was chosen by price"):
        expect(terms).to_contain_text(words)
    assert [contract["state"] for contract in call(system, f"/tasks/{task}")["contracts"]] == ["Failed", "Ended", "Completed"]
    _read_a_message(page)
    _export(page, tmp_path)
    _every_size(page, "task")
    page.get_by_role("link", name="Back to all tasks").click()
    expect(page.get_by_role("heading", name="Tasks", exact=True)).to_be_visible()
    expect(row).to_contain_text("Accomplished")
    expect(row).to_contain_text("1 setback")


def _read_a_message(page: Page) -> None:
    """By mouse and by keyboard."""
    chart = panel(page, "Messages")
    message(page, "Failed").click()
    body = chart.get_by_role("region", name="The message")
    expect(body).to_contain_text("Robot1.TransferObject → Task Manager")
    expect(body).to_contain_text("the drive of Robot1 is dead")
    chart.get_by_role("listbox").focus()
    page.keyboard.press("ArrowDown")
    expect(body).to_contain_text("Task Manager → Robot2.TransferObject")
    expect(body).to_contain_text("Jar002.PositionX")
    page.keyboard.press("Escape")
    expect(body).to_have_count(0)
    message_count = message(page, "Progress").count()
    chart.get_by_label("All heartbeats").check()
    assert message(page, "Progress").count() > message_count


def _export(page: Page, folder: Path) -> None:
    for way, begins, content in (("SVG", "<svg", "Robot2.TransferObject"), ("JSON", "{", '"explanation"')):
        page.get_by_role("button", name="Export").click()
        with page.expect_download() as download:
            page.get_by_role("menuitem", name=way).click()
        download.value.save_as(folder / way)
        text = (folder / way).read_text()
        assert text.startswith(begins)
        assert content in text
        page.keyboard.press("Escape")


def _every_size(page: Page, name: str) -> None:
    for look in every_look(page):
        page.evaluate("window.scrollTo(0, 0)")
        page.wait_for_timeout(400)
        assert fits(page), f"wider than {look}"
        take_screenshot(page, f"{name}-{look}")


@pytest.mark.usefixtures("jar_at_home")
def test_a_task_is_cancelled_and_undone(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/tasks/{submit_task(system, 'Shelf001 isOn Platform001')}", webgl=False)
    show_floor_plan(page)
    goal = "Jar003 isOn Shelf001 AND Carton001 isOn Shelf001"
    task = submit_task(system, goal)  # by the cheaper robot, one after the other: time enough to change one's mind
    page.goto(f"{system.url}/tasks/{task}")
    expect(page.get_by_role("button", name="Floor plan")).to_have_attribute("aria-pressed", "true")  # what was chosen stays
    first = wait_for_task(system, task, lambda task_state: bool(task_state["view"]["work"]))["view"]["work"][0]
    page.get_by_role("button", name="Cancel this task").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("Robot1.TransferObject is stopped (step")
    expect(dialog).to_contain_text(f"is undone: {first['before']} holds again.")
    dialog.get_by_label("Reason").fill("the shelf is full")
    take_screenshot(page, "task-cancel-1280-light")
    wait_for_task(system, task, carries)
    dialog.get_by_role("button", name="Cancel the task").click()
    story = panel(page, "Story")
    expect(story).to_contain_text("Compensation", timeout=WORK_TIME)
    expect(page.locator("header").filter(has_text=goal)).to_contain_text("Cancelled", timeout=WORK_TIME)
    expect(page.get_by_role("status").filter(has_text="The shelf is full")).to_be_visible()
    expect(panel(page, "Plan").get_by_role("button", name="undone").first).to_be_visible()
    expect(page.get_by_role("button", name="Cancel this task")).to_be_hidden()
    assert formula_holds(system, "Jar003 isOn Cupboard001 AND Carton001 isOn Table002")


@pytest.mark.usefixtures("jar_at_home")
def test_a_task_that_waits_names_the_other_task_and_links_to_it(system: RunningSystem, window: OpenPage) -> None:
    goal = "Jar003 isOn Shelf001 AND Carton001 isOn Shelf001"
    first = submit_task(system, goal)  # by the cheaper robot: what it has brought first stays reserved until the task ends
    key = first.rpartition(":")[2]

    def completed_work(task_state: dict[str, Any]) -> list[dict[str, Any]]:
        return [work for work in task_state["view"]["work"] if work["result"] == "Completed"]

    thing = completed_work(wait_for_task(system, first, lambda task_state: bool(completed_work(task_state))))[0]["inputs"]["Object"]
    with system.paused("simulator"):
        second = submit_task(system, f"{thing} isOn Platform001")
        wait_for_task(system, second, lambda task_state: task_state["view"]["phase"] == "waiting")
        page = window(f"{system.url}/tasks/{second}", webgl=False)
        show_floor_plan(page)
        for place in (page.locator("header").filter(has_text=f"{thing} isOn Platform001"), panel(page, "Story")):
            expect(place).to_contain_text(f"Waits for {goal}, which has reserved {thing}")
            expect(place).not_to_contain_text("urn:uuid")
        printed = " ".join(run_command(system, "task", second).split())
        assert f"waiting for task {key[:8]} ({goal}), which has reserved {thing}" in printed
        for size in ("1280", "390"):
            resize(page, size)
            assert fits(page)
            take_screenshot(page, f"task-waiting-{size}-light")
        page.goto(f"{system.url}/tasks")
        row = page.get_by_role("row").filter(has=page.locator(f'a[href$="{second.rpartition(":")[2]}"]'))
        expect(row).to_contain_text(f"which has reserved {thing}")
        for size in ("390", "1280"):
            resize(page, size)
            take_screenshot(page, f"tasks-waiting-{size}-light")
        row.locator(".somrs-task-goal").click(position={"x": 5, "y": 5})  # the rest of the cell leads to the task itself
        page.wait_for_url(f"**/tasks/{second.rpartition(':')[2]}")
        page.go_back()
        row.get_by_role("link", name=goal).click()
        page.wait_for_url(f"**/tasks/{key}")
        page.goto(f"{system.url}/define?effect={thing} isOn Table001")
        page.get_by_role("button", name="Preview").click()
        waits = page.locator(".somrs-waits").filter(has_text="The task would wait for")
        expect(waits).to_contain_text([f"{goal}, which has reserved", f"{thing} isOn Platform001, which waits for {thing} too"])
        expect(page.get_by_role("link", name=goal)).to_have_attribute("href", f"/tasks/{key}")
        take_screenshot(page, "define-waiting-1280-light")
    for task in (second, first):
        call(system, f"/tasks/{task}/cancel", post=True)
        wait_for_task(system, task, is_ended)


@pytest.mark.usefixtures("jar_at_home")
def test_a_task_waits_for_robots_to_be_mended_and_is_retried(system: RunningSystem, window: OpenPage) -> None:
    goal = "Jar002 isOn Platform001"
    for robot in ("Robot1", "Robot2"):
        call(system, f"/fleet/{robot}/faults/gripper", post=True)
    task = submit_task(system, goal)
    try:
        wait_for_task(system, task, lambda task_state: task_state["view"]["phase"] == "waiting")
        page = window(f"{system.url}/tasks/{task}", webgl=False)
        head = page.locator("header").filter(has_text=goal)
        for robot in ("Robot1", "Robot2"):
            expect(head).to_contain_text(f"{robot}.TransferObject: {robot} is out of order: its gripper is stuck.")
        expect(head).to_contain_text("next attempt at")
        for size in ("390", "1280"):
            resize(page, size)
            assert fits(page)
            take_screenshot(page, f"task-waits-to-retry-{size}-light")
    finally:
        for robot in ("Robot1", "Robot2"):
            call(system, f"/fleet/{robot}/faults/gripper?repair=true", post=True)
    wait_for_task(system, task, is_ended)
    expect(head).to_contain_text("Accomplished", timeout=WORK_TIME)
    page.get_by_role("button", name="Retry this task").click()
    page.wait_for_url(lambda url: task.rpartition(":")[2] not in url)
    expect(page.locator("header").filter(has_text=goal)).to_contain_text(f"task {task.rpartition(':')[2][:8]}")
    take_screenshot(page, "task-retried-1280-light")
    page.goto(f"{system.url}/tasks")
    resize(page, "1280")
    retry = page.get_by_role("button", name=f"Retry {goal}").first
    take_screenshot(page, "tasks-retry-1280-light")
    retry.click()
    page.wait_for_url(lambda url: url.rstrip("/").rpartition("/")[2] not in ("tasks", task.rpartition(":")[2]))


def test_what_cannot_be_done_says_why_not(system: RunningSystem, window: OpenPage) -> None:
    task = submit_task(system, "Shelf001 isOn Platform001")
    page = window(f"{system.url}/tasks/{task.rpartition(':')[2][:8]}", dark=True)
    expect(page.get_by_role("status").filter(has_text="No plan")).to_contain_text("no service type brings it about")
    expect(panel(page, "Terms")).to_contain_text("No service was asked")
    take_screenshot(page, "task-impossible-1280-dark")
    page.goto(f"{system.url}/tasks/12345678")
    expect(page.get_by_role("status")).to_contain_text("There is no task 12345678")


def test_an_address_that_several_tasks_fit_says_so(system: RunningSystem, window: OpenPage) -> None:
    first_characters: set[str] = set()
    while (key := submit_task(system, "Shelf001 isOn Platform001").rpartition(":")[2])[0] not in first_characters:
        first_characters.add(key[0])
    page = window(f"{system.url}/tasks/{key[0]}")
    expect(page.get_by_role("status")).to_contain_text(f"tasks or more begin with {key[0]}; give more of the id")
    expect(page.get_by_role("status")).not_to_contain_text("retrying")
    page.get_by_role("link", name="All tasks").click()
    page.wait_for_url("**/tasks")


@pytest.mark.looks
def test_the_list_is_found_in_and_folded_panels_stay_so(system: RunningSystem, window: OpenPage) -> None:
    task = submit_task(system, "Shelf001 isOn Table002")
    wait_for_task(system, task, is_ended)
    page = window(f"{system.url}/tasks", "1920", webgl=False)
    page.get_by_role("button", name="Failed").click()
    page.get_by_label("Find").fill("shelf001 table002")
    expect(page.get_by_role("link", name="Shelf001 isOn Table002").first).to_be_visible()
    expect(page.get_by_role("link", name="Shelf001 isOn Platform001")).to_have_count(0)
    page.get_by_label("Find").fill("nothing of that kind")
    expect(page.get_by_text("No matching tasks.")).to_be_visible()
    page.get_by_label("Find").fill("")
    page.get_by_role("button", name=re.compile("^All")).click()
    expect(page.get_by_role("link", name="Shelf001 isOn Table002").first).to_be_visible()
    _every_size(page, "tasks")
    page.goto(f"{system.url}/tasks/{task}")
    end = time.monotonic() + WORK_TIME / 1000
    while panel(page, "Plan").get_attribute("open") is not None:
        assert time.monotonic() < end, "what is folded is there unfolded again"
        panel(page, "Plan").locator("summary").focus()
        page.keyboard.press("Enter")
        expect(panel(page, "Plan")).not_to_have_attribute("open", "")
        page.wait_for_timeout(300)  # the server is told meanwhile; if that takes longer, once more
        page.reload()


@pytest.mark.usefixtures("jar_at_home")
def test_the_page_comes_back_when_parts_of_the_system_are_started_again(system: RunningSystem, browser: Browser) -> None:
    task = submit_task(system, "Jar002 isOn Table001")
    context = browser.new_context()  # whose console may tell of what did not answer for a while
    sign_in(context, system.url)
    page = context.new_page()
    page.goto(f"{system.url}/tasks/{task}")
    show_floor_plan(page)
    wait_for_task(system, task, carries)
    system.kill_and_await("task-manager", "gui", while_paused="simulator")  # on the robot's way
    story = panel(page, "Story")
    expect(story).to_contain_text("step1 is done", timeout=WORK_TIME)
    expect(page.locator("header").filter(has_text="Jar002 isOn Table001")).to_contain_text("Accomplished", timeout=WORK_TIME)
    expect(message(page, "Completed")).to_have_count(1)
    context.close()


@pytest.fixture
def with_two_managers(tmp_path: Path) -> Iterator[RunningSystem]:
    running = RunningSystem(tmp_path / "data", options=("--task-managers", "2"))
    yield running
    running.stop()


def test_tasks_of_two_task_managers_are_one_list_and_one_that_does_not_answer_is_named(
    with_two_managers: RunningSystem, window: OpenPage
) -> None:
    page = window(f"{with_two_managers.url}/tasks", webgl=False)
    tasks = [submit_task(with_two_managers, f"{jar} isOn Platform001", priority=2) for jar in ("Jar002", "Jar003")]
    owners = {row["task_manager"]: row["effect"] for row in call(with_two_managers, "/tasks")["rows"]}
    assert {*owners} == {"TaskManager1", "TaskManager2"}
    rows = {name: page.get_by_role("row").filter(has_text=effect) for name, effect in owners.items()}
    for name, row in rows.items():
        expect(row).to_contain_text(name)
    with with_two_managers.paused("task-manager .*--number 2"):
        page.reload()
        expect(page.get_by_text("TaskManager2 does not answer")).to_be_visible()
        expect(rows["TaskManager1"]).to_be_visible()
        expect(rows["TaskManager2"]).to_have_count(0)
        for size in ("1280", "390"):
            resize(page, size)
            take_screenshot(page, f"tasks-two-managers-{size}")
            assert fits(page)
    expect(rows["TaskManager2"]).to_be_visible()
    expect(page.get_by_text("does not answer")).to_be_hidden()
    take_screenshot(page, "tasks-two-managers-both")
    for task in tasks:
        wait_for_task(with_two_managers, task, is_ended)
    rows["TaskManager2"].get_by_role("link", name=owners["TaskManager2"]).click()
    expect(page.locator("header").filter(has_text=owners["TaskManager2"])).to_contain_text("TaskManager2")
    page.goto(f"{with_two_managers.url}/history")
    for name, row in rows.items():
        expect(row).to_contain_text(name)


@pytest.fixture
def with_anna(tmp_path: Path) -> Iterator[RunningSystem]:
    """The scenario with somebody who can be asked where things are."""
    robots = "  Robot2:"
    site_head, _, site_tail = SCENARIO_1.read_text(encoding="utf-8").partition(robots)
    site = tmp_path / "site.yaml"
    site.write_text(f"{site_head}  Anna: {{type: Person, at: [5.5, 1, 0]}}\n{robots}{site_tail}", encoding="utf-8")
    running = RunningSystem(tmp_path / "data", site)
    yield running
    running.stop()


def test_a_question_of_a_task_is_answered_on_its_page(with_anna: RunningSystem, window: OpenPage) -> None:
    page = window(f"{with_anna.url}/tasks", webgl=False)
    expect(page.get_by_role("region", name="Question")).to_have_count(0)
    breaks_down(with_anna, "Robot1", carried=1.0, fault=Fault.SILENT)
    task = submit_task(with_anna, "Jar002 isOn Platform001")
    page.goto(f"{with_anna.url}/tasks/{task}")
    question = page.get_by_role("region", name="Question 1")
    expect(question).to_contain_text("Anna is asked", timeout=WORK_TIME)
    expect(question).to_contain_text("Where is Jar002")
    head = page.locator("header").filter(has_text="Jar002 isOn Platform001")
    expect(head).to_contain_text(re.compile(r"Remaining time\s*(about \d|not known yet)"))
    printed = run_command(with_anna, "tasks")  # until the answer, the task cannot end
    assert re.search(r"remaining (about \d|not known yet)", printed)
    assert "cost nothing so far" in printed
    for size in ("1280", "820"):
        page.set_viewport_size({"width": WIDTHS[size][0], "height": WIDTHS[size][1]})
        page.wait_for_timeout(300)
        take_screenshot(page, f"task-question-{size}")
        assert fits(page)
    answer = question.get_by_label("Situation")
    answer.fill("Jar002 isOn Platfrom001")
    answer.press("Enter")
    expect(page.get_by_text("did you mean Platform001")).to_be_visible()
    expect(answer).to_have_value("Jar002 isOn Platfrom001")
    answer.fill("Jar002 isOn Platform001")  # Anna took it there herself
    question.get_by_role("button", name="Answer").click()
    expect(question).to_have_count(0)
    expect(page.get_by_text("Answer sent.")).to_be_visible()
    expect(page.locator("header").filter(has_text="Jar002 isOn Platform001")).to_contain_text("Accomplished", timeout=WORK_TIME)
    expect(panel(page, "Story")).to_contain_text("Anna")
    assert formula_holds(with_anna, "Jar002 isOn Platform001")


def robot_pose(system: RunningSystem, robot: str) -> tuple[float, float]:
    view = next(device for device in call(system, "/fleet")["devices"] if device["name"] == robot)
    return view["simulated"]["x"], view["simulated"]["y"]


@pytest.mark.usefixtures("jar_at_home")
def test_a_task_is_paused_its_robot_stands_still_and_goes_on(system: RunningSystem, window: OpenPage) -> None:
    task = submit_task(system, "Jar002 isOn Table001")
    state = wait_for_task(system, task, lambda state: any(work["state"] == "Executing" for work in state["view"]["work"]))
    robot = state["view"]["work"][-1]["service"].partition(".")[0]
    page = window("about:blank", webgl=False)
    page.add_init_script(f"{{{HOLDING_NEWS}}}")
    with system.paused("simulator"):  # the robot stays on its way
        page.goto(f"{system.url}/tasks/{task}")
        page.get_by_role("button", name="Pause").wait_for()
        page.evaluate("holdNews()")
        page.get_by_role("button", name="Pause").click()
        wait_for_task(system, task, lambda state: state["view"]["pause"] is not None)
        page.get_by_role("button", name="Pause").click()  # once more, as nothing seems to happen
        page.evaluate("releaseNews()")
        expect(page.get_by_text(re.compile("^Paused by .*; its devices stand still"))).to_be_visible()
    while next(device for device in call(system, "/fleet")["devices"] if device["name"] == robot)["paused_for"] != task:
        time.sleep(0.1)
    time.sleep(1.0)
    there = robot_pose(system, robot)
    time.sleep(2.0)
    assert robot_pose(system, robot) == there
    assert fits(page)
    take_screenshot(page, "task-paused")
    resize(page, "390")
    assert fits(page)
    take_screenshot(page, "task-paused-390")
    page.get_by_role("button", name="Go on").click()
    assert wait_for_task(system, task, is_ended)["view"]["outcome"] == "accomplished"
