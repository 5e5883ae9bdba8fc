"""The 3D view, with the simulator's robots moving in it."""

from __future__ import annotations

import json
import math
import re
import time
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from somrs.devices.simulator.world.kinds import WorldKind

from .conftest import PATIENCE, WORK_TIME, RunningSystem, running_in, take_screenshot

pytestmark = pytest.mark.long

OpenWindow = Callable[..., Page]
SMALL = "640"
"""Quickly drawn, even without a graphics card."""
POLLING = 100
"""Milliseconds between two looks at the scene: Playwright would look in each frame, and so have all of them drawn."""


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """Real motion, and robots that take their time, so that a busy machine, too, draws them often enough on their way."""
    with running_in(tmp_path_factory.mktemp("scene"), "3", WorldKind.PHYSICS) as running:
        yield running


def open_page(system: RunningSystem, window: OpenWindow, size: str = "1280", *, dark: bool = False) -> Page:
    """A page that shows the building in three dimensions."""
    page = window("about:blank", size, dark=dark)
    open_scene(system, page)
    return page


def open_scene(system: RunningSystem, page: Page) -> None:
    page.goto(f"{system.url}/map")
    page.get_by_role("button", name="3D", exact=True).click()
    page.wait_for_function("window.somrsScene?.drawn() && somrsScene.names().length > 20 && somrsScene.frames() > 0", polling=POLLING)


def wait_until_at_rest(page: Page) -> None:
    """Wait until it draws no more, and in full quality."""
    page.wait_for_function(
        """() => {
            const frames = somrsScene.frames();
            if (frames !== window.before) [window.before, window.since] = [frames, performance.now()];
            return somrsScene.refined() && performance.now() - window.since > 700;
        }""",
        polling=POLLING,
    )


def call_api(system: RunningSystem, method: str, path: str, body: object = None) -> Any:
    request = urllib.request.Request(f"{system.url}/api{path}", headers={"Content-Type": "application/json"}, method=method)
    if body is not None:
        request.data = json.dumps(body).encode()
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        return json.loads(answer.read() or b"null")


def submit_task(system: RunningSystem, goal: str) -> str:
    """Submit a task. Its id."""
    return str(call_api(system, "POST", "/tasks", {"effect": goal})["task"])


def await_success(system: RunningSystem, task: str) -> None:
    """Wait for the task's good end."""
    deadline = time.monotonic() + WORK_TIME / 1000
    while time.monotonic() < deadline:
        outcome = call_api(system, "GET", f"/tasks/{task}")["view"]["outcome"]
        if outcome is not None:
            assert outcome == "accomplished"
            return
        time.sleep(0.3)
    raise AssertionError(f"{task} does not end")


def scene_position(page: Page, name: str) -> dict[str, float]:
    return dict(page.evaluate("name => somrsScene.where(name)", name))


def facts(system: RunningSystem) -> list[list[str]]:
    return [[fact["relation"], *fact["arguments"]] for fact in call_api(system, "GET", "/map")["facts"]]


def ground_distance(first: dict[str, float], second: dict[str, float]) -> float:
    return math.dist((first["x"], first["y"]), (second["x"], second["y"]))


TRACE = """() => {
    window.trace = [];
    const look = () => {
        const [one, two, jar] = ["Robot1", "Robot2", "Jar002"].map((name) => somrsScene.where(name));
        window.trace.push({ one, two, jar });
    };
    setInterval(look, 100);
}"""


