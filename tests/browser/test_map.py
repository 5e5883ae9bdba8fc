"""The map's page: the floor plan, and all that is done on it."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.support.paths import SHARED

from .conftest import PATIENCE, RunningSystem, every_look, fits, slow_network, take_screenshot, wait_until_still

OFFICE = SHARED / "sites" / "office.building.yaml"
pytestmark = pytest.mark.long

OpenWindow = Callable[..., Page]

FLOOR = {
    "PositionX": 6.0,
    "PositionY": 4.0,
    "PositionZ": 2.9,
    "Shape.Form": "Box",
    "Shape.Width": 12.0,
    "Shape.Depth": 8.0,
    "Shape.Height": 0.1,
}
CHAIR = {**FLOOR, "PositionX": 2.0, "PositionZ": 3.0, "Shape.Width": 0.5, "Shape.Depth": 0.5, "Shape.Height": 0.9}
UPSTAIRS = [
    {"type": "ObjectAdded", "object": {"name": "Storey002", "type": "Storey", "values": {"Elevation": 3.0}}},
    {"type": "ObjectAdded", "object": {"name": "Floor003", "type": "Floor", "values": FLOOR}},
    {"type": "ObjectAdded", "object": {"name": "Chair009", "type": "Chair", "values": CHAIR}},
    {"type": "FactAdded", "fact": {"relation": "isPartOf", "arguments": ["Storey002", "Building001"]}},
    {"type": "FactAdded", "fact": {"relation": "isPartOf", "arguments": ["Floor003", "Storey002"]}},
]
"""A storey above the other, with a chair."""


def api(system: RunningSystem, path: str, body: Any = None) -> Any:
    data = json.dumps(body).encode() if body is not None else None
    request = urllib.request.Request(f"{system.url}/api{path}", data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


class MapState:
    """The map as the API has it."""

    def __init__(self, system: RunningSystem) -> None:
        content = api(system, "/map")
        self.version: int = content["version"]
        self.objects: dict[str, dict[str, Any]] = {entry["name"]: entry["values"] for entry in content["objects"]}
        self.facts = {(fact["relation"], *fact["arguments"]) for fact in content["facts"]}

    def position(self, name: str) -> tuple[float, float]:
        return self.objects[name]["PositionX"], self.objects[name]["PositionY"]


@pytest.fixture
def restored_system(system: RunningSystem) -> Iterator[RunningSystem]:
    """The system, with the map brought back to what it was."""
    version_before = MapState(system).version
    yield system
    for event in api(system, f"/map/events?after={version_before}&limit=100")["events"][::-1]:
        if event["author"] != "nobody":
            api(system, f"/map/undo/{event['version']}?author=nobody", {})


def open_map(window: OpenWindow, system: RunningSystem, query: str = "", size: str = "1280", *, dark: bool = False) -> Page:
    page = window(f"{system.url}/map{query}", size, dark=dark)
    body(page, "Floor001").wait_for(state="attached")
    page.get_by_text(re.compile(r"^\d+ objects$")).wait_for()  # what the server said last
    wait_until_still(body(page, "Floor001"))
    return page


def plan(page: Page) -> Locator:
    return page.get_by_role("application", name="Floor plan")


def body(page: Page, name: str) -> Locator:
    return page.locator(f"[data-name={name}] .fp-body").first


def screen_position(page: Page, name: str) -> tuple[float, float]:
    """Where on the screen the middle of an object is."""
    box = body(page, name).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def is_close_to(page: Page, name: str, position: tuple[float, float], tolerance: float = 4) -> bool:
    return math.dist(screen_position(page, name), position) <= tolerance


def drag(page: Page, start: tuple[float, float], end: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + 8, start[1] + 8)
    page.mouse.move(*end, steps=4)
    page.mouse.up()


def wait_until(page: Page, condition: Callable[[], object], description: str) -> None:
    """Wait for something that the page or the system is to come to."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if condition():
            return
        page.wait_for_timeout(50)
    messages = page.locator(".q-notification, [role=alert]").all_inner_texts()
    raise AssertionError(f"it did not come to this: {description}; the page says {messages}")


def choose(page: Page, name: str) -> None:
    page.mouse.click(*screen_position(page, name))
    expect(page.get_by_role("heading", name=name, exact=True)).to_be_visible()


def tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click()
    expect(page.get_by_role("tab", name=name)).to_have_attribute("aria-selected", "true")


def field(page: Page, name: str) -> Locator:
    return page.get_by_role("textbox", name=name)


