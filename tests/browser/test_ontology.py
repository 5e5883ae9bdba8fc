"""The ontology's page: reading it, writing definitions, and doing so with others at the same time.

Each test makes definitions of its own, below types that the scenario does not use otherwise.
"""

from __future__ import annotations

import asyncio
import json
import re
import urllib.request
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import pytest
from playwright.sync_api import Locator, Page, expect

from somrs.protocol.messages.directory import Offer, Publish, Published, Retract, Retracted
from tests.support.device_client import device_client

from .conftest import WIDTHS, RunningSystem, every_look, fits, take_screenshot

OpenPage = Callable[..., Page]


def row(page: Page, name: str) -> Locator:
    """The definition in the tree."""
    return page.get_by_role("treeitem").filter(has=page.get_by_text(name, exact=True))


def heading(page: Page, text: str) -> Locator:
    return page.get_by_role("article").get_by_role("heading", name=text, exact=True)


def open_definition(page: Page, name: str) -> None:
    """Choose a definition in the tree."""
    row(page, name).click()
    expect(heading(page, name)).to_be_visible()


def open_list(page: Page, field: Locator) -> None:
    """Have the list of a field open."""
    field.click()
    page.get_by_role("option").first.wait_for()


def pick(page: Page, field: Locator, value: str) -> None:
    """Choose in a short list."""
    open_list(page, field)
    page.get_by_role("option", name=value).click()


def choose(page: Page, container: Locator, label: str, value: str) -> None:
    """Choose in a list by typing, as people do."""
    field = container.get_by_role("combobox", name=label)
    open_list(page, field)
    field.fill(value)
    page.get_by_role("option", name=value, exact=True).click()
    expect(page.get_by_role("option")).to_have_count(0)