def test_a_jar_is_seen_on_its_way_to_the_platform_by_all_who_look(system: RunningSystem, window: OpenWindow) -> None:
    if ["isOn", "Jar002", "Platform001"] in facts(system):
        await_success(system, submit_task(system, "Jar002 isOn Cupboard001"))
    pages = [open_page(system, window, SMALL), open_page(system, window, SMALL)]
    start = scene_position(pages[0], "Jar002")
    assert scene_position(pages[1], "Jar002") == pytest.approx(start, abs=0.005)
    for page in pages:
        page.evaluate(TRACE)
    await_success(system, submit_task(system, "Jar002 isOn Platform001"))
    for page in pages:
        page.wait_for_function("Math.hypot(somrsScene.where('Jar002').x - 8.2, somrsScene.where('Jar002').y - 2.5) < 0.5")
        expect(page.get_by_role("application")).to_have_attribute("aria-label", re.compile("2 robots"))
        wait_until_at_rest(page)
        jar = scene_position(page, "Jar002")
        assert jar["z"] == pytest.approx(0.3, abs=0.02), "it stands on the platform, which is 0.3 m high"
        trace = page.evaluate("window.trace")
        way = [frame for frame in trace if ground_distance(frame["jar"], start) > 0.7 and ground_distance(frame["jar"], jar) > 0.7]
        assert way, "the jar is seen on its way"
        assert all(min(ground_distance(frame["jar"], frame[robot]) for robot in ("one", "two")) < 0.4 for frame in way), (
            "as a robot carries it"
        )
        places = {tuple(frame[robot][axis] for robot in ("one", "two") for axis in "xy") for frame in trace}
        assert len(places) > 10, "the robot is seen on its way"
    assert scene_position(pages[0], "Jar002") == pytest.approx(scene_position(pages[1], "Jar002"), abs=0.005), "both see the same"
    take_screenshot(pages[0], "scene-jar-640-light")


MOTION_SCRIPT = """async ([late]) => {
    const { Motion } = await import("somrs-scene");
    const motion = new Motion();
    motion.set([{ name: "Robot1", numbers: 4 }]);
    // Poses of a robot that drives 1 m/s for 3 s and turns through the south, told at 20 Hz by another clock, some of them late.
    const told = [];
    for (let tick = 0; tick <= 60; tick++) {
        const clock = tick / 20;
        const yaw = Math.PI - 0.5 + clock / 3;
        const pose = [clock, 0, 0, yaw > Math.PI ? yaw - 2 * Math.PI : yaw];
        told.push({ clock, pose, at: 500 + clock + 0.002 + (tick % 9 === 4 ? late : 0) });
    }
    const steps = [];
    let last = null;
    for (let now = 500; now < 505; now += 1 / 60) {
        while (told.length && told[0].at <= now) {
            const { clock, pose } = told.shift();
            motion.hear(1000 + clock, [0], new Float32Array(pose), now);
        }
        motion.play(now, (name, pose) => {
            if (last) steps.push([pose[0] - last[0], Math.abs(Math.atan2(Math.sin(pose[3] - last[3]), Math.cos(pose[3] - last[3])))]);
            last = [...pose];
        });
    }
    return { steps, last, active: motion.active };
}"""


def test_robots_are_drawn_in_even_motion_between_poses(system: RunningSystem, window: OpenWindow) -> None:
    page = open_page(system, window, SMALL)
    for late in (0.0, 0.08):
        drawn = page.evaluate(MOTION_SCRIPT, [late])
        assert drawn["last"][0] == pytest.approx(3)
        assert not drawn["active"], "and when it stands, nothing is drawn"
        steady_steps = drawn["steps"][30:-10]  # once it knows how late poses come
        assert all(0 <= step <= 2.1 / 60 for step, _ in steady_steps), "it neither jumps nor goes back"
        assert sum(step > 0.3 / 60 for step, _ in steady_steps) > 0.8 * len(steady_steps), "nor stands between two poses"
        assert max(turn for _, turn in steady_steps) < 0.05, "it turns the short way"


def test_it_draws_only_when_something_changed(system: RunningSystem, window: OpenWindow) -> None:
    page = open_page(system, window, SMALL)
    wait_until_at_rest(page)
    frames = page.evaluate("somrsScene.frames()")
    page.wait_for_timeout(2000)
    assert page.evaluate("somrsScene.frames()") == frames


def screen_point(page: Page, name: str) -> tuple[float, float]:
    point = page.evaluate("name => somrsScene.at(name)", name)
    return point["x"], point["y"]