BURST = """() => {
    for (const [key, shiftKey] of [["ArrowRight", false], ["ArrowRight", false], ["ArrowUp", false], ["ArrowDown", true], ["r", false]])
        document.activeElement.dispatchEvent(new KeyboardEvent("keydown", { key, shiftKey, bubbles: true, cancelable: true }));
}"""
"""Keys that are pressed quickly one after the other, also on a busy machine."""


@pytest.mark.looks
def test_the_map_fits_every_window(system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, system, "?object=Robot1")
    page.get_by_role("button", name="Legend").click()
    expect(page.get_by_role("region", name="Legend")).to_contain_text("Door, closed")
    for look in every_look(page):
        wait_until_still(body(page, "Floor001"))
        take_screenshot(page, f"map-{look}")
        assert fits(page)


def test_a_jar_that_is_dragged_elsewhere_is_there_in_every_window(restored_system: RunningSystem, window: OpenWindow) -> None:
    page, other_page = open_map(window, restored_system), open_map(window, restored_system)
    start, table = screen_position(page, "Jar003"), screen_position(page, "Table001")
    drag(page, start, table)
    wait_until(page, lambda: ("isOn", "Jar003", "Table001") in MapState(restored_system).facts, "the jar is on the table")
    map_state = MapState(restored_system)
    assert ("isOn", "Jar003", "Cupboard001") not in map_state.facts
    assert map_state.position("Jar003") == pytest.approx(map_state.position("Table001"), abs=0.1)
    assert map_state.objects["Jar003"]["PositionZ"] == pytest.approx(0.74)
    wait_until(
        other_page, lambda: is_close_to(other_page, "Jar003", screen_position(other_page, "Table001"), 8), "the other window shows it there"
    )
    page.keyboard.press("Control+z")
    wait_until(other_page, lambda: is_close_to(other_page, "Jar003", start), "undone, the jar is back in the other window")
    assert ("isOn", "Jar003", "Cupboard001") in MapState(restored_system).facts


