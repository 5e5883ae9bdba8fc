"""The Fleet page: devices as they come, work, break and go; questions to people."""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from somrs.devices.person.questions import Questions
from somrs.ontology.services import ServiceType
from somrs.protocol.messages.directory import Offer, Publish, Published, Retract, Retracted
from tests.support.device_client import device_client

from .conftest import PATIENCE, WORK_TIME, RunningSystem, every_look, fits, resize, take_screenshot, wait_until_still

OpenPage = Callable[..., Page]


def device(page: Page, name: str) -> Locator:
    return page.get_by_role("article", name=name)


def transfer(card: Locator) -> Locator:
    """The line of the service TransferObject."""
    return card.get_by_role("listitem").filter(has_text="TransferObject")


def fleet(system: RunningSystem) -> dict[str, dict[str, Any]]:
    """The devices by name, as the API has them."""
    with urllib.request.urlopen(f"{system.url}/api/fleet") as answer:
        return {entry["name"]: entry for entry in json.load(answer)["devices"]}


def state_task(system: RunningSystem, effect: str) -> str:
    request = urllib.request.Request(
        f"{system.url}/api/tasks", json.dumps({"effect": effect}).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request) as answer:
        return str(json.load(answer)["task"])


def ask_registry(system: RunningSystem, body: Publish | Retract, expected: type[Any]) -> None:
    async def send_request() -> None:
        async with device_client(system.addresses, body.provider) as client:
            await client.ask(system.addresses.registry, body, expected)

    with ThreadPoolExecutor(1) as executor:  # Playwright's own event loop runs in this thread
        executor.submit(asyncio.run, send_request()).result()