def test_the_camera_is_moved_by_keys_and_buttons(system: RunningSystem, window: OpenWindow) -> None:
    page = open_page(system, window, SMALL)
    wait_until_at_rest(page)
    view = page.get_by_role("application")
    middle = (view.bounding_box() or {"width": 0})["width"] / 2
    points_before = screen_point(page, "Cupboard001"), screen_point(page, "Shelf001")
    page.get_by_role("application").focus()

    def span() -> float:
        return math.dist(screen_point(page, "Cupboard001"), screen_point(page, "Shelf001"))

    page.keyboard.press("ArrowLeft")
    assert screen_point(page, "Cupboard001") != points_before[0]
    page.keyboard.press("ArrowRight")
    assert screen_point(page, "Cupboard001") == pytest.approx(points_before[0], abs=1)
    start_span = span()
    page.keyboard.press("+")
    assert span() > 1.1 * start_span
    page.keyboard.press("-")
    assert span() == pytest.approx(start_span, rel=0.01)
    page.keyboard.press("Shift+ArrowRight")
    assert screen_point(page, "Shelf001")[0] < points_before[1][0] - 10
    page.keyboard.press("f")
    page.wait_for_function(
        "([x, y]) => Math.hypot(somrsScene.at('Shelf001').x - x, somrsScene.at('Shelf001').y - y) < 2", arg=list(points_before[1])
    )
    page.get_by_role("button", name="From above").click()
    wait_until_at_rest(page)
    cupboard, shelf = screen_point(page, "Cupboard001"), screen_point(page, "Shelf001")
    assert cupboard[1] == pytest.approx(shelf[1], abs=12), "from above, what stands at the same y is at the same height"
    page.get_by_label("Follow").select_option("Robot1")
    page.wait_for_function("middle => Math.abs(somrsScene.at('Robot1').x - middle) < 3", arg=middle)


def test_things_are_chosen_by_clicking_and_found_by_their_names(system: RunningSystem, window: OpenWindow) -> None:
    page = open_page(system, window, SMALL)
    wait_until_at_rest(page)
    box = page.get_by_role("application").bounding_box()
    assert box is not None
    x, y = screen_point(page, "Platform001")
    page.mouse.click(box["x"] + x, box["y"] + y)
    card = page.locator(".somrs-scene-card")
    expect(card).to_contain_text("Platform001")
    expect(page.locator(".somrs-scene-label-selected")).to_have_text("Platform001")
    page.get_by_role("application").focus()
    page.keyboard.press("Escape")
    expect(card).to_have_count(0)
    page.get_by_role("button", name="List").click()
    places = page.get_by_role("region", name="Object list")
    expect(places.get_by_role("button", name="Robot2")).to_contain_text("in Laboratory")
    expect(places.get_by_role("button", name="Carton001")).to_contain_text("on Table002")
    page.get_by_label("Find by name or type").fill("shelf")
    places.get_by_role("button", name="Shelf001").click()
    expect(card).to_contain_text("Shelf001")
    expect(card).to_contain_text("in Store")


def test_a_broken_robot_is_labelled_as_such(system: RunningSystem, window: OpenWindow) -> None:
    page = open_page(system, window, SMALL)
    label = page.locator(".somrs-scene-label-robot", has_text="Robot2")
    expect(label).to_be_visible()
    call_api(system, "POST", "/fleet/Robot2/faults/gripper")
    try:
        expect(label).to_contain_text("gripper stuck")
        expect(page.get_by_role("application")).to_have_attribute("aria-label", re.compile("Robot2: .*gripper stuck"))
    finally:
        call_api(system, "POST", "/fleet/Robot2/faults/gripper?repair=true")
    expect(label).to_have_text("Robot2")


SOCKETS = """const Real = WebSocket;
window.sockets = [];
window.WebSocket = class extends Real {
    constructor(...how) {
        super(...how);
        window.sockets.push(this);
    }
};"""