def test_undoing_twice_takes_two_changes_back_however_quickly(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    for name, support in (("Jar003", "Table001"), ("Carton001", "Table001")):
        drag(page, screen_position(page, name), screen_position(page, support))
        wait_until(page, lambda: ("isOn", name, support) in MapState(restored_system).facts, "it is on the table")  # noqa: B023
    with restored_system.paused("repository"):
        page.keyboard.press("Control+z")
        page.keyboard.press("Control+z")
        page.wait_for_timeout(300)
    before = {("isOn", "Jar003", "Cupboard001"), ("isOn", "Carton001", "Table002")}
    wait_until(page, lambda: before <= set(MapState(restored_system).facts), "both are where they were")


def test_what_stands_on_furniture_goes_along(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    map_before = MapState(restored_system)
    (x, y), scale = screen_position(page, "Table002"), _scale(page)
    drag(page, (x - 20, y - 10), (x - 20 + scale, y - 10))
    wait_until(page, lambda: MapState(restored_system).position("Table002") != map_before.position("Table002"), "the table moved")
    map_after = MapState(restored_system)
    shift = [map_after.position(name)[0] - map_before.position(name)[0] for name in ("Table002", "Carton001")]
    assert shift[0] == pytest.approx(1, abs=0.06)
    assert shift[1] == pytest.approx(shift[0], abs=1e-6)
    assert ("isOn", "Carton001", "Table002") in map_after.facts


def _scale(page: Page) -> float:
    """Pixels a metre, from a floor whose width is known."""
    box = body(page, "Floor001").bounding_box()
    assert box is not None
    return box["width"] / 12.1


def test_an_object_is_turned_by_its_handle(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    choose(page, "Table001")
    handle = page.locator("[data-handle=turn]").bounding_box()
    assert handle is not None
    x, y = screen_position(page, "Table001")
    drag(page, (handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2), (x, y - 80))
    wait_until(page, lambda: "RotationZ" in MapState(restored_system).objects["Table001"], "the table is turned")
    assert MapState(restored_system).objects["Table001"]["RotationZ"] == pytest.approx(math.pi / 2, abs=1e-3)
    expect(field(page, "RotationZ")).to_have_value("90")


def test_the_keyboard_alone_chooses_moves_and_turns(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    map_before = MapState(restored_system)
    plan(page).focus()
    status_line = page.locator(".somrs-plan").get_by_role("status").first
    for _ in range(40):
        last_text = status_line.text_content() or ""
        page.keyboard.press("PageDown")
        expect(status_line).not_to_have_text(last_text)
        if "Platform001, Platform" in (status_line.text_content() or ""):
            break
    expect(page.get_by_role("heading", name="Platform001", exact=True)).to_be_visible()
    page.evaluate(BURST)
    wait_until(page, lambda: "RotationZ" in MapState(restored_system).objects["Platform001"], "the platform is moved")
    map_after = MapState(restored_system)
    (x, y), (x2, y2) = map_before.position("Platform001"), map_after.position("Platform001")
    assert [x2 - x, y2 - y] == pytest.approx([0.2, 0.09])
    assert map_after.objects["Platform001"]["RotationZ"] == pytest.approx(math.pi / 12, abs=1e-4)
    assert map_after.version == map_before.version + 1, "one burst of keys is one change"
    page.keyboard.press("Control+z")
    wait_until(page, lambda: MapState(restored_system).position("Platform001") == (x, y), "it is back")


def test_an_object_is_added_where_one_clicks_and_removed_and_brought_back(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    tab(page, "Add")
    page.get_by_placeholder("Find a type").fill("Jar")
    page.get_by_role("treeitem", name="Jar").click()
    expect(page.get_by_text("Click the new position")).to_be_visible()
    x, y = screen_position(page, "Table001")
    page.mouse.click(x + 20, y + 10)
    expect(page.get_by_role("textbox", name="Name", exact=True)).to_have_value("Jar004")
    page.get_by_role("button", name="Add", exact=True).click()
    wait_until(page, lambda: ("isOn", "Jar004", "Table001") in MapState(restored_system).facts, "the jar is on the table")
    expect(page.get_by_role("heading", name="Jar004", exact=True)).to_be_visible()

    plan(page).focus()
    page.keyboard.press("Delete")
    page.get_by_role("button", name="Remove", exact=True).click()
    wait_until(page, lambda: "Jar004" not in MapState(restored_system).objects, "the jar is removed")
    expect(body(page, "Jar004")).to_have_count(0)
    plan(page).focus()
    page.keyboard.press("Control+z")
    wait_until(page, lambda: ("isOn", "Jar004", "Table001") in MapState(restored_system).facts, "the jar is back, on the table")
    expect(body(page, "Jar004")).to_have_count(1)


def test_an_object_is_added_by_keys_alone(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    tab(page, "Add")
    page.get_by_placeholder("Find a type").fill("Plant")
    page.get_by_role("treeitem", name="Plant").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_text("press Enter")).to_be_visible()
    expect(plan(page)).to_be_focused()
    for key in ("ArrowLeft", "ArrowLeft", "ArrowDown", "Enter"):
        page.keyboard.press(key)
    expect(page.get_by_role("textbox", name="Name", exact=True)).to_be_focused()
    page.keyboard.press("Enter")
    wait_until(page, lambda: "Plant001" in MapState(restored_system).objects, "the plant is there")
    expect(body(page, "Plant001")).to_have_count(1)


def test_a_storey_that_is_added_can_be_chosen(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    expect(page.get_by_role("combobox", name="Storey")).to_have_count(0)
    api(restored_system, "/map/changes", {"changes": UPSTAIRS, "author": "Anna"})
    page.get_by_role("combobox", name="Storey").select_option("Storey002")
    expect(body(page, "Chair009")).to_have_count(1)
    expect(body(page, "Chair001")).to_have_count(0)
    page.get_by_role("combobox", name="Storey").select_option("Storey001")
    expect(body(page, "Chair009")).to_have_count(0)
    expect(body(page, "Chair001")).to_have_count(1)


def test_the_address_keeps_the_view_and_the_storey(restored_system: RunningSystem, window: OpenWindow) -> None:
    api(restored_system, "/map/changes", {"changes": UPSTAIRS, "author": "Anna"})
    page = open_map(window, restored_system)
    page.get_by_role("combobox", name="Storey").select_option("Storey002")
    page.mouse.click(*screen_position(page, "Chair009"))
    expect(page).to_have_url(f"{restored_system.url}/map?storey=Storey002&object=Chair009")
    page.reload()
    expect(body(page, "Chair009")).to_have_count(1)
    expect(page.get_by_role("heading", name="Chair009", exact=True)).to_be_visible()
    page.set_viewport_size({"width": 640, "height": 480})  # quickly drawn, even without a graphics card
    page.get_by_role("button", name="3D", exact=True).click()
    expect(page).to_have_url(f"{restored_system.url}/map?view=3d&storey=Storey002&object=Chair009")
    storey = page.locator(".somrs-scene").get_by_role("combobox", name="Storey")
    expect(storey.locator("option:checked")).to_have_text("Storey002")
    page.reload()
    expect(page.locator(".somrs-map-stage canvas").first).to_be_visible()
    expect(plan(page)).to_be_hidden()
    expect(storey.locator("option:checked")).to_have_text("Storey002")
    storey.select_option("All storeys")
    expect(page).to_have_url(f"{restored_system.url}/map?view=3d&storey=all&object=Chair009")
    page.reload()
    expect(storey.locator("option:checked")).to_have_text("All storeys")
    page.get_by_role("button", name="Plan", exact=True).click()
    wait_until(
        page,
        lambda: _is_in_view(page, "Chair009") or _is_in_view(page, "Chair001"),
        "the plan is drawn in full, though it was hidden at first",
    )


def test_the_plan_is_fitted_again_to_another_window_unless_somebody_zoomed(system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, system)
    wide = _scale(page)
    page.set_viewport_size({"width": 820, "height": 700})
    wait_until(page, lambda: _scale(page) < 0.9 * wide and _is_in_view(page, "Floor001"), "the plan is smaller, and whole")
    page.set_viewport_size({"width": 1280, "height": 800})
    wait_until(page, lambda: abs(_scale(page) / wide - 1) < 0.01, "the plan is as large as before")
    page.get_by_role("button", name="Zoom in").click()
    wait_until(page, lambda: _scale(page) > 1.2 * wide, "the plan is zoomed")
    zoomed = _scale(page)
    page.set_viewport_size({"width": 1000, "height": 800})
    page.wait_for_timeout(500)
    assert _scale(page) == pytest.approx(zoomed), "whoever zoomed looks at something"


def _is_in_view(page: Page, name: str) -> bool:
    """Whether an object is in view as a whole, at this moment."""
    boxes = [
        locator.evaluate_all("all => all.map((one) => one.getBoundingClientRect().toJSON())") for locator in (body(page, name), plan(page))
    ]
    if not all(boxes):
        return False
    (box,), (pad,) = boxes
    return bool(
        box["width"] > 0
        and box["left"] >= pad["left"]
        and box["top"] >= pad["top"]
        and box["right"] <= pad["right"]
        and box["bottom"] <= pad["bottom"]
    )


def test_what_would_break_a_rule_cannot_be_removed(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system, "?object=Floor001")
    page.get_by_role("button", name="Remove it").click()
    dialog = page.get_by_role("alertdialog", name="Remove Floor001?")
    expect(dialog).to_contain_text("exactly 1 of type Floor")
    expect(dialog.get_by_role("button", name="Remove", exact=True)).to_have_count(0)
    dialog.get_by_role("button", name="Cancel").click()
    assert "Floor001" in MapState(restored_system).objects


def test_attributes_are_checked_where_they_are_written(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system, "?object=Jar003")
    weight = field(page, "Weight")
    expect(weight).to_have_attribute("placeholder", "0.3")
    weight.fill("7")
    weight.press("Enter")
    expect(page.get_by_text("A gripper holds up to 5 kg")).to_be_visible()
    assert "Weight" not in MapState(restored_system).objects["Jar003"]
    weight.fill("12 m")
    weight.press("Enter")
    expect(page.get_by_text("cannot be expressed in it")).to_be_visible()
    weight.fill("450 g")
    page.get_by_role("button", name="Save").click()
    wait_until(page, lambda: MapState(restored_system).objects["Jar003"].get("Weight") == 0.45, "the weight is saved")
    expect(weight).to_have_value("0.45")
    expect(page.get_by_role("button", name="Save")).to_be_hidden()


def test_two_people_who_write_the_same_attribute_lose_nothing(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system, "?object=Table001")
    label = field(page, "Label")
    label.fill("Mine")
    texture = field(page, "Texture")
    texture.fill("Smooth")
    change = [{"type": "ValueSet", "object": "Table001", "path": "Label", "value": "Theirs"}]
    api(restored_system, "/map/changes", {"changes": change, "author": "Anna"})
    news = page.get_by_role("alert").filter(has_text="Meanwhile Anna set Label to Theirs; you wrote Mine")
    expect(news).to_be_visible()
    expect(label).to_have_value("Mine")
    page.get_by_role("button", name="Save").click()
    assert MapState(restored_system).objects["Table001"]["Label"] == "Theirs"
    news.get_by_role("button", name="Keep mine").click()
    page.get_by_role("button", name="Save").click()
    wait_until(page, lambda: MapState(restored_system).objects["Table001"]["Label"] == "Mine", "the decision is saved")
    assert MapState(restored_system).objects["Table001"]["Texture"] == "Smooth"


def test_what_is_typed_while_another_value_is_on_its_way_is_kept(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    page.add_init_script(slow_network(1000))
    page.goto(f"{restored_system.url}/map?object=Table001")
    page.get_by_text(re.compile(r"^\d+ objects$")).wait_for()
    label = field(page, "Label")
    label.fill("Mine")
    change = [{"type": "ValueSet", "object": "Table001", "path": "Label", "value": "Theirs"}]
    api(restored_system, "/map/changes", {"changes": change, "author": "Anna"})
    news = page.get_by_role("alert").filter(has_text="Meanwhile Anna set Label to Theirs; you wrote Mine")
    expect(news).to_be_visible()
    expect(label).to_have_value("Mine")
    news.get_by_role("button", name="Take theirs").click()
    expect(label).to_have_value("Theirs")


def test_what_is_moved_again_before_the_page_knows_of_the_first_move_is_where_it_was_moved_last(
    restored_system: RunningSystem, window: OpenWindow
) -> None:
    page = open_map(window, restored_system)
    page.add_init_script(slow_network(1000))
    page.reload()
    body(page, "Chair003").wait_for()
    wait_until_still(body(page, "Chair003"))
    (x, y), scale = MapState(restored_system).position("Chair003"), _scale(page)
    for _ in range(3):
        start = screen_position(page, "Chair003")
        drag(page, start, (start[0] + 0.5 * scale, start[1]))
    expect(page.get_by_text("Chair003: the move is on its way …")).to_be_visible()
    take_screenshot(page, "map-late")
    page.keyboard.press("Control+z")
    start = screen_position(page, "Chair003")
    drag(page, start, (start[0], start[1] - 0.5 * scale))
    wait_until(page, lambda: MapState(restored_system).position("Chair003")[1] > y, "it was moved up last")
    assert MapState(restored_system).position("Chair003") == pytest.approx((x + 1.5, y + 0.5), abs=0.06)
    assert page.get_by_text("Another user changed").count() == 0
    wait_until(page, lambda: is_close_to(page, "Chair003", (start[0], start[1] - 0.5 * scale)), "it is drawn there")
    expect(page.get_by_text("the move is on its way …")).to_have_count(0)


def test_a_drag_that_was_overtaken_goes_back(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    start = screen_position(page, "Chair003")
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + 40, start[1] - 40, steps=3)
    change = [{"type": "ValueSet", "object": "Chair003", "path": "Label", "value": "The blue one"}]
    api(restored_system, "/map/changes", {"changes": change, "author": "Anna"})
    page.wait_for_timeout(500)
    page.mouse.move(start[0] + 120, start[1] - 60, steps=3)
    page.mouse.up()
    expect(page.get_by_text("Another user changed Chair003 while you moved")).to_be_visible()
    wait_until(page, lambda: is_close_to(page, "Chair003", start), "the chair is back where it was")
    assert MapState(restored_system).position("Chair003") == (4, 3.1)


def test_an_object_that_others_remove_says_so_to_whoever_has_it_open(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system, "?object=Chair002")
    field(page, "Label").fill("My seat")
    api(restored_system, "/map/changes", {"changes": [{"type": "ObjectRemoved", "name": "Chair002"}], "author": "Anna"})
    expect(page.get_by_text("Chair002 is not on the map any more: Anna removed or renamed it.")).to_be_visible()
    expect(field(page, "Label")).to_have_value("My seat")
    expect(body(page, "Chair002")).to_have_count(0)


def test_what_a_formula_finds_is_ringed_and_listed(system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, system)
    tab(page, "Find")
    formula = page.get_by_label("Query formula")
    formula.fill("?Thing isOn Cupboard001")
    formula.press("Control+Enter")
    expect(page.get_by_role("cell", name="Jar002")).to_be_visible()
    expect(page.get_by_role("cell", name="Jar003")).to_be_visible()
    expect(page.locator("[data-label=Jar002]")).to_contain_text("Jar002 ?Thing")
    expect(page.locator(".fp-ring")).to_have_count(2)
    take_screenshot(page, "map-find")
    formula.fill("?Thing isOnn Cupboard001")
    expect(page.get_by_text("isOnn").last).to_be_visible()
    expect(page.get_by_text("did you mean isOn").first).to_be_visible()


def test_the_history_shows_the_map_as_it_was(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    start, platform = screen_position(page, "Jar003"), screen_position(page, "Platform001")
    drag(page, start, platform)
    wait_until(page, lambda: ("isOn", "Jar003", "Platform001") in MapState(restored_system).facts, "the jar is on the platform")
    wait_until(page, lambda: is_close_to(page, "Jar003", platform, 8), "and is drawn there")
    page.get_by_role("button", name="One version back").click()
    wait_until(page, lambda: is_close_to(page, "Jar003", start), "the jar is back where it was then")
    expect(page.get_by_role("button", name="Back to now")).to_be_visible()
    details = page.get_by_role("complementary", name="Details")
    expect(details.get_by_text("Jar003 isOn Cupboard001")).to_be_visible()
    expect(details.get_by_role("button", name="Save")).to_have_count(0)
    take_screenshot(page, "map-past")
    page.get_by_role("button", name="Back to now").click()
    wait_until(page, lambda: is_close_to(page, "Jar003", platform, 8), "the jar is where it is now")
    tab(page, "Changes")
    entry = page.get_by_role("list", name="Changes of the map").get_by_role("listitem").first
    expect(entry).to_contain_text("Jar003 moved to")
    expect(entry).to_contain_text("put on Platform001")


SIGHTING = "?It: Jar isOn Platform001 AND ?It.PositionX = {x} AND ?It.PositionY = {y} AND ?It.PositionZ = {z} AND ?It.Color = Red"


def discover_jar(system: RunningSystem) -> str:
    """A camera sees a jar on the platform, where the map has none; its name."""
    state = MapState(system)
    x, y = state.position("Platform001")
    height = state.objects["Platform001"]["PositionZ"] + state.objects["Platform001"]["Shape.Height"]
    sighting = SIGHTING.format(x=x, y=y, z=height)
    observation = {"as_of": time.time()}
    answer = api(system, "/map/changes", {"situation": sighting, "author": "Camera001", "observation": observation})
    (name,) = answer["reception"]["added"]
    return str(name)


def test_a_discovered_object_says_who_saw_it_and_is_a_known_one(restored_system: RunningSystem, window: OpenWindow) -> None:
    name = discover_jar(restored_system)
    page = open_map(window, restored_system, f"?object={name}")
    details = page.get_by_role("complementary", name="Details")
    expect(details.get_by_text("Discovered by Camera001")).to_be_visible()
    take_screenshot(page, "map-discovered")
    details.get_by_role("button", name="Which object is it?").click()
    dialog = page.get_by_role("dialog", name=f"Which object is {name}?")
    field = dialog.get_by_role("combobox", name="Known object")
    expect(field).to_have_value(re.compile(r"^Jar"))
    expect(dialog.get_by_text("This can be undone.", exact=False)).to_be_visible()
    field.fill("Jar003")
    page.get_by_role("option", name=re.compile("^Jar003")).click()
    expect(dialog.get_by_role("status")).to_contain_text(re.compile("Jar003 .*put on Platform001"))
    take_screenshot(page, "map-merge")
    dialog.get_by_role("button", name="It is Jar003").click()
    expect(details.get_by_role("heading", name="Jar003")).to_be_visible()
    wait_until(page, lambda: ("isOn", "Jar003", "Platform001") in MapState(restored_system).facts, "the jar is on the platform")
    assert name not in MapState(restored_system).objects
    details.get_by_text("History", exact=True).click()
    expect(details.get_by_text(f"{name} turned out to be Jar003")).to_be_visible()
    take_screenshot(page, "map-merged")


def test_a_long_history_is_shown_in_parts(restored_system: RunningSystem, window: OpenWindow) -> None:
    versions = [
        api(restored_system, "/map/changes", {"situation": f"Jar002.Weight = {0.2 + number / 1000}", "author": "Anna"})["version"]
        for number in range(30)
    ]
    page = open_map(window, restored_system, "?object=Jar002")
    details = page.get_by_role("complementary", name="Details")
    details.get_by_text("History", exact=True).click()
    first = details.get_by_role("button", name=f"Show the map at version {versions[0]}", exact=True)
    expect(details.get_by_role("button", name=f"Show the map at version {versions[-1]}", exact=True)).to_be_visible()
    expect(first).to_have_count(0)
    details.get_by_role("button", name="Earlier changes").click()
    expect(first).to_be_attached()


def test_a_map_of_the_past_is_drawn_with_the_types_of_then(restored_system: RunningSystem, window: OpenWindow) -> None:
    shape = {"Shape.Form": "Box", "Shape.Width": 1.0, "Shape.Depth": 1.0, "Shape.Height": 1.0}
    api(restored_system, "/ontology/changes", {"definitions": {"types": [{"name": "Crate", "parent": "Obstacle"}]}, "author": "Anna"})
    crate = {"name": "Crate001", "type": "Crate", "values": {"PositionX": 8.0, "PositionY": 1.2, "PositionZ": 0.0, **shape}}
    crate_version = api(restored_system, "/map/changes", {"changes": [{"type": "ObjectAdded", "object": crate}], "author": "Anna"})[
        "version"
    ]
    api(restored_system, "/map/changes", {"changes": [{"type": "ObjectRemoved", "name": "Crate001"}], "author": "Anna"})
    api(restored_system, "/ontology/changes", {"removed": [{"section": "types", "name": "Crate"}], "author": "Anna"})
    page = open_map(window, restored_system)
    expect(page.locator("[data-name=Crate001]")).to_have_count(0)
    for _ in range(MapState(restored_system).version - crate_version):
        page.get_by_role("button", name="One version back").click()
    expect(page.locator("[data-name=Crate001].fp-obstacle")).to_have_count(1)
    assert "Crate001" in {scene_body["name"] for scene_body in api(restored_system, f"/scene?version={crate_version}")["bodies"]}
    page.get_by_role("button", name="Back to now").click()
    expect(page.locator("[data-name=Crate001]")).to_have_count(0)


def test_relations_are_drawn_listed_and_added(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system, "?object=Chair001")
    page.get_by_role("button", name="Links").click()
    page.get_by_role("checkbox", name="isOn").click()
    page.keyboard.press("Escape")
    expect(page.locator(".fp-link title", has_text="Jar002 isOn Cupboard001")).to_have_count(1)
    page.get_by_role("button", name="Add a relation").click()
    relation = page.get_by_role("combobox", name="Relation")
    relation.fill("isAdj")
    page.get_by_role("option", name="this isAdjacentTo Object").click()
    object_field = page.get_by_role("combobox", name="Object", exact=True)
    object_field.press_sequentially("Table001", delay=40)
    expect(page.get_by_role("option", name="Table001").first).to_be_visible()
    take_screenshot(page, "map-relation")
    page.get_by_role("option", name="Table001").first.click()
    page.get_by_role("button", name="Add", exact=True).click()
    wait_until(page, lambda: ("isAdjacentTo", "Chair001", "Table001") in MapState(restored_system).facts, "the relation is on the map")
    page.get_by_role("button", name="Delete Chair001 isAdjacentTo Table001").click()
    wait_until(page, lambda: ("isAdjacentTo", "Chair001", "Table001") not in MapState(restored_system).facts, "it is taken away again")


def test_an_object_of_which_nothing_is_known_is_marked(restored_system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, restored_system)
    change = [{"type": "ValueSet", "object": "Carton001", "path": "Unknown", "value": True}]
    api(restored_system, "/map/changes", {"changes": change, "author": "Anna"})
    expect(page.locator("[data-name=Carton001].fp-unknown")).to_have_count(1)
    expect(page.locator(".fp-question")).to_have_text("?")


def test_the_plan_and_the_scene_show_the_same_choice(system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, system, "?object=Robot1")
    page.set_viewport_size({"width": 640, "height": 480})  # quickly drawn, even without a graphics card
    page.get_by_role("button", name="3D", exact=True).click()
    expect(page.locator(".somrs-map-stage canvas").first).to_be_visible()
    expect(plan(page)).to_be_hidden()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(plan(page)).to_be_visible()
    expect(page.get_by_role("heading", name="Robot1", exact=True)).to_be_visible()


@pytest.fixture(scope="module")
def office(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """A real building, as Open-RMF has it."""
    if not OFFICE.exists():
        pytest.skip(f"there is no {OFFICE}")
    folder = tmp_path_factory.mktemp("office")
    site = folder / "office.yaml"
    subprocess.run([sys.executable, "-m", "somrs.cli.main", "import", str(OFFICE), "--out", str(site)], check=True, capture_output=True)
    running = RunningSystem(folder / "data", site)
    yield running
    running.stop()


def test_a_real_building_is_drawn_to_scale(office: RunningSystem, window: OpenWindow) -> None:
    page = window(f"{office.url}/map", "1920")
    body(page, "ConfTable001").wait_for(state="attached")
    wait_until_still(body(page, "ConfTable001"))
    take_screenshot(page, "map-office")
    map_state = MapState(office)
    coe_position, pantry_position = map_state.position("coe"), map_state.position("pantry")
    scale = math.dist(screen_position(page, "coe"), screen_position(page, "pantry")) / math.dist(coe_position, pantry_position)
    for name, other_name in (("lounge", "supplies"), ("patrol_B", "patrol_C"), ("Coke001", "tinyRobot1")):
        assert math.dist(screen_position(page, name), screen_position(page, other_name)) == pytest.approx(
            scale * math.dist(map_state.position(name), map_state.position(other_name)), rel=0.02
        )
    assert {name for name in map_state.objects if "PositionX" in map_state.objects[name]} == set(
        page.eval_on_selector_all("[data-name]", "(all) => all.map((one) => one.dataset.name)")
    )


def test_checkboxes_and_switches_show_a_click_before_the_server_answers(system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, system)
    snap, scene = page.get_by_role("switch", name="Snap"), page.get_by_role("button", name="3D", exact=True)
    page.get_by_role("button", name="Links").click()
    relation = page.get_by_role("checkbox", name="isOn", exact=True)
    expect(relation).to_be_visible()
    with system.paused("gui"):
        relation.click()
        expect(relation).to_be_checked()
        page.keyboard.press("Escape")
        snap.click()
        expect(snap).not_to_be_checked()
        scene.click()
        expect(scene).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("button", name="Links: 1")).to_be_visible()  # the server has answered
    expect(snap).not_to_be_checked()
    snap.click()
    expect(snap).to_be_checked()


def test_traffic_is_shown_on_demand_with_the_roadmap(system: RunningSystem, window: OpenWindow) -> None:
    page = window(f"{system.url}/map")
    button = page.get_by_role("button", name="Traffic")
    expect(page.get_by_role("region", name="Traffic")).to_have_count(0)
    button.click()
    expect(page.locator(".fp-road")).to_have_count(1)
    expect(page.get_by_role("region", name="Traffic").get_by_text("No robot waits for another.")).to_be_visible()
    take_screenshot(page, "map-traffic")
    button.click()
    expect(page.locator(".fp-road")).to_have_count(0)


def test_a_no_go_zone_is_drawn_on_the_plan_and_removed(system: RunningSystem, window: OpenWindow) -> None:
    page = open_map(window, system)
    pad = plan(page)
    drawing = page.get_by_role("group", name="New zone")
    box = pad.bounding_box()
    assert box is not None
    with system.paused("gui"):  # the browser draws by itself
        page.get_by_role("button", name="Zone").click()
        for x, y in ((0.45, 0.4), (0.55, 0.6)):
            page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        drawing.get_by_role("button", name="Finish").click()
    dialog = page.get_by_role("dialog", name="New zone")
    dialog.get_by_label("Name").fill("WetFloor")
    dialog.get_by_role("button", name="Draw").dblclick()
    expect(pad.locator('[data-name="WetFloor"]')).to_have_count(1)
    expect(page.get_by_text("WetFloor was drawn")).to_be_visible()
    expect(page.locator(".q-notification.bg-negative")).to_have_count(0)
    take_screenshot(page, "map-zone")
    page.set_viewport_size({"width": 390, "height": 844})
    assert fits(page)
    take_screenshot(page, "map-zone-390")
    page.set_viewport_size({"width": 1280, "height": 800})
    (zone,) = api(system, "/zones")["zones"]
    assert (zone["name"], zone["limit"], len(zone["corners"])) == ("WetFloor", None, 4)
    page.get_by_role("button", name="Undo").click()
    expect(pad.locator('[data-name="WetFloor"]')).to_have_count(0)


def test_the_corners_of_a_zone_are_dragged_and_moved_by_keys(restored_system: RunningSystem, window: OpenWindow) -> None:
    api(restored_system, "/zones", {"corners": [[9, 4], [11, 4], [11, 6.5], [9, 6.5]], "name": "WetFloor", "by": "somebody"})
    page = open_map(window, restored_system)
    choose(page, "WetFloor")
    expect(plan(page).locator(".fp-corner")).to_have_count(4)
    start, scale = corner_position(page, 2), _scale(page)
    drag(page, start, (start[0] - 0.5 * scale, start[1] + 0.5 * scale))
    wait_until(page, lambda: corners_of_zone(restored_system) == [[9, 4], [11, 4], [10.5, 6], [9, 6.5]], "the corner is dragged")
    for key in ("c", "ArrowUp", "ArrowUp"):  # the next corner
        page.keyboard.press(key)
    wait_until(page, lambda: corners_of_zone(restored_system) == [[9, 4], [11, 4], [10.5, 6], [9, 6.7]], "the corner is moved by keys")
    take_screenshot(page, "map-zone-corners")
    page.set_viewport_size({"width": 390, "height": 844})
    assert fits(page)
    take_screenshot(page, "map-zone-corners-390")
    page.set_viewport_size({"width": 1280, "height": 800})
    wait_until_still(body(page, "WetFloor"))
    drag(page, corner_position(page, 3), corner_position(page, 1))
    expect(page.get_by_text("WetFloor was moved back: the corners of the zone lie on one line")).to_be_visible()
    assert corners_of_zone(restored_system) == [[9, 4], [11, 4], [10.5, 6], [9, 6.7]]


def corner_position(page: Page, index: int) -> tuple[float, float]:
    box = plan(page).locator(f'[data-corner="{index}"]').bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def corners_of_zone(system: RunningSystem) -> list[list[float]]:
    (zone,) = api(system, "/zones")["zones"]
    corners: list[list[float]] = zone["corners"]
    return corners
