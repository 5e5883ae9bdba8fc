"""The ontology's page: reading it, writing definitions, and doing so with others at the same time.

Each test makes definitions of its own, below types that the scenario does not use otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect

from .conftest import Running, shoot

Open = Callable[..., Page]


def row(page: Page, name: str) -> Locator:
    """The definition in the tree."""
    return page.get_by_role("treeitem").filter(has=page.get_by_text(name, exact=True))


def heading(page: Page, text: str) -> Locator:
    return page.get_by_role("article").get_by_role("heading", name=text, exact=True)


def choose(page: Page, where: Locator, label: str, value: str) -> None:
    """Choose in a list by typing, as people do."""
    field = where.get_by_role("combobox", name=label)
    field.click()
    field.fill(value)
    page.get_by_role("option", name=value, exact=True).first.click()


def new_type(page: Page, parent: str, name: str) -> None:
    """Begin a type below another, with its name written."""
    row(page, parent).click()
    page.get_by_role("button", name="New below").click()
    expect(heading(page, "New type")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill(name)


def save(page: Page) -> None:
    page.get_by_role("button", name="Save", exact=True).click()


def test_a_type_is_built_renamed_moved_and_all_of_it_undone(system: Running, window: Open) -> None:
    page = window(f"{system.url}/ontology")
    new_type(page, "Graspable", "Vase")
    form = page.get_by_role("form", name="Definition")
    form.get_by_role("button", name="Make a new attribute").click()
    dialog = page.get_by_role("dialog", name="New attribute")
    dialog.get_by_role("textbox", name="Name").fill("Volume")
    dialog.get_by_role("textbox", name="Unit").fill("litres of water")
    dialog.get_by_role("button", name="Save").click()
    expect(dialog.get_by_text("pint knows no unit litres of water")).to_be_visible()
    dialog.get_by_role("textbox", name="Unit").fill("l")
    dialog.get_by_role("textbox", name="At least").fill("0")
    dialog.get_by_role("button", name="Save").click()
    expect(dialog).to_be_hidden()
    expect(form.get_by_role("group", name="attribute 1").get_by_role("combobox")).to_have_value("Volume")
    for index, (path, value) in enumerate((("Shape.Form", "Cylinder"), ("Shape.Height", "30 cm"), ("Shape.Radius", "0.06"), ("Volume", "2")), 1):
        form.get_by_role("button", name="Add default").click()
        default = form.get_by_role("group", name=f"default {index}")
        choose(page, default, "Attribute", path)
        if path == "Shape.Form":
            default.get_by_role("combobox", name="Value").click()
            page.get_by_role("option", name=value).click()
        else:
            default.get_by_role("textbox", name="Value").fill(value)
    shoot(page, "ontology-form-1280-light")
    save(page)
    expect(heading(page, "Vase")).to_be_visible()
    expect(page.get_by_role("row", name=re.compile("^Height"))).to_contain_text("0.3 m")
    expect(page.get_by_role("row", name=re.compile("^Volume"))).to_contain_text("own")
    expect(page.get_by_role("row", name=re.compile("^Weight"))).to_contain_text("from PhysicalObject")

    page.get_by_role("article").get_by_role("button", name="Rename").click()
    page.get_by_role("textbox", name="New name").fill("Amphora")
    page.get_by_role("button", name="Go on").click()
    page.get_by_role("dialog").get_by_role("button", name="Rename").click()
    expect(heading(page, "Amphora")).to_be_visible()
    expect(row(page, "Vase")).to_have_count(0)

    page.get_by_role("article").get_by_role("button", name="Move", exact=True).click()
    choose(page, page.get_by_role("dialog"), "Below", "Plant")
    page.get_by_role("dialog").get_by_role("button", name="Move").click()
    page.get_by_role("dialog", name="Move Amphora below Plant").get_by_role("button", name="Move").click()
    expect(page.get_by_role("navigation", name="Ancestors")).to_contain_text("Plant")

    for text in ("Plant", "Vase", "Vase added", "Volume"):
        page.get_by_role("button", name="Undo", exact=True).click()
        dialog = page.get_by_role("dialog", name="Undo")
        expect(dialog).to_contain_text(text)
        dialog.get_by_role("button", name="Undo").click()
        expect(dialog).to_be_hidden()
    expect(row(page, "Vase")).to_have_count(0)
    page.get_by_role("button", name="History").first.click()
    past = page.get_by_role("dialog", name="History of the ontology")
    expect(past.get_by_text("undone", exact=True)).to_have_count(4)
    expect(past.get_by_text("Amphora").first).to_be_visible()
    shoot(page, "ontology-history-1280-light")