def new_type(page: Page, parent: str, name: str) -> None:
    """Begin a type below another, with its name written."""
    open_definition(page, parent)
    page.get_by_role("button", name="New below").click()
    expect(heading(page, "New type")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill(name)


def save(page: Page) -> None:
    page.get_by_role("button", name="Save", exact=True).click()


def undo(page: Page, text: str = "") -> None:
    """Undo the last change, of which the dialog says this."""
    page.get_by_role("button", name="Undo", exact=True).click()
    dialog = page.get_by_role("dialog", name="Undo")
    expect(dialog).to_contain_text(text)
    dialog.get_by_role("button", name="Undo").click()
    expect(dialog).to_be_hidden()


def test_a_list_that_takes_long_to_have_a_size_is_shown(system: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(f"{system.url}/ontology")
    new_type(page, "Graspable", "Vase")
    form = page.get_by_role("form", name="Definition")
    form.get_by_role("button", name="Add default").click()
    page.evaluate("""() => {
        window.sizeless = document.head.appendChild(document.createElement("style"));
        sizeless.textContent = ".q-menu { display: none }";
    }""")
    form.get_by_role("combobox", name="Attribute").click()
    expect(page.locator(".q-menu")).to_be_attached()
    page.evaluate("new Promise((resolve) => setTimeout(resolve, 500))")  # Quasar has given up by then
    page.evaluate("sizeless.remove()")
    page.get_by_role("option", name="Shape.Form", exact=True).click()
    expect(form.get_by_role("combobox", name="Value")).to_be_visible()


def test_a_type_is_built_renamed_moved_and_all_of_it_undone(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology")
    new_type(page, "Graspable", "Vase")
    form = page.get_by_role("form", name="Definition")
    form.get_by_role("button", name="Make a new attribute").click()
    dialog = page.get_by_role("dialog", name="New attribute")
    dialog.get_by_role("textbox", name="Name").fill("Capacity")
    dialog.get_by_role("textbox", name="Unit").fill("litres of water")
    dialog.get_by_role("button", name="Save").click()
    expect(dialog.get_by_text("pint knows no unit litres of water")).to_be_visible()
    dialog.get_by_role("textbox", name="Unit").fill("l")
    dialog.get_by_role("textbox", name="At least").fill("0")
    dialog.get_by_role("button", name="Save").click()
    expect(dialog).to_be_hidden()
    expect(form.get_by_role("group", name="attribute 1").get_by_role("combobox")).to_have_value("Capacity")
    for index, (path, value) in enumerate(
        (("Shape.Form", "Cylinder"), ("Shape.Height", "30 cm"), ("Shape.Radius", "0.06"), ("Capacity", "2")), 1
    ):
        form.get_by_role("button", name="Add default").click()
        default = form.get_by_role("group", name=f"default {index}")
        choose(page, default, "Attribute", path)
        if path == "Shape.Form":
            pick(page, default.get_by_role("combobox", name="Value"), value)
        else:
            default.get_by_role("textbox", name="Value").fill(value)
    take_screenshot(page, "ontology-form-1280-light")
    save(page)
    expect(heading(page, "Vase")).to_be_visible()
    expect(page.get_by_role("row", name=re.compile("^Height"))).to_contain_text("0.3 m")
    expect(page.get_by_role("row", name=re.compile("^Capacity"))).to_contain_text("own")
    expect(page.get_by_role("row", name=re.compile("^Weight"))).to_contain_text("from PhysicalObject")

    page.get_by_role("article").get_by_role("button", name="Rename").click()
    page.get_by_role("textbox", name="New name").fill("Amphora")
    page.get_by_role("button", name="Continue").click()
    page.get_by_role("dialog").get_by_role("button", name="Rename").click()
    expect(heading(page, "Amphora")).to_be_visible()
    expect(row(page, "Vase")).to_have_count(0)

    page.get_by_role("article").get_by_role("button", name="Move", exact=True).click()
    choose(page, page.get_by_role("dialog"), "Below", "Plant")
    page.get_by_role("dialog").get_by_role("button", name="Move").click()
    page.get_by_role("dialog", name="Move Amphora below Plant").get_by_role("button", name="Move").click()
    expect(page.get_by_role("navigation", name="Ancestors")).to_contain_text("Plant")

    for text in ("Plant", "Vase", "Vase added", "Capacity"):
        undo(page, text)
    expect(row(page, "Vase")).to_have_count(0)
    page.get_by_role("button", name="History").first.click()
    history_dialog = page.get_by_role("dialog", name="History of the ontology")
    for index in range(4):
        expect(history_dialog.get_by_role("listitem").filter(has_text="version").nth(index)).to_contain_text("undid version")
    expect(history_dialog.get_by_text("Amphora").first).to_be_visible()
    take_screenshot(page, "ontology-history-1280-light")


def test_undoing_twice_goes_two_changes_back_however_quickly(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology")
    for name in ("Bowl", "Ewer"):
        new_type(page, "Graspable", name)
        save(page)
        expect(heading(page, name)).to_be_visible()
    page.get_by_role("button", name="Undo", exact=True).click()
    dialog = page.get_by_role("dialog", name="Undo")
    expect(dialog).to_contain_text("Ewer added")
    with system.paused("repository"):
        dialog.get_by_role("button", name="Undo").click()
        expect(dialog).to_be_hidden()
        page.get_by_role("button", name="Undo", exact=True).click()
        page.wait_for_timeout(300)  # so that the page asks for the history meanwhile, if it does
    expect(dialog).to_contain_text("Bowl added")
    dialog.get_by_role("button", name="Undo").click()
    expect(row(page, "Bowl")).to_have_count(0)
    expect(row(page, "Ewer")).to_have_count(0)


def test_what_is_wrong_in_a_form_is_said_where_it_is_and_nothing_is_lost(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Graspable")
    new_type(page, "Graspable", "Bowl")
    form = page.get_by_role("form", name="Definition")
    form.get_by_role("button", name="Add rule").click()
    rule = form.get_by_role("group", name="rule 1")
    pick(page, rule.get_by_role("combobox", name="Rule"), "a formula")
    formula = rule.get_by_role("textbox", name="Formula")
    formula.fill("?Self.Wieght < 2 kg AND ?Self.Color = Red")
    expect(rule.get_by_text("has no attribute Wieght").first).to_be_visible()
    expect(rule.locator(".somrs-fe-wrong")).to_contain_text("Wieght")
    form.get_by_role("button", name="Add default").click()
    default = form.get_by_role("group", name="default 1")
    choose(page, default, "Attribute", "Weight")
    default.get_by_role("textbox", name="Value").fill("3 m")
    save(page)
    expect(default.get_by_text("m cannot be expressed in kg")).to_be_visible()
    default.get_by_role("textbox", name="Value").fill("-300 g")
    save(page)
    expect(default.get_by_text("at least 0")).to_be_visible()
    expect(rule.get_by_role("alert")).to_contain_text("^")
    take_screenshot(page, "ontology-mistakes-1280-light")
    page.get_by_role("textbox", name="Name").fill("two words")
    default.get_by_role("textbox", name="Value").fill("300 g")
    formula.fill("?Self.Weight < 2 kg AND ?Self.Color = Red")
    save(page)
    expect(page.get_by_text("'two words' is not a name")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill("Jar")
    save(page)
    expect(page.get_by_text("Jar is the name of another type")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill("Bowl")
    # Another definition is looked at in between.
    open_definition(page, "Cup")
    page.get_by_role("button", name="new type Bowl").click()
    expect(formula).to_have_value("?Self.Weight < 2 kg AND ?Self.Color = Red")
    expect(default.get_by_role("textbox", name="Value")).to_have_value("300 g")
    save(page)
    expect(heading(page, "Bowl")).to_be_visible()
    page.get_by_role("article").get_by_role("button", name="Remove").click()
    page.get_by_role("dialog", name="Remove the type Bowl").get_by_role("button", name="Remove").click()
    expect(heading(page, "Graspable")).to_be_visible()
    expect(row(page, "Bowl")).to_have_count(0)


def test_what_is_in_use_is_not_removed_and_the_reasons_are_told(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Chair")
    page.get_by_role("article").get_by_role("button", name="Remove").click()
    dialog = page.get_by_role("dialog", name="Remove the type Chair")
    expect(dialog).to_contain_text("Not possible")
    for chair in ("Chair001", "Chair002", "Chair003"):
        expect(dialog.get_by_role("row", name=chair)).to_contain_text("Chair")
    expect(dialog.get_by_role("button", name="Remove")).to_have_count(0)
    take_screenshot(page, "ontology-refused-1280-light")
    dialog.get_by_role("button", name="Cancel").click()
    expect(row(page, "Chair")).to_be_visible()
    # What SO-MRS itself relies on cannot even be tried.
    page.goto(f"{system.url}/ontology?type=PhysicalObject")
    expect(page.get_by_role("article").get_by_role("button", name="Remove")).to_be_disabled()
    # Nor can be written what objects on the map do not obey; what was written stays.
    page.goto(f"{system.url}/ontology?type=Jar")
    page.get_by_role("button", name="Edit").click()
    page.get_by_role("button", name="Add attribute").click()
    attribute = page.get_by_role("group", name="attribute 1")
    choose(page, attribute, "Attribute", "Texture")
    attribute.get_by_role("checkbox").click()
    save(page)
    dialog = page.get_by_role("dialog", name="Jar cannot be saved like this")
    expect(dialog.get_by_role("row", name="Jar002")).to_contain_text("must have Texture")
    expect(dialog.get_by_role("row", name="Jar003")).to_contain_text("must have Texture")
    dialog.get_by_role("button", name="Cancel").click()
    expect(row(page, "Jar").get_by_label("Problem: Jar002: a Jar must have Texture")).to_be_visible()
    expect(attribute.get_by_role("combobox")).to_have_value("Texture")
    page.get_by_role("button", name="Discard").click()
    expect(heading(page, "Jar")).to_be_visible()
    expect(row(page, "Jar").get_by_role("img")).to_have_count(0)


@pytest.fixture
def with_users(system: RunningSystem) -> Iterator[str]:
    """A task that runs, an order and a template, all of which speak of platforms; the id of the task."""
    task = str(call(system, "POST", "/tasks", {"effect": "Jar002 isOn ?Place: Platform"})["task"])
    blanks = [{"name": "Thing", "type": "Jar"}, {"name": "Where", "type": "Platform"}]
    call(system, "PUT", "/templates/Bring%20it", {"task": {"effect": "{Thing} isOn {Where}"}, "blanks": blanks})
    values = {"Thing": "Jar002", "Where": "Platform001"}
    daily = {"type": "Daily", "at": "08:00"}
    order = call(system, "POST", "/orders", {"name": "Every morning", "when": daily, "template": "Bring it", "values": values})
    yield task
    call(system, "DELETE", f"/orders/{order['id']}")
    call(system, "DELETE", "/templates/Bring%20it")
    call(system, "POST", f"/tasks/{task}/cancel")


def call(system: RunningSystem, method: str, path: str, body: object = None) -> Any:
    data = json.dumps(body).encode() if body is not None else None
    with urllib.request.urlopen(
        urllib.request.Request(f"{system.url}/api{path}", data, {"Content-Type": "application/json"}, method=method)
    ) as answer:
        return json.loads(answer.read() or b"null")


def test_news_replaces_no_button_that_somebody_is_about_to_press(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Cup")
    remove_button = page.get_by_role("article").get_by_role("button", name="Remove")
    expect(remove_button).to_be_enabled()
    button_node = remove_button.element_handle()
    call(system, "POST", "/ontology/changes", {"definitions": {"types": [{"name": "Mug", "parent": "Cup"}]}})
    expect(row(page, "Mug")).to_be_visible()
    cup = {"name": "Cup78", "type": "Cup", "values": {"PositionX": 4.0, "PositionY": 2.2, "PositionZ": 0.74}}
    facts = [{"type": "FactAdded", "fact": {"relation": "isPartOf", "arguments": ["Cup78", "Building001"]}}]
    call(system, "POST", "/map/changes", {"changes": [{"type": "ObjectAdded", "object": cup}, *facts]})
    expect(page.get_by_role("article").get_by_role("link", name="Cup78")).to_be_visible()
    assert button_node.evaluate("node => node.isConnected")
    call(system, "POST", "/map/changes", {"changes": [{"type": "ObjectRemoved", "name": "Cup78"}]})
    call(system, "POST", "/ontology/changes", {"removed": [{"section": "types", "name": "Mug"}]})
    expect(row(page, "Mug")).to_have_count(0)
    expect(page.get_by_role("article").get_by_role("link", name="Cup78")).to_have_count(0)
    remove_button.click()
    page.get_by_role("dialog", name="Remove the type Cup").get_by_role("button", name="Cancel").click()


def test_renaming_tells_who_goes_on_using_the_old_word(system: RunningSystem, with_users: str, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Platform")
    page.get_by_role("article").get_by_role("button", name="Rename").click()
    page.get_by_role("textbox", name="New name").fill("Stand")
    page.get_by_role("button", name="Continue").click()
    dialog = page.get_by_role("dialog", name="Rename")
    expect(dialog).to_contain_text("Tasks, orders and templates use names that would be removed")
    task = with_users.rpartition(":")[2][:8]
    for user_kind, user_name in (("running task", task), ("standing order", "Every morning"), ("template", "Bring it")):
        line = dialog.get_by_role("row").filter(has=page.get_by_role("cell", name=user_kind, exact=True), has_text=user_name)
        expect(line).to_contain_text("it uses type Platform, which would be called Stand")
    for size in ("1280", "820"):
        page.set_viewport_size({"width": WIDTHS[size][0], "height": WIDTHS[size][1]})
        take_screenshot(page, f"ontology-affected-{size}-light")
        box = dialog.get_by_role("table").first.bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= WIDTHS[size][0]
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_be_hidden()
    expect(row(page, "Platform")).to_be_visible()


def test_two_people_write_the_same_type(system: RunningSystem, window: OpenPage) -> None:
    first = window(f"{system.url}/ontology?type=Cup")
    second = window(f"{system.url}/ontology?type=Cup")
    for page in (first, second):
        page.get_by_role("button", name="Edit").click()
        expect(heading(page, "Edit Cup")).to_be_visible()
    weight = first.get_by_role("group", name="default 4").get_by_role("textbox", name="Value")
    weight.fill("0.25")
    second.get_by_role("textbox", name="Description").fill("One drinks from it")
    for index, value in ((3, "0.12"), (4, "0.35")):
        second.get_by_role("group", name=f"default {index}").get_by_role("textbox", name="Value").fill(value)
    save(first)
    expect(heading(first, "Cup")).to_be_visible()
    banner = second.get_by_text("Another user changed this meanwhile.")
    expect(banner).to_be_visible()
    expect(second.get_by_role("article")).to_contain_text("Defaults: Weight: 0.3 → 0.25")
    take_screenshot(second, "ontology-two-people-1280-light")
    save(second)
    expect(second.get_by_role("article")).to_contain_text("Another user changed this meanwhile.")
    expect(second.get_by_role("textbox", name="Description")).to_have_value("One drinks from it")
    second.get_by_role("button", name="Merge their changes").click()
    expect(second.get_by_text("You both changed Defaults (Weight): your values are in the form")).to_be_visible()
    second.get_by_role("group", name="default 4").get_by_role("textbox", name="Value").fill("0.25")
    save(second)
    expect(heading(second, "Cup")).to_be_visible()
    expect(second.get_by_role("row", name=re.compile("^Weight"))).to_contain_text("0.25 kg")
    expect(second.get_by_role("row", name=re.compile("^Height"))).to_contain_text("0.12 m")
    # The first one sees it without doing anything.
    expect(first.get_by_role("article")).to_contain_text("One drinks from it")
    for _ in range(2):
        undo(first)
    expect(second.get_by_role("article")).not_to_contain_text("One drinks from it")


def test_a_type_is_dragged_below_another_and_another_window_sees_it(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Bottle")
    other_page = window(f"{system.url}/ontology?type=Bottle")
    expect(heading(other_page, "Bottle")).to_be_visible()
    row(page, "Bottle").drag_to(row(page, "Can"))
    dialog = page.get_by_role("dialog", name="Move Bottle below Can")
    expect(dialog).to_contain_text("Graspable")
    dialog.get_by_role("button", name="Move").click()
    for shown_page in (page, other_page):
        expect(shown_page.get_by_role("navigation", name="Ancestors")).to_contain_text("Can")
        expect(row(shown_page, "Bottle")).to_have_attribute("aria-level", "5")
    undo(page)
    expect(row(other_page, "Bottle")).to_have_attribute("aria-level", "4")


def test_what_is_typed_outlives_the_server(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Plant", may_reload=True)
    page.get_by_role("button", name="Edit").click()
    meaning = page.get_by_role("textbox", name="Description")
    expect(meaning).to_be_visible()
    page.get_by_role("button", name="Add default").click()
    choose(page, page.get_by_role("group", name="default 1"), "Attribute", "Weight")
    page.get_by_role("group", name="default 1").get_by_role("textbox", name="Value").fill("2")
    with system.without_program("gui"):
        meaning.fill("Grows in a pot")
        expect(page.get_by_text("Connection lost")).to_be_visible()
    expect(page.get_by_text("Connection lost")).to_be_hidden()
    expect(heading(page, "Edit Plant")).to_be_visible()
    expect(meaning).to_have_value("Grows in a pot")
    expect(page.get_by_role("group", name="default 1").get_by_role("combobox")).to_have_value("Weight")
    expect(page.get_by_role("group", name="default 1").get_by_role("textbox", name="Value")).to_have_value("2")
    save(page)
    expect(heading(page, "Plant")).to_be_visible()
    expect(page.get_by_role("article")).to_contain_text("Grows in a pot")
    expect(page.get_by_role("row", name=re.compile("^Weight"))).to_contain_text("2 kg")
    undo(page)
    expect(page.get_by_role("article")).not_to_contain_text("Grows in a pot")


WRONG = """ontology: kitchen
attributes:
  Material: {kind: enumeration, values: [Clay, Glass]}
types:
  Mug: {parent: Cup, attributes: [Materiel]}
"""


def test_a_file_is_taken_over_after_its_mistakes_are_mended(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology")
    page.get_by_role("button", name="Import").click()
    dialog = page.get_by_role("dialog", name="Import definitions")
    files = dialog.locator("input[type=file]")
    files.set_input_files({"name": "kitchen.yaml", "mimeType": "application/yaml", "buffer": WRONG.encode()})
    problem = dialog.get_by_role("row", name="Mug")
    expect(problem).to_contain_text("5")
    expect(problem).to_contain_text("Materiel")
    expect(problem).to_contain_text("did you mean Material?")
    expect(dialog.get_by_role("button", name="Import")).to_be_hidden()
    take_screenshot(page, "ontology-import-1280-light")
    corrected_text = WRONG.replace("Materiel", "Material")
    files.set_input_files({"name": "kitchen.yaml", "mimeType": "application/yaml", "buffer": corrected_text.encode()})
    expect(dialog).to_contain_text("2 definitions change")
    dialog.get_by_role("button", name="Import").click()
    expect(dialog).to_be_hidden()
    open_definition(page, "Mug")
    expect(page.get_by_role("row", name=re.compile("^Material"))).to_contain_text("one of Clay, Glass")
    page.get_by_role("button", name="Export").click()
    with page.expect_download() as download:
        page.get_by_text("YAML: without the upper ontology").click()
    written = download.value.path().read_text()
    assert "Mug:" in written
    assert "PhysicalObject:" not in written
    undo(page)
    expect(row(page, "Mug")).to_have_count(0)
    expect(page.get_by_role("article")).to_contain_text("There is no type of this name")


def test_the_tree_is_walked_and_found_in_by_keys(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Jar")
    expect(heading(page, "Jar")).to_be_visible()
    assert page.evaluate("document.querySelectorAll('.somrs-tree-row[tabindex=\"0\"]').length") == 1, "one row takes the focus"
    page.get_by_role("searchbox", name="Find types").focus()
    page.keyboard.type("robot")
    expect(page.get_by_role("treeitem", name="PatrolRobot")).to_be_visible()
    expect(page.get_by_role("treeitem", name="Wall")).to_have_count(0)
    page.keyboard.press("ArrowDown")
    expect(page.get_by_role("treeitem", name="MobileRobot")).to_be_focused()
    page.keyboard.press("End")
    expect(page.get_by_role("treeitem", name="CleaningRobot")).to_be_focused()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowUp")
    expect(page.get_by_role("treeitem", name="PatrolRobot")).to_be_focused()
    page.keyboard.press("Enter")
    expect(heading(page, "PatrolRobot")).to_be_visible()
    expect(page).to_have_url(f"{system.url}/ontology?type=PatrolRobot")
    page.get_by_role("searchbox", name="Find types").focus()
    page.keyboard.press("Escape")
    page.get_by_role("treeitem", name="PatrolRobot").focus()
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_role("treeitem", name="MobileRobot")).to_be_focused()
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_role("treeitem", name="PatrolRobot")).to_have_count(0)
    page.keyboard.type("cor")
    expect(page.get_by_role("treeitem", name="Corridor")).to_be_focused()
    page.go_back()
    expect(heading(page, "Jar")).to_be_visible()
    page.get_by_role("link", name="Graspable").first.click()
    expect(heading(page, "Graspable")).to_be_visible()


SHEETS = {
    "type=Jar": "Jar",
    "attribute=Weight": "Weight",
    "relation=isOn": "isOn",
    "function=range": "range",
    "service=TransferObject": "TransferObject",
}


def test_every_kind_of_definition_is_read(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology")
    for query, name in SHEETS.items():
        page.goto(f"{system.url}/ontology?{query}")
        expect(heading(page, name)).to_be_visible()
        expect(page.locator(".somrs-tree-picked")).to_contain_text(name)
    expect(page.get_by_role("article")).to_contain_text("?Object isOn ?Destination")
    take_screenshot(page, "ontology-service-1280-light")


@pytest.mark.looks
def test_sheet_and_form_fit_every_window(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?type=Jar")
    expect(heading(page, "Jar")).to_be_visible()
    for look in every_look(page):
        assert fits(page), "the sheet is wider than the window"
        take_screenshot(page, f"ontology-jar-{look}")
    page.get_by_role("button", name="Edit").click()
    expect(heading(page, "Edit Jar")).to_be_visible()
    for look in every_look(page):
        assert fits(page), "the form is wider than the window"
        take_screenshot(page, f"ontology-edit-{look}")


def test_news_leave_the_section_that_was_chosen_in_the_index(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology?service=TransferObject")
    expect(heading(page, "TransferObject")).to_be_visible()
    page.get_by_role("tab", name="Relations").click()
    expect(row(page, "isOn")).to_be_visible()
    call(system, "POST", "/ontology/changes", {"definitions": {"relations": [{"name": "faces", "joins": ["Object", "Object"]}]}})
    expect(row(page, "faces")).to_be_visible()  # the news has come
    call(system, "POST", "/ontology/changes", {"removed": [{"section": "relations", "name": "faces"}]})
    expect(row(page, "faces")).to_have_count(0)
    expect(row(page, "isOn")).to_be_visible()
    expect(heading(page, "TransferObject")).to_be_visible()


def test_attributes_relations_functions_and_services_are_written(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology")
    form = page.get_by_role("form", name="Definition")

    def new(tab: str, kind: str, name: str) -> None:
        page.get_by_role("tab", name=tab).click()
        page.get_by_role("button", name=f"New {kind}").click()
        expect(heading(page, f"New {kind}")).to_be_visible()
        form.get_by_role("textbox", name="Name").fill(name)

    new("Attributes", "attribute", "Filling")
    pick(page, form.get_by_role("combobox", name="Its values are"), "one of a list")
    form.get_by_role("textbox", name="Values").fill("Empty, Water")
    save(page)
    expect(heading(page, "Filling")).to_be_visible()
    expect(page.get_by_role("article")).to_contain_text("one of Empty, Water")

    new("Relations", "relation", "waters")
    choose(page, form, "First type", "Device")
    choose(page, form, "Second type", "Plant")
    save(page)
    expect(page.get_by_role("article")).to_contain_text("A waters B")

    new("Functions", "function", "thirst")
    pick(page, form.get_by_role("combobox", name="Its value"), "is a table")
    choose(page, form, "First type", "Plant")
    form.get_by_role("button", name="Add value").click()
    form.get_by_role("textbox", name="Of").fill("Palm")
    form.get_by_role("textbox", name="Value").fill("2 l")
    form.get_by_role("textbox", name="Unit").fill("l")
    save(page)
    expect(page.get_by_role("row", name="Palm")).to_contain_text("2")

    new("Services", "service type", "WaterPlant")
    form.get_by_role("button", name="Add input").click()
    form.get_by_role("textbox", name="Variable").fill("Plant")
    choose(page, form.get_by_role("group", name="input 1"), "Type", "Plant")
    effect = form.get_by_role("textbox", name="Effect")
    effect.fill("?Provider waters ?Plnt: Jar")
    save(page)
    expect(form.get_by_role("alert").filter(has_text="a Jar, and here a Plant is meant")).to_be_visible()
    effect.fill("?Provider waters ?Plant")
    effect.press("Escape")
    save(page)
    expect(heading(page, "WaterPlant")).to_be_visible()

    # Renaming goes everywhere; removing what is spoken of is refused.
    page.get_by_role("tab", name="Relations").click()
    open_definition(page, "waters")
    page.get_by_role("article").get_by_role("button", name="Remove").click()
    expect(page.get_by_role("dialog").get_by_role("row", name="WaterPlant")).to_contain_text("there is no relation waters")
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Edit").click()
    form.get_by_role("textbox", name="Name").fill("sprinkles")
    save(page)
    dialog = page.get_by_role("dialog", name="Save sprinkles: consequences")
    expect(dialog).to_contain_text("?Provider sprinkles ?Plant")
    take_screenshot(page, "ontology-consequences-1280-light")
    dialog.get_by_role("button", name="Save").click()
    expect(heading(page, "sprinkles")).to_be_visible()
    page.get_by_role("link", name="WaterPlant").click()
    expect(page.get_by_role("article")).to_contain_text("?Provider sprinkles ?Plant")
    for _ in range(5):
        undo(page)
    expect(row(page, "WaterPlant")).to_have_count(0)


def test_who_is_quicker_than_the_server_goes_on_typing_where_they_are(system: RunningSystem, window: OpenPage) -> None:
    page = window(f"{system.url}/ontology")
    page.get_by_role("tab", name="Functions").click()
    page.get_by_role("button", name="New function").click()
    form = page.get_by_role("form", name="Definition")
    pick(page, form.get_by_role("combobox", name="Its value"), "is a table")
    choose(page, form, "First type", "Plant")
    # Somebody whose hands go to the second field of the row the moment it is there, and stay there.
    page.evaluate(
        """() => new MutationObserver((_, watch) => {
            const field = document.querySelector('input[aria-label="Value"]');
            if (field) { field.focus(); watch.disconnect(); }
        }).observe(document.body, { childList: true, subtree: true })"""
    )
    form.get_by_role("button", name="Add value").click()
    value = form.get_by_role("textbox", name="Value")
    expect(value).to_be_focused()
    form.get_by_role("button", name="Add type").dispatch_event("click")  # what the server does now, it does after what it did before
    expect(form.get_by_role("combobox", name="Second type")).to_be_visible()
    expect(value).to_be_focused()
    page.keyboard.type("2 l")
    expect(value).to_have_value("2 l")
    form.get_by_role("button", name="Discard").click()


def run(work: Coroutine[Any, Any, None]) -> None:
    """Run a client's work in a thread of its own: Playwright has an event loop in this one."""
    with ThreadPoolExecutor() as threads:
        threads.submit(asyncio.run, work).result()


def test_a_service_type_shows_who_offers_it_and_whose_program_has_another_definition(system: RunningSystem, window: OpenPage) -> None:
    async def publish(*, again: bool) -> None:
        async with device_client(system.addresses, "OldArm") as client:
            transfer = (await client.ontology()).services["TransferObject"]
            old = msgspec.structs.replace(transfer, effect="?Object isIn ?Destination")
            offer = Offer(
                service="OldArm.TransferObject",
                provider="OldArm",
                provider_type="Device",
                address="https://127.0.0.1:9/devices/OldArm",
                service_type=old,
            )
            offers = (msgspec.structs.replace(offer, service_type=transfer if again else old),)
            await client.ask(client.addresses.registry, Publish(provider="OldArm", offers=offers, lease=600), Published)

    async def retract() -> None:
        async with device_client(system.addresses, "OldArm") as client:
            await client.ask(client.addresses.registry, Retract(provider="OldArm"), Retracted)

    run(publish(again=False))
    try:
        page = window(f"{system.url}/ontology?service=TransferObject")
        sheet = page.get_by_role("article")
        expect(sheet.get_by_role("link", name="Robot1")).to_be_visible()
        outdated = sheet.get_by_role("row", name="OldArm")
        expect(outdated).to_contain_text("its effect is ?Object isIn ?Destination, not ?Object isOn ?Destination")
        expect(outdated).to_contain_text("Robot1 and Robot2 offer it so")
        take_screenshot(page, "ontology-offered-by-1280-light")
        run(publish(again=True))
        expect(sheet.get_by_role("link", name="OldArm")).to_be_visible()
        expect(outdated).to_have_count(0)
    finally:
        run(retract())
