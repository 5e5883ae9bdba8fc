"""Both windows, from a new type and an object of it to an accomplished task; and a task that a broken robot does not prevent."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Page, expect

from somrs.devices.simulator.world.kinds import WorldKind

from .conftest import WORK_TIME, RunningSystem, resize, running_in, take_screenshot
from .test_define import field, middle
from .test_ontology import heading, new_type, row, save
from .test_scene import open_scene, scene_position
from .test_tasks import breaks_down, formula_holds, is_ended, jar_at_home, panel, wait_for_task

OpenPage = Callable[..., Page]
__all__ = ["jar_at_home"]


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningSystem]:
    """A system with all that a user has, physics included."""
    with running_in(tmp_path_factory.mktemp("whole"), world=WorldKind.PHYSICS) as running:
        yield running


def test_a_new_type_a_thing_of_it_and_a_task_with_it(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology", webgl=False)
    new_type(page, "Jar", "Vase")
    save(page)
    expect(heading(page, "Vase")).to_be_visible()

    page.goto(f"{system.url}/map")
    other_page = window(f"{system.url}/map")
    other_page.locator("[data-name=Table002]").first.wait_for(state="attached")
    page.get_by_role("tab", name="Add").click()
    page.get_by_role("searchbox", name="Find a type").fill("Vase")
    row(page, "Vase").click()
    expect(page.get_by_text("Click the new position")).to_be_visible()
    table = page.locator("[data-name=Table002]").first.bounding_box()
    assert table is not None
    page.mouse.click(table["x"] + 0.3 * table["width"], table["y"] + 0.7 * table["height"])
    dialog = page.get_by_role("dialog", name="New Vase")
    dialog.get_by_role("textbox", name="Name").fill("Vase001")
    dialog.get_by_role("button", name="Add").click()
    expect(dialog).to_be_hidden()
    expect(page.locator("[data-name=Vase001]").first).to_be_attached()
    expect(other_page.locator("[data-name=Vase001]").first).to_be_attached()
    other_page.close()
    assert formula_holds(system, "Vase001 isOn Table002")

    page.goto(f"{system.url}/define?effect=Vase001%20isOn%20Platform001")
    page.get_by_role("button", name="Start").click()
    page.wait_for_url("**/tasks/*")
    expect(page.get_by_text("Accomplished").first).to_be_visible(timeout=WORK_TIME)
    assert formula_holds(system, "Vase001 isOn Platform001")


@pytest.mark.slow  # `test_define`, `test_tasks` and `test_scene` have a test for each of its steps
@pytest.mark.usefixtures("jar_at_home")
def test_a_wish_that_is_dragged_comes_true_though_a_robot_breaks(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/define")
    drawn = page.locator(".somrs-define-plan [data-name=Jar002]").first
    drawn.wait_for(state="attached")
    drawn.scroll_into_view_if_needed()
    page.wait_for_load_state("networkidle")
    page.mouse.move(*middle(page, "Jar002"))
    page.mouse.down()
    page.mouse.move(*middle(page, "Platform001"), steps=8)
    page.mouse.up()
    expect(field(page)).to_have_value("Jar002 isOn Platform001")
    breaks_down(system, "Robot1", carried=1.5)
    page.get_by_role("button", name="Start").click()
    page.wait_for_url("**/tasks/*")
    task = page.url.rpartition("/")[2]
    story = panel(page, "Story")
    resize(page, "640")
    expect(story).to_contain_text("Replacement", timeout=WORK_TIME)
    resize(page, "1280")
    take_screenshot(page, "task-recovering-1280-light")
    resize(page, "640")
    assert wait_for_task(system, task, is_ended)["view"]["outcome"] == "accomplished"
    expect(page.get_by_text("Accomplished").first).to_be_visible()
    resize(page, "1280")

    open_scene(system, page)
    page.wait_for_function(
        """() => {
            const at = somrsScene.where('Jar002');
            return at && Math.hypot(at.x - 8.2, at.y - 2.5) < 0.5 && Math.abs(at.z - 0.3) < 0.05;
        }"""
    )
    assert scene_position(page, "Jar002")["z"] == pytest.approx(0.3, abs=0.05)
    take_screenshot(page, "map-3d-delivered-1280-light")