def test_what_is_added_and_removed_is_seen_also_when_connections_are_lost(system: RunningSystem, window: OpenWindow) -> None:
    page = window("about:blank", SMALL)
    page.add_init_script(SOCKETS)
    open_scene(system, page)
    values = {"PositionX": 9.0, "PositionY": 5.0, "PositionZ": 0.0, "Shape.Form": "Box", "Shape.Width": 0.6, "Shape.Depth": 0.6}
    shelf = {"name": "Shelf009", "type": "Shelf", "values": {**values, "Shape.Height": 0.7}}
    call_api(system, "POST", "/map/changes", {"changes": [{"type": "ObjectAdded", "object": shelf}], "author": "Ada"})
    page.wait_for_function("somrsScene.where('Shelf009')?.x === 9")
    move = {"type": "ValueSet", "object": "Shelf009", "path": "PositionX", "value": 9.5}
    call_api(system, "POST", "/map/changes", {"changes": [move], "author": "Ada"})
    page.wait_for_function("somrsScene.where('Shelf009').x === 9.5")
    page.evaluate("sockets.filter((one) => one.url.includes('/api/')).forEach((one) => one.close())")
    call_api(system, "POST", "/map/changes", {"changes": [{"type": "ObjectRemoved", "name": "Shelf009"}], "author": "Ada"})
    page.wait_for_function("somrsScene.where('Shelf009') === null")
    call_api(system, "POST", "/fleet/Robot1/faults/gripper")
    label = page.locator(".somrs-scene-label-robot", has_text="Robot1")
    try:
        expect(label).to_contain_text("gripper stuck")
    finally:
        call_api(system, "POST", "/fleet/Robot1/faults/gripper?repair=true")
    expect(label).to_have_text("Robot1")
    expect(page.get_by_text("Reconnecting")).to_have_count(0)


def test_without_webgl_it_is_told_in_words(system: RunningSystem, window: OpenWindow) -> None:
    page = window(f"{system.url}/map", webgl=False)
    page.get_by_role("button", name="3D", exact=True).click()
    expect(page.get_by_role("alert")).to_contain_text("WebGL is missing")
    places = page.get_by_role("region", name="Object list")
    expect(places.get_by_role("button", name="Robot2")).to_contain_text("in Laboratory")


REPEATED_LOOK = pytest.param("1920", True, marks=pytest.mark.slow)
"""The others are of each color scheme, and of widths that have less room."""


@pytest.mark.parametrize(("size", "dark"), [("1280", False), ("820", True), REPEATED_LOOK])
def test_it_looks_good(system: RunningSystem, window: OpenWindow, size: str, dark: bool) -> None:
    page = open_page(system, window, size, dark=dark)
    wait_until_at_rest(page)
    view = page.get_by_role("application").bounding_box()
    assert view is not None
    for name in ("WallWest", "StoreWallEast", "WallNorth", "StoreWallSouth", "Robot1", "Jar003"):
        x, y = screen_point(page, name)
        assert 0 < x < view["width"], f"{name} is in the picture"
        assert 0 < y < view["height"], f"{name} is in the picture"
    boxes = [box for label in page.locator(".somrs-scene-label").all() if label.is_visible() and (box := label.bounding_box())]
    assert len(boxes) >= 8
    for i, first_box in enumerate(boxes):
        for second_box in boxes[i + 1 :]:
            apart_in_x = first_box["x"] + first_box["width"] <= second_box["x"] or second_box["x"] + second_box["width"] <= first_box["x"]
            apart_in_y = first_box["y"] + first_box["height"] <= second_box["y"] or second_box["y"] + second_box["height"] <= first_box["y"]
            assert apart_in_x or apart_in_y, "no name lies upon another"
    take_screenshot(page, f"scene-{size}-{'dark' if dark else 'light'}")
    if size == "1280":
        page.get_by_label("Follow").select_option("Robot1")
        page.get_by_role("button", name="Zoom in").click()
        wait_until_at_rest(page)
        take_screenshot(page, "scene-follow-1280-light")
