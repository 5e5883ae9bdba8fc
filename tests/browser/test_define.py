"""New task: a goal is written, chosen or dragged, previewed, and accomplished."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.support.paths import SCENARIO_1

from .conftest import RunningSystem, every_look, fits, resize, slow_network, take_screenshot, wait_until_still


def call_api(system: RunningSystem, method: str, path: str, body: object | None = None) -> Any:
    content = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(f"{system.url}/api{path}", content, {"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def change_map(system: RunningSystem, *changes: dict[str, Any]) -> None:
    call_api(system, "POST", "/map/changes", {"changes": [*changes], "author": "a test"})


@pytest.fixture
def open_page(system: RunningSystem, window: Callable[..., Page]) -> Callable[..., Page]:
    def open_(size: str = "1280", *, effect: str = "", dark: bool = False, may_reload: bool = False) -> Page:
        query = f"?effect={quote(effect)}" if effect else ""
        page = window(f"{system.url}/define{query}", size, dark=dark, may_reload=may_reload, webgl=False)
        page.locator("[data-name=Jar003]").first.wait_for(state="attached")
        return page

    return open_


def field(page: Page) -> Locator:
    return page.get_by_role("textbox", name="Formula")


def write(page: Page, text: str) -> None:
    field(page).fill(text)
    page.keyboard.press("Escape")
    expect(page.get_by_text("The formula is valid.")).to_be_visible()


def middle(page: Page, name: str) -> tuple[float, float]:
    """Where a thing is on the plan, once it stays there: a page that is being made shifts."""
    drawn = page.locator(f".somrs-define-plan [data-name={name}]").first
    wait_until_still(drawn)
    box = drawn.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


# The formula


def test_a_formula_is_written_with_what_is_offered(open_page: Callable[..., Page]) -> None:
    page = open_page()
    field(page).focus()
    page.keyboard.type("jar", delay=30)
    offered = page.get_by_role("listbox", name="Completions")
    expect(offered.get_by_role("option")).to_have_count(2)
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    expect(offered.get_by_role("option", name="isOn")).to_be_visible()
    page.keyboard.type("iso", delay=30)
    expect(offered.get_by_role("option")).to_have_count(1)
    page.keyboard.press("Tab")
    page.keyboard.type("plat", delay=30)
    expect(offered.get_by_role("option")).to_have_count(1)
    take_screenshot(page, "define-completion-1280-light")
    expect(field(page)).to_have_attribute("aria-invalid", "false")  # a word that is being completed is not wrong yet
    page.keyboard.press("Enter")
    expect(field(page)).to_have_value("Jar003 isOn Platform001 ")
    page.keyboard.press("Escape")
    expect(offered).to_be_hidden()
    expect(page.get_by_text("The formula is valid.")).to_be_visible()
    expect(page.get_by_role("combobox", name="Related object")).to_have_value("Platform001")


def test_what_is_wrong_is_underlined_and_can_be_mended(open_page: Callable[..., Page]) -> None:
    page = open_page()
    field(page).fill("Jar003 isOm Platform001\nAND Jar9 isOn Table001 AND")
    page.keyboard.press("Escape")
    wrong = page.locator(".somrs-fe-wrong")
    expect(wrong).to_have_text(["isOm", "Jar9", "\u00a0"])
    message = page.locator(".somrs-fe-said").first
    expect(message).to_contain_text("there is no relation isOm; did you mean isOn?")
    expect(message).to_contain_text("there is no object Jar9 on the map")
    expect(field(page)).to_have_attribute("aria-invalid", "true")
    take_screenshot(page, "define-mistakes-1280-light")
    page.get_by_role("button", name="Write isOn instead").click()
    expect(field(page)).to_have_value("Jar003 isOn Platform001\nAND Jar9 isOn Table001 AND")
    expect(wrong).to_have_text(["Jar9", "\u00a0"])
    # What was mended can be taken back by the keyboard, as in any field.
    page.keyboard.press("Control+z")
    expect(field(page)).to_have_value("Jar003 isOm Platform001\nAND Jar9 isOn Table001 AND")


def test_a_thing_that_goes_while_one_writes_is_missed_at_once(system: RunningSystem, open_page: Callable[..., Page]) -> None:
    page = open_page()
    cup = {"name": "Cup77", "type": "Cup", "values": {"PositionX": 4.0, "PositionY": 2.2, "PositionZ": 0.74}}
    change_map(
        system,
        {"type": "ObjectAdded", "object": cup},
        {"type": "FactAdded", "fact": {"relation": "isPartOf", "arguments": ["Cup77", "Building001"]}},
    )
    write(page, "Cup77 isOn Platform001")
    change_map(system, {"type": "ObjectRemoved", "name": "Cup77"})
    expect(page.locator(".somrs-fe-wrong")).to_have_text(["Cup77"])
    expect(page.locator(".somrs-fe-said").first).to_contain_text("there is no object Cup77 on the map")
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_text("The goal is not valid: there is no object Cup77 on the map")).to_be_visible()
    expect(field(page)).to_have_value("Cup77 isOn Platform001")
    assert page.url.endswith("/define")


def test_quantifiers_are_completed_and_shown_as_text(open_page: Callable[..., Page]) -> None:
    page = open_page()
    field(page).focus()
    page.keyboard.type("FORALL ?ja", delay=30)
    offered = page.get_by_role("listbox", name="Completions")
    expect(offered.get_by_role("option", name="?Jar: Jar")).to_be_visible()
    page.keyboard.press("Enter")
    expect(field(page)).to_have_value("FORALL ?Jar: Jar (")
    page.keyboard.type("NOT ?Jar isOn Table001)", delay=10)
    page.keyboard.press("Escape")
    expect(page.get_by_text("The formula is valid.")).to_be_visible()
    expect(page.get_by_text("This formula cannot be shown as lines")).to_be_visible()
    expect(page.locator(".somrs-fe-back .somrs-fe-keyword").first).to_have_text("FORALL")
    take_screenshot(page, "define-quantifier-1280-light")


def test_a_goal_that_no_service_brings_about_is_said_before_it_is_submitted(open_page: Callable[..., Page]) -> None:
    page = open_page()
    field(page).fill("Chair001 isOn Platform001")
    page.keyboard.press("Escape")
    message = page.locator(".somrs-fe-hindrance")
    expect(message).to_contain_text("The formula is valid, but no service on offer brings about Chair001 isOn Platform001")
    expect(message).to_contain_text("and Chair001 is a")
    take_screenshot(page, "define-unachievable-1280-light")


def test_a_goal_whose_condition_nobody_can_meet_is_said_with_what_would_do(open_page: Callable[..., Page]) -> None:
    page = open_page()
    field(page).fill("Jar003 isOn Chair001")
    page.keyboard.press("Escape")
    message = page.locator(".somrs-fe-hindrance")
    expect(message).to_contain_text("The formula is valid, but no service on offer brings about Jar003 isOn Chair001")
    expect(message).to_contain_text("TransferObject and TakeOutOf need Chair001.Supporting = TRUE, and it is FALSE, by default for a Chair")
    expect(message).to_contain_text("it holds for Cupboard001")
    expect(page.get_by_text("The formula is valid.")).to_be_hidden()
    take_screenshot(page, "define-condition-1280-light")
    page.get_by_role("button", name="Preview", exact=True).click()
    expect(page.get_by_text("No plan is possible now")).to_be_visible()
    expect(page.get_by_text("Supporting: whether things can be put on it").last).to_be_visible()


def test_a_goal_that_holds_needs_nothing(open_page: Callable[..., Page]) -> None:
    page = open_page(effect="NOT EXISTS ?Jar: Jar (?Jar isOn Chair001)")
    page.get_by_role("button", name="Preview", exact=True).click()
    expect(page.get_by_text("The goal already holds: nothing needs to be done.")).to_be_visible()
    expect(page.get_by_text("No plan is possible now")).to_be_hidden()


# By choosing


def choose(page: Page, label: str, typed: str, number: int = 0) -> None:
    box = page.get_by_role("combobox", name=label, exact=True).nth(number)
    box.click()
    page.keyboard.type(typed, delay=20)
    expect(page.locator(".somrs-pick .somrs-fe-chosen:visible")).to_contain_text(typed, ignore_case=True)
    page.keyboard.press("Enter")


def test_lines_and_the_formula_stay_in_step(open_page: Callable[..., Page]) -> None:
    page = open_page()
    choose(page, "Thing", "Jar003")
    choose(page, "Related object", "Platform001")
    expect(field(page)).to_have_value("Jar003 isOn Platform001")
    page.get_by_role("button", name="Add a line").click()
    choose(page, "Thing", "Door001", 1)
    choose(page, "Property", "Open", 1)
    choose(page, "Value", "TRUE")
    page.get_by_role("button", name="Add a line").click()
    choose(page, "Thing", "Robot1", 2)
    choose(page, "Property", "Charge", 2)
    choose(page, "Comparison", ">=", 1)
    page.get_by_role("textbox", name="Value").fill("20")
    expect(field(page)).to_have_value("Jar003 isOn Platform001\nAND Door001.Open = TRUE\nAND Robot1.Charge >= 20 %")
    take_screenshot(page, "define-lines-1280-light")
    # And the other way round.
    field(page).fill("NOT Jar002 isHeldBy Robot2")
    page.keyboard.press("Escape")
    expect(page.get_by_role("combobox", name="Thing")).to_have_count(1)
    expect(page.get_by_role("combobox", name="Related object")).to_have_value("Robot2")
    negation = page.get_by_role("checkbox", name="Must not hold")
    expect(negation).to_be_checked()
    negation.click()
    expect(field(page)).to_have_value("Jar002 isHeldBy Robot2")
    negation.click()
    expect(field(page)).to_have_value("NOT Jar002 isHeldBy Robot2")
    negation.hover()
    expect(page.get_by_role("tooltip")).to_contain_text("Negation: the goal is that this condition is false")
    field(page).fill("Jar002 isOn Table001 OR Jar002 isOn Table002")
    expect(page.get_by_text("cannot be shown as lines")).to_be_visible()
    field(page).fill("Jar002 isOn Table001")
    expect(page.get_by_role("combobox", name="Related object")).to_have_value("Table001")


def test_what_is_typed_while_the_lines_change_the_formula_stays(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.add_init_script(slow_network(300))
    page.reload()
    choose(page, "Thing", "Jar003")
    choose(page, "Related object", "Platform001")
    field(page).fill("NOT Jar002 isHeldBy Robot2")
    expect(page.get_by_role("combobox", name="Related object")).to_have_value("Robot2")
    page.wait_for_timeout(1500)  # all that was on the way has arrived
    expect(field(page)).to_have_value("NOT Jar002 isHeldBy Robot2")
    expect(page.get_by_role("combobox", name="Related object")).to_have_value("Robot2")


def test_choices_that_come_late_are_offered_in_the_open_list(system: RunningSystem, open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.get_by_role("combobox", name="Thing").fill("Door001")
    expect(page.locator(".somrs-pick .somrs-fe-chosen:visible")).to_contain_text("Door001")
    with system.paused("gui"):
        page.keyboard.press("Enter")
        page.get_by_role("combobox", name="Property").click()
        page.keyboard.type("open")
    page.get_by_role("option", name="Open", exact=False).first.click()
    expect(page.get_by_role("combobox", name="Comparison")).to_be_visible()


# On the plan


def test_a_thing_is_dragged_to_where_it_is_to_be_and_gets_there(system: RunningSystem, open_page: Callable[..., Page]) -> None:
    page = open_page()
    jar, platform = middle(page, "Jar003"), middle(page, "Platform001")
    page.mouse.move(*jar)
    page.mouse.down()
    page.mouse.move(*platform, steps=8)
    take_screenshot(page, "define-drag-1280-light")
    page.mouse.up()
    expect(field(page)).to_have_value("Jar003 isOn Platform001")
    page.get_by_role("button", name="Start").click()
    page.wait_for_url("**/tasks/*")
    expect(page.get_by_text("Accomplished").first).to_be_visible()
    rows = call_api(system, "GET", f"/map/query?formula={quote('Jar003 isOn Platform001')}")["rows"]
    assert len(rows) == 1


def test_pointing_at_a_thing_and_then_at_a_place_says_the_same(open_page: Callable[..., Page]) -> None:
    page = open_page("820")
    page.mouse.click(*middle(page, "Carton001"))
    expect(page.get_by_role("combobox", name="Thing")).to_have_value("Carton001")
    page.mouse.click(*middle(page, "Shelf001"))
    expect(field(page)).to_have_value("Carton001 isOn Shelf001")


def drag(page: Page, thing: str, target: str) -> None:
    start, end = middle(page, thing), middle(page, target)
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=8)
    page.mouse.up()


def test_what_is_dragged_is_not_added_to_an_earlier_draft_in_silence(open_page: Callable[..., Page]) -> None:
    page = open_page()
    write(page, "Carton001 isOn Shelf001")
    earlier = page.get_by_role("status").filter(has_text="earlier draft")
    expect(earlier).to_be_hidden()
    page.reload()
    expect(earlier).to_be_visible()
    for look in ("1280", "390"):
        resize(page, look)
        take_screenshot(page, f"define-earlier-draft-{look}")
        assert fits(page)
    resize(page, "1280")
    page.locator("[data-name=Jar003]").first.wait_for(state="attached")
    drag(page, "Jar003", "Platform001")
    dialog = page.get_by_role("alertdialog")
    expect(dialog).to_contain_text("Carton001 isOn Shelf001")
    take_screenshot(page, "define-replace-or-add-1280")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_be_hidden()
    expect(field(page)).to_have_value("Carton001 isOn Shelf001")
    drag(page, "Jar003", "Platform001")
    dialog.get_by_role("button", name="Replace the goal").click()
    expect(field(page)).to_have_value("Jar003 isOn Platform001")
    expect(earlier).to_be_hidden()
    drag(page, "Carton001", "Shelf001")  # the second part of the user's own goal: nothing to decide
    expect(field(page)).to_have_value("Jar003 isOn Platform001\nAND Carton001 isOn Shelf001")
    page.reload()
    page.locator("[data-name=Jar002]").first.wait_for(state="attached")
    expect(earlier).to_be_visible()
    drag(page, "Jar002", "Table002")
    dialog.get_by_role("button", name="Add to the goal").click()
    expect(field(page)).to_have_value("Jar003 isOn Platform001\nAND Carton001 isOn Shelf001\nAND Jar002 isOn Table002")
    page.reload()
    earlier.get_by_role("button", name="Start a new draft").click()
    expect(field(page)).to_have_value("")
    expect(earlier).to_be_hidden()


NAMES = {"Jar002": "Mug9", "Jar003": "Mug10", "Cupboard001": "Locker9", "Platform001": "Deck9", "Table001": "Desk9", "Table002": "Desk10"}


@pytest.fixture
def other_site(tmp_path: Path) -> Iterator[RunningSystem]:
    """The scenario with other names."""
    text = SCENARIO_1.read_text(encoding="utf-8")
    for name, other_name in NAMES.items():
        text = text.replace(name, other_name)
    site = tmp_path / "site.yaml"
    site.write_text(text, encoding="utf-8")
    running = RunningSystem(tmp_path / "data", site)
    yield running
    running.stop()


def test_examples_name_objects_of_the_site(other_site: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(f"{other_site.url}/define")
    expect(field(page)).to_have_attribute("placeholder", "Carton001 isOn Deck9")
    page.get_by_text("Precondition").first.click()
    expect(page.get_by_role("textbox", name="Precondition")).to_have_attribute("placeholder", "Carton001 isOn Desk10")
    page.get_by_text("Handlers").first.click()
    page.get_by_role("button", name="Add a handler").click()
    effect = page.get_by_role("textbox", name="Make true")
    expect(effect).to_have_attribute("placeholder", "Carton001 isOn Deck9")
    choose(page, "Step type", "TransferObject")
    expect(effect).to_have_attribute("placeholder", "?Object isOn Deck9")
    expect(page.get_by_role("textbox", name="Only if")).to_have_attribute("placeholder", "?Object isOn Desk10")
    page.goto(f"{other_site.url}/map")
    page.get_by_role("tab", name="Find").click()
    expect(page.get_by_role("textbox", name="Query formula")).to_have_attribute("placeholder", "?Thing isOn Desk10")


# Beforehand


def test_a_preview_says_what_would_be_done_and_what_it_costs(open_page: Callable[..., Page]) -> None:
    page = open_page()
    write(page, "Carton001 isOn Shelf001")
    page.get_by_role("textbox", name="Formula").press("Control+Enter")
    plan = page.get_by_role("group", name="Plan preview")
    expect(plan).to_contain_text("TransferObject")
    expect(plan.get_by_text("Carton001, Shelf001")).to_have_count(1)
    quotes = page.get_by_role("table")
    expect(quotes.get_by_role("row", name="Robot1.TransferObject")).to_contain_text("10 EUR")
    expect(quotes.get_by_role("row", name="Robot1.TransferObject")).to_contain_text("Chosen")
    expect(quotes.get_by_role("row", name="Robot2.TransferObject")).to_contain_text("25 EUR")
    expect(quotes.get_by_role("row", name="Robot2.TransferObject")).to_contain_text("Not chosen")
    expect(page.locator(".somrs-define-totals")).to_contain_text("10 EUR")
    # Who wants it sooner gets another preview, and is told that this one is of another task.
    page.get_by_role("button", name="Soonest").click()
    expect(page.get_by_text("The task has changed since this preview.")).to_be_visible()
    page.get_by_role("button", name="Preview again").click()
    expect(page.locator(".somrs-define-totals")).to_contain_text("25 EUR")
    assert page.url.endswith("/define"), "nothing was started"


def test_what_is_done_before_the_page_is_connected_is_done_in_order(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.add_init_script(slow_network(1000))
    page.reload()
    field(page).focus()
    page.keyboard.type("Carton001 isOn Shelf001")
    page.keyboard.press("Control+Enter")
    expect(page.get_by_role("group", name="Plan preview").get_by_text("Carton001, Shelf001")).to_have_count(1)


def test_what_is_typed_into_a_list_is_chosen_although_its_choices_come_late(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.add_init_script(slow_network(1000))
    page.reload()
    for box, name in (("Thing", "Carton001"), ("Related object", "Shelf001")):
        page.get_by_role("combobox", name=box).click()
        page.keyboard.type(name)
        page.keyboard.press("Tab")
        expect(page.get_by_role("combobox", name=box)).to_have_value(name)
    expect(field(page)).to_have_value("Carton001 isOn Shelf001")


def test_an_impossible_wish_says_why(open_page: Callable[..., Page]) -> None:
    page = open_page()
    field(page).fill("Table001.Color = Red")
    page.get_by_role("button", name="Preview").click()
    refused = page.get_by_role("alert")
    expect(refused).to_contain_text("No plan is possible now")
    expect(refused).to_contain_text("Table001.Color = Red does not hold on the map, and no service type brings it about")
    expect(refused).to_contain_text("?Object isOn ?Destination")
    take_screenshot(page, "define-impossible-1280-light")


# Again


def test_a_template_is_kept_and_used(open_page: Callable[..., Page]) -> None:
    page = open_page()
    write(page, "Carton001 isOn Shelf001")
    page.get_by_role("button", name="Templates").click()
    page.get_by_text("Save this task as a template").click()
    page.get_by_role("textbox", name="Name").fill("To the store")
    page.get_by_role("checkbox", name="Carton001").click()
    choose(page, "Type for Carton001", "Graspable")
    take_screenshot(page, "define-template-1280-light")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.get_by_text("Template To the store saved.")).to_be_visible()
    page.get_by_role("button", name="Clear").click()
    expect(field(page)).to_have_value("")
    page.get_by_role("button", name="Templates").click()
    page.get_by_role("group", name="Templates").get_by_text("To the store").click()
    choose(page, "Graspable", "Jar002")
    page.get_by_role("button", name="Use it").click()
    expect(field(page)).to_have_value("Jar002 isOn Shelf001")
    expect(page.get_by_role("combobox", name="Thing")).to_have_value("Jar002")
    page.get_by_role("button", name="Templates").click()
    page.get_by_role("button", name="Remove the template To the store").click()
    page.get_by_role("button", name="Remove", exact=True).click()
    page.get_by_role("button", name="Templates").click()
    expect(page.get_by_text("There are none yet.")).to_be_visible()


def test_an_order_is_given_and_rests_and_goes(open_page: Callable[..., Page]) -> None:
    page = open_page()
    write(page, "Carton001 isOn Table002")
    choose(page, "When", "At intervals")
    page.get_by_role("textbox", name="Minutes").fill("0")
    page.get_by_role("textbox", name="Name of the order").fill("Tidy up")
    page.get_by_role("button", name="Create the order").click()
    expect(page.get_by_text("a number of minutes above 0, not 0")).to_be_visible()
    expect(field(page)).to_have_value("Carton001 isOn Table002")
    page.get_by_role("textbox", name="Minutes").fill("600")
    page.get_by_role("button", name="Create the order").click()
    order = page.get_by_role("region", name="Tidy up")
    expect(order).to_contain_text("every 10 h")
    page.get_by_role("button", name="Pause Tidy up").click()
    expect(order).to_contain_text("paused")
    page.get_by_role("button", name="Edit Tidy up").click()
    expect(field(page)).to_have_value("Carton001 isOn Table002")
    expect(page.get_by_role("button", name="Update the order")).to_be_visible()
    page.get_by_role("button", name="Remove Tidy up").click()
    page.get_by_role("button", name="Remove", exact=True).click()
    expect(order).to_be_hidden()


def test_a_list_follows_its_field_when_the_page_is_scrolled(open_page: Callable[..., Page]) -> None:
    page = open_page()
    when = page.get_by_role("combobox", name="When")
    when.click()
    choices = page.get_by_role("listbox", name="When")
    expect(choices).to_be_visible()
    # Less than the field is away from the edges, so that it stays in view.
    page.mouse.move(5, 400)
    position = page.evaluate("scrollY")
    page.mouse.wheel(0, 60)
    page.wait_for_function("position => scrollY !== position", arg=position)
    page.evaluate("new Promise(requestAnimationFrame)")
    expect(choices).to_be_visible()
    field_box, list_box = when.bounding_box(), choices.bounding_box()
    assert field_box is not None
    assert list_box is not None
    gap = min(abs(list_box["y"] - field_box["y"] - field_box["height"]), abs(field_box["y"] - list_box["y"] - list_box["height"]))
    assert gap < 10
    page.get_by_role("option", name="At intervals").click()
    expect(page.get_by_role("textbox", name="Minutes")).to_be_visible()


def test_completions_can_be_scrolled(open_page: Callable[..., Page]) -> None:
    page = open_page()
    field(page).focus()
    page.keyboard.type("a", delay=30)
    offered = page.get_by_role("listbox", name="Completions")
    expect(offered.get_by_role("option").nth(12)).to_be_attached()
    offered.hover()
    page.mouse.wheel(0, 120)
    page.wait_for_function("list => list.scrollTop > 0", arg=offered.element_handle())
    page.evaluate("new Promise(requestAnimationFrame)")
    expect(offered).to_be_visible()


def test_a_link_opens_the_page_with_a_goal(open_page: Callable[..., Page]) -> None:
    page = open_page(effect="Carton001 isOn Shelf001")
    expect(field(page)).to_have_value("Carton001 isOn Shelf001")
    expect(page.get_by_role("combobox", name="Related object")).to_have_value("Shelf001")


def test_what_was_typed_at_once_outlives_a_reload(system: RunningSystem, window: Callable[..., Page]) -> None:
    page = window(f"{system.url}/define")
    field(page).fill("Carton001 isOn Shelf001")
    page.reload()
    expect(field(page)).to_have_value("Carton001 isOn Shelf001")


def test_an_earlier_draft_does_not_replace_what_somebody_types(open_page: Callable[..., Page]) -> None:
    page = open_page()
    write(page, "Carton001 isOn Shelf001")
    page.add_init_script(slow_network(1000))
    page.reload()
    field(page).click()  # once that is possible
    page.keyboard.press("End")
    page.keyboard.type(" AND")
    expect(field(page)).to_have_value("Carton001 isOn Shelf001 AND")
    expect(page.get_by_role("combobox", name="Related object")).to_have_value("Shelf001")
    expect(field(page)).to_have_value("Carton001 isOn Shelf001 AND")


def test_what_was_typed_outlives_the_server(system: RunningSystem, open_page: Callable[..., Page]) -> None:
    page = open_page(may_reload=True)
    write(page, "Carton001 isOn Shelf001")
    page.get_by_role("textbox", name="Deadline").fill("15")
    page.get_by_role("button", name="High").click()
    expect(page.get_by_text("cheapest, high priority, within 15 min")).to_be_visible()
    page.evaluate("window.thisPage = true")
    system.kill("gui")
    field(page).press("End")
    page.keyboard.type(" AND", delay=20)
    page.wait_for_function("!window.thisPage")
    expect(field(page)).to_have_value("Carton001 isOn Shelf001 AND")
    expect(page.get_by_role("textbox", name="Deadline")).to_have_value("15")
    expect(page.get_by_text("cheapest, high priority, within 15 min")).to_be_visible()


@pytest.mark.looks
def test_it_looks_as_it_should(open_page: Callable[..., Page]) -> None:
    page = open_page(effect="Carton001 isOn Shelf001")
    page.get_by_role("button", name="Preview").click()
    expect(page.locator(".somrs-define-graph svg")).to_be_visible()
    for look in every_look(page):
        page.get_by_role("button", name="Show all").click()
        page.evaluate("scrollTo(0, 0)")
        page.wait_for_timeout(400)
        take_screenshot(page, f"define-{look}")
        assert fits(page)