@pytest.mark.looks
def test_every_device_is_there_with_what_it_offers(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/fleet")
    for name, price in (("Robot1", "10 EUR"), ("Robot2", "25 EUR")):
        card = device(page, name)
        expect(card).to_contain_text("PioneerP3DX")
        expect(transfer(card)).to_contain_text(price)
        expect(card.get_by_role("progressbar", name="Battery")).to_have_attribute("aria-valuenow", "100")
    expect(page.get_by_role("status").first).to_contain_text("2 on offer")
    for look in every_look(page):
        assert fits(page)
        take_screenshot(page, f"fleet-{look}")


def test_the_command_line_shows_the_same(system: RunningSystem) -> None:
    line = [sys.executable, "-m", "somrs.cli.main", "fleet", "--data", str(system.data)]
    output = subprocess.run(line, capture_output=True, text=True, check=True, env={**os.environ, "COLUMNS": "120"}).stdout
    for words in ("Robot1", "Robot2", "ready", "utilisation", "battery 100 %", "TransferObject, 25 EUR"):
        assert words in output
    listing = json.loads(subprocess.run([*line, "--json"], capture_output=True, text=True, check=True).stdout)
    assert [entry["name"] for entry in listing["devices"]] == sorted(fleet(system))


def test_a_page_comes_although_the_system_is_busy(system: RunningSystem) -> None:
    """For longer than NiceGUI's own limit of 3 s."""
    with ThreadPoolExecutor(1) as executor:
        with system.paused("api"):
            opening = executor.submit(urllib.request.urlopen, f"{system.url}/fleet")
            wait([opening], timeout=4)
        with opening.result() as answer:
            assert b"Fleet" in answer.read()


def test_a_robot_at_work_shows_its_step_and_then_what_it_has_done(system: RunningSystem, window: OpenPage) -> None:
    """Whatever the other tests had it do: one more is done."""
    completed_before = {
        name: service["tally"]["completed"]
        for name, entry in fleet(system).items()
        for service in entry["services"]
        if service["type"] == "TransferObject"
    }
    page = window(f"{system.url}/fleet")
    expect(device(page, "Robot1")).to_be_visible()
    task = state_task(system, "Jar003 isOn Table001")
    busy = page.get_by_role("article").filter(has_text="Jar003 isOn Table001").filter(has=page.get_by_text("Busy", exact=True))
    link = busy.get_by_role("link", name=re.compile("TransferObject: Jar003 and Table001"))
    # All at one moment, as it does not last.
    name, task_url = link.evaluate("(link) => [link.closest('[aria-label]').ariaLabel, link.href]", timeout=WORK_TIME)
    assert task_url.endswith(f"/tasks/{task}")
    take_screenshot(page, "fleet-at-work")
    completed_count = completed_before[name] + 1
    expect(transfer(device(page, name))).to_contain_text(f"{completed_count} of ", timeout=WORK_TIME)
    if completed_count < 5:
        expect(transfer(device(page, name))).not_to_contain_text("%")
    expect(device(page, name).get_by_text("Busy", exact=True)).to_have_count(0)
    expect(device(page, name).get_by_text("Utilisation", exact=True)).to_be_visible()
    assert fleet(system)[name]["load"] > 0


def test_everything_is_stopped_on_one_page_and_released_on_another(system: RunningSystem, window: OpenPage) -> None:
    fleet_page, tasks_page = window(f"{system.url}/fleet"), window(f"{system.url}/tasks", "390", dark=True)
    fleet_page.get_by_role("button", name="Stop all devices").click()
    expect(device(fleet_page, "Robot1").get_by_text("Stopped", exact=True)).to_be_visible()
    take_screenshot(fleet_page, "fleet-stopped")
    release = tasks_page.get_by_role("button", name=re.compile("Release"))
    expect(release).to_be_visible()
    assert fits(tasks_page)
    take_screenshot(tasks_page, "tasks-stopped-390")
    release.click()
    expect(device(fleet_page, "Robot1").get_by_text("Stopped", exact=True)).to_have_count(0)
    expect(release).to_be_hidden()


def test_a_fire_is_stated_on_one_page_seen_on_another_and_ended_there(system: RunningSystem, window: OpenPage) -> None:
    fleet_page, tasks_page = window(f"{system.url}/fleet"), window(f"{system.url}/tasks", "390", dark=True)
    fleet_page.get_by_role("button", name="Fire, emergency, out of order").click()
    fleet_page.get_by_role("menuitem", name="Fire alarm in Building001").click()
    fleet_page.get_by_role("alertdialog").get_by_role("button", name="Fire alarm").click()
    expect(fleet_page.get_by_text("Fire alarm in Building001: all robots stand still")).to_be_visible()
    take_screenshot(fleet_page, "fleet-fire")
    normal = tasks_page.get_by_role("button", name="Building001 back to normal")
    expect(normal).to_be_visible()
    assert fits(tasks_page)
    take_screenshot(tasks_page, "tasks-fire-390")
    normal.click()
    tasks_page.get_by_role("alertdialog").get_by_role("button", name="Back to normal").click()
    expect(fleet_page.get_by_text("Fire alarm in Building001")).to_be_hidden()


def test_a_door_is_out_of_order_until_it_is_back_to_normal(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/map")
    page.get_by_role("button", name="Fire, emergency, out of order").click()
    page.get_by_role("menuitem", name="A lift or a door is out of order").click()
    page.get_by_role("dialog", name="What is out of order").get_by_role("combobox").click()
    page.get_by_role("option", name="Door001").click()
    expect(page.get_by_text("Door001 is out of order: robots go another way, or wait.")).to_be_visible()
    take_screenshot(page, "map-door-out-of-order")
    page.get_by_role("button", name="Door001 back to normal").click()
    page.get_by_role("alertdialog").get_by_role("button", name="Back to normal").click()
    expect(page.get_by_text("Door001 is out of order")).to_be_hidden()


def test_a_robot_is_taken_out_of_service_and_sent_to_a_place_from_its_card(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/fleet")
    menu = device(page, "Robot2").get_by_role("button", name="Orders to Robot2")
    menu.click()
    page.get_by_role("menuitem", name="Take out of service").click()
    expect(device(page, "Robot2").get_by_text("Out of service", exact=True)).to_be_visible()
    menu.click()
    page.get_by_role("menuitem", name="Back into service").click()
    expect(device(page, "Robot2").get_by_text("Out of service", exact=True)).to_have_count(0)
    menu.click()
    page.get_by_role("menuitem", name="Go to …").click()
    dialog = page.get_by_role("dialog", name="Where Robot2 goes")
    dialog.get_by_role("combobox", name="Place").click()
    page.get_by_role("option").first.click()
    page.wait_for_url(re.compile("/tasks/"))
    expect(page.get_by_text("Robot2 isAt").first).to_be_visible()


def test_a_fault_is_made_and_mended_by_keyboard_and_both_windows_see_it(system: RunningSystem, window: OpenPage) -> None:
    first_page, second_page = window(f"{system.url}/fleet"), window(f"{system.url}/fleet", "820", dark=True)
    expect(device(second_page, "Robot2")).to_be_visible()
    menu = first_page.get_by_role("button", name="Faults of Robot2")
    menu.focus()
    first_page.keyboard.press("Enter")
    item = first_page.get_by_role("listitem").or_(first_page.get_by_role("menuitem")).filter(has_text="Jam the gripper")
    expect(item).to_be_visible()
    take_screenshot(first_page, "fleet-faults")
    item.focus()
    first_page.keyboard.press("Enter")
    for page in (first_page, second_page):
        expect(device(page, "Robot2").get_by_text("Gripper stuck")).to_be_visible()
        expect(device(page, "Robot2").get_by_text("Not working", exact=True)).to_be_visible()
        expect(page.get_by_role("status").first).to_contain_text("1 not working")
    assert fleet(system)["Robot2"]["simulated"]["faults"] == ["gripper"]
    menu.click()
    first_page.get_by_text("Repair the gripper").click()
    for page in (first_page, second_page):
        expect(device(page, "Robot2").get_by_text("Gripper stuck")).to_have_count(0)
        expect(device(page, "Robot2").get_by_text("Ready", exact=True)).to_be_visible()
    assert fleet(system)["Robot2"]["simulated"]["faults"] == []


DOOR = {
    "PositionX": 30.0,
    "PositionY": 4.0,
    "PositionZ": 0.0,
    "Shape.Form": "Box",
    "Shape.Width": 0.1,
    "Shape.Depth": 1.2,
    "Shape.Height": 2.1,
}
LIFT = {**DOOR, "PositionX": 34.0, "Shape.Width": 1.8, "Shape.Depth": 1.8}


@pytest.fixture
def passages(system: RunningSystem) -> Iterator[None]:
    """A lift and a door with a drive, somewhere else on the map."""
    objects = [{"name": "Lift009", "type": "Lift", "values": LIFT}, {"name": "Door009", "type": "PoweredDoor", "values": DOOR}]
    change_map(system, *({"type": "ObjectAdded", "object": added} for added in objects))
    yield
    change_map(system, *({"type": "ObjectRemoved", "name": added["name"]} for added in objects))


def change_map(system: RunningSystem, *changes: Any) -> None:
    data = json.dumps({"changes": changes, "author": "test"}).encode()
    request = urllib.request.Request(f"{system.url}/api/map/changes", data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request):
        pass


@pytest.mark.usefixtures("passages")
def test_a_lift_and_a_door_are_broken_and_repaired_from_their_cards(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/fleet")
    for name in ("Lift009", "Door009"):
        card = device(page, name)
        menu = card.get_by_role("button", name=f"Faults of {name}")
        menu.click()
        expect(page.get_by_role("menuitem")).to_have_text(["flash_onBreak the drive", "flash_onStop its messages", "flash_onCut the link"])
        take_screenshot(page, f"fleet-faults-{name}")
        page.get_by_role("menuitem", name="Break the drive").click()
        expect(card.get_by_text("Not working", exact=True)).to_be_visible()
        expect(card.get_by_text("Drive broken")).to_be_visible()
        assert fleet(system)[name]["simulated"]["faults"] == ["drive"]
        menu.click()
        page.get_by_role("menuitem", name="Repair the drive").click()
        expect(card.get_by_text("Drive broken")).to_have_count(0)
        expect(card.get_by_text("Not working", exact=True)).to_have_count(0)
        assert fleet(system)[name]["simulated"]["faults"] == []
    resize(page, "390")
    card.scroll_into_view_if_needed()
    assert fits(page)
    take_screenshot(page, "fleet-faults-390")


def test_who_joins_is_shown_at_once_and_who_leaves_is_not_dropped_in_silence(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/fleet")
    expect(device(page, "Robot1")).to_be_visible()
    kind = ServiceType(name="Whistle", effect="?Provider isAt ?Place")
    offer = Offer(
        service="Visitor.Whistle", provider="Visitor", provider_type="MobileRobot", address="http://127.0.0.1:9", service_type=kind
    )
    ask_registry(system, Publish(provider="Visitor", offers=(offer,), lease=60.0), Published)
    expect(device(page, "Visitor").get_by_text("Ready")).to_be_visible()
    expect(device(page, "Visitor")).to_contain_text("nothing done yet")
    log = page.get_by_role("log")
    expect(log).to_contain_text("Visitor joined")
    ask_registry(system, Retract(provider="Visitor"), Retracted)
    expect(device(page, "Visitor").get_by_text("Gone")).to_be_visible()
    expect(device(page, "Visitor")).to_contain_text("It withdrew its services at")
    expect(log).to_contain_text("Visitor withdrew its services")
    expect(page.get_by_role("status").first).to_contain_text("1 left recently")
    take_screenshot(page, "fleet-gone")
    system.kill_and_await("api")
    page.reload()
    expect(log).to_contain_text("Visitor joined")
    expect(log).to_contain_text("Visitor withdrew its services")
    expect(device(page, "Visitor").get_by_text("Gone")).to_be_visible()


def test_a_question_is_answered_where_it_is_shown(system: RunningSystem, window: OpenPage) -> None:
    """The person's program is the test: it refuses the first answer, and takes the second."""
    page = window(f"{system.url}/fleet")
    expect(page.get_by_text("No open questions.")).to_be_visible()
    questions = Questions(system.data)
    number = questions.ask("Person001", "Jar002", "Where is Jar002 now?", 60.0)
    question_region = page.get_by_role("region", name=f"Question {number}")
    expect(question_region).to_contain_text("Where is Jar002 now?")
    expect(question_region).to_contain_text("s left")
    take_screenshot(page, "fleet-question")
    question_region.get_by_label("Situation").fill("Jar002 isOn Tabel001")
    question_region.get_by_role("button", name="Answer").click()
    _judge(page, questions, number, "Jar002 isOn Tabel001", problem="there is no Tabel001; did you mean Table001?")
    expect(page.get_by_text("did you mean Table001?")).to_be_visible()
    expect(question_region.get_by_label("Situation")).to_have_value("Jar002 isOn Tabel001")
    place = question_region.get_by_role("combobox", name="Where is Jar002?")
    place.fill("Table001")
    page.get_by_role("option", name="Table001").first.click()
    expect(question_region.get_by_label("Situation")).to_have_value("Jar002 isOn Table001")
    question_region.get_by_label("Situation").press("Enter")
    _judge(page, questions, number, "Jar002 isOn Table001")
    expect(question_region).to_have_count(0)
    questions.close()


def _judge(page: Page, questions: Questions, number: int, expected: str, problem: str = "") -> None:
    deadline = time.monotonic() + PATIENCE
    while (question := questions.read(number)) is None or question.answer is None:
        assert time.monotonic() < deadline, "no answer came"
        page.wait_for_timeout(50)
    assert question.answer == expected
    if problem:
        questions.reject(number, problem)
    else:
        questions.end(number, "taken")


def free_point(system: RunningSystem) -> tuple[float, float]:
    """A point of the room without furniture, where no robot is: other tests move them."""
    positions = [entry["position"][:2] for entry in fleet(system).values() if entry["position"]]
    points = ((10.0, 6.0), (2.5, 4.5), (10.0, 1.5))
    return next(point for point in points if all(math.dist(point, position) > 1 for position in positions))


def screen_position(plan: Locator, point: tuple[float, float]) -> tuple[float, float]:
    """Where a point of the map is on the screen, from where the cupboard and the platform are."""
    boxes = [plan.locator(f'[data-name="{name}"]').bounding_box() for name in ("Cupboard001", "Platform001")]
    (left, top), (right, bottom) = ((box["x"] + box["width"] / 2, box["y"] + box["height"] / 2) for box in boxes if box is not None)
    (cupboard_x, cupboard_y), (platform_x, platform_y) = (0.3, 5.5), (8.2, 2.5)
    return (
        left + (point[0] - cupboard_x) * (right - left) / (platform_x - cupboard_x),
        top + (point[1] - cupboard_y) * (bottom - top) / (platform_y - cupboard_y),
    )


def test_a_simulated_robot_is_put_elsewhere_on_the_floor_plan(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/fleet")
    menu = device(page, "Robot2").get_by_role("button", name="Orders to Robot2")
    menu.click()
    page.get_by_role("menuitem", name="Put elsewhere …").click()
    dialog = page.get_by_role("dialog", name="Put Robot2 elsewhere")
    confirm = dialog.get_by_role("button", name="Put it there")
    expect(confirm).to_be_disabled()
    plan = dialog.locator(".fp-pad")
    robot = plan.locator('[data-name="Robot2"]')
    expect(robot).to_have_count(1)
    wait_until_still(plan)
    page.mouse.click(*screen_position(plan, free_point(system)))
    expect(dialog.get_by_text(re.compile("^To x "))).to_be_visible()
    take_screenshot(page, "fleet-put-elsewhere")
    resize(page, "390")
    assert fits(page)
    take_screenshot(page, "fleet-put-elsewhere-390")
    confirm.click()
    expect(page.get_by_text(re.compile(r"^Robot2 was put at x "))).to_be_visible()
    expect(dialog).to_be_hidden()
