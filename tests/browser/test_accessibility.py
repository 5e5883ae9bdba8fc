"""Every page, with its dialogs, in light and dark, in a wide and in a narrow window: axe-core finds nothing, nothing is wider than the
window, and no column of a table is a few letters wide. And where the keyboard begins on a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Page, expect

from somrs.gui.shell import PAGE_LINKS
from tests.support.paths import ROOT

from .conftest import SCHEMES, RunningSystem, looks, resize, wait_until_still
from .test_define import write
from .test_tasks import breaks_down, call, carries, is_ended, message, panel, submit_task, wait_for_task

OpenPage = Callable[..., Page]

AXE = ROOT / "node_modules" / "axe-core" / "axe.min.js"
NOT_INSTALLED = "accessibility by axe-core, because it is not in node_modules; `make browser` installs it, where there are node and npm"

pytestmark = pytest.mark.looks

LOOKS = looks(("1280", "390"))

GOAL, IMPOSSIBLE_GOAL = "Jar002 isOn Platform001", "Shelf001 isOn Platform001"

FIND_VIOLATIONS = """async () => {
    const visible = [...document.querySelectorAll("body *")].map((element) => Number(element.checkVisibility())).join("");
    const page = visible + document.documentElement.outerHTML.replace(/[\\w-]+--(dark|light)\\b/g, "").replace(/\\s+/g, " ");
    const onlyLooksDiffer = page === window.checkedPage;
    window.checkedPage = page;
    const rulesOfLooks = ["color-contrast", "link-in-text-block", "scrollable-region-focusable", "target-size"];
    const rules = onlyLooksDiffer ? {runOnly: {type: "rule", values: rulesOfLooks}} : {};
    const {violations} = await axe.run(document, {resultTypes: ["violations"], preload: false, ...rules});
    return violations.flatMap(({id, impact, nodes}) => nodes.map(({target, failureSummary}) =>
        `${impact} ${id}: ${target.join(" ")}: ${failureSummary.replaceAll("\\n", " ")}`));
}"""
"""Without `preload`, axe does not read all style sheets again for a rule that is off by default. Where a page has the elements of the
one that was checked last, and the same of them are visible, the rules about colors and sizes are enough: they take half the time of all."""

FIND_NARROW_CELLS = """() => {
    const broken = (cell) => {
        const texts = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
        for (let text = texts.nextNode(); text; text = texts.nextNode())
            for (const {0: word, index} of text.data.matchAll(/[\\w.]+/g)) {
                const range = document.createRange();
                range.setStart(text, index);
                range.setEnd(text, index + word.length);
                if (new Set([...range.getClientRects()].map(({top}) => Math.round(top))).size > 1) return word;
            }
    };
    return [...document.querySelectorAll("td, th")]
        .filter((cell) => cell.checkVisibility() && cell.clientWidth < 150 && broken(cell))
        .map((cell) => `a column of ${cell.clientWidth} pixels breaks ${broken(cell)}`);
}"""
"""Cells with a word that takes several lines, though words of a table's cell have room for twenty letters elsewhere."""


def check_looks(page: Page) -> None:
    """Fail if something is wrong with the page as it is now, in one of the looks."""
    problems: list[str] = []
    has_schemes = page.locator("body.body--light, body.body--dark").count() > 0
    for size, scheme in LOOKS:
        if not has_schemes and scheme != SCHEMES[0]:
            continue  # it looks the same
        resize(page, size)
        page.emulate_media(color_scheme=scheme)
        if has_schemes:
            page.locator(f"body.body--{scheme}").wait_for()
        wait_until_still(page.get_by_role("main"))
        look_problems: list[str] = page.evaluate(FIND_NARROW_CELLS)
        width, room = page.evaluate("[document.scrollingElement.scrollWidth, window.innerWidth]")
        if width > room:
            look_problems.append(f"it is {width} pixels wide")
        if AXE.exists():
            if not page.evaluate("'axe' in window"):
                page.evaluate(AXE.read_text(encoding="utf-8"))
            look_problems += page.evaluate(FIND_VIOLATIONS)
        problems += [f"{size} {scheme}: {problem}" for problem in look_problems]
    resize(page, "1280")
    assert not problems, "\n".join(problems)


@pytest.fixture
def check() -> Iterator[Callable[[Page], None]]:
    """`check_looks`; without axe-core, the test is skipped when its other checks have passed."""
    yield check_looks
    if not AXE.exists():
        pytest.skip(NOT_INSTALLED)


Check = Callable[[Page], None]


@pytest.fixture(scope="module")
def ended_tasks(system: RunningSystem) -> Iterator[dict[str, str]]:
    """An accomplished task, in which a robot broke down and another took over, and a failed task, by their goals."""
    breaks_down(system, "Robot1", carried=1.5)
    tasks = {goal: submit_task(system, goal) for goal in (GOAL, IMPOSSIBLE_GOAL)}
    for task in tasks.values():
        wait_for_task(system, task, is_ended)
    yield tasks
    call(system, "/fleet/Robot1/faults/drive?repair=true", post=True)


def test_start(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(system.url)
    expect(page.get_by_text("Robot2")).to_be_visible()
    check(page)


def test_map(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/map")
    page.locator("[data-name=Jar002]").first.wait_for(state="attached")
    page.get_by_role("button", name="Legend").click()
    page.get_by_role("tab", name="Add").click()
    expect(page.get_by_role("searchbox", name="Find a type")).to_be_visible()
    check(page)
    page.get_by_role("button", name="Legend").click()
    page.get_by_role("tab", name="Changes").click()
    page.get_by_role("button", name="Links").click()
    expect(page.get_by_role("checkbox", name="isOn")).to_be_visible()
    check(page)


def test_map_with_an_object(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/map?object=Jar002")
    expect(page.get_by_role("heading", name="Jar002")).to_be_visible()
    page.get_by_text("History").last.click()
    check(page)
    page.get_by_role("button", name="Remove it").click()
    expect(page.get_by_role("alertdialog")).to_be_visible()
    check(page)


def test_map_in_three_dimensions(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/map?view=3d&object=Robot1", "640")
    page.wait_for_function("window.somrsScene?.drawn() && somrsScene.frames() > 0", polling=100)
    page.get_by_role("button", name="List").click()
    check(page)


def test_ontology(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/ontology?type=Jar")
    article = page.get_by_role("article")
    expect(article.get_by_role("heading", name="Jar", exact=True)).to_be_visible()
    check(page)
    page.get_by_role("button", name="Import").click()
    expect(page.get_by_role("dialog", name="Import definitions")).to_be_visible()
    check(page)
    page.keyboard.press("Escape")
    article.get_by_role("button", name="Rename").click()
    expect(page.get_by_role("dialog")).to_be_visible()
    check(page)
    page.keyboard.press("Escape")
    article.get_by_role("button", name="Edit").click()
    expect(page.get_by_role("form", name="Definition")).to_be_visible()
    check(page)


def test_ontology_with_a_service_type(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/ontology?service=TransferObject")
    expect(page.get_by_role("article").get_by_role("heading", name="TransferObject", exact=True)).to_be_visible()
    check(page)
    page.get_by_role("button", name="History").first.click()
    expect(page.get_by_role("dialog", name="History of the ontology")).to_be_visible()
    check(page)
    page.keyboard.press("Escape")
    page.get_by_role("article").get_by_role("button", name="Edit").click()
    expect(page.get_by_role("form", name="Definition")).to_be_visible()
    check(page)


def test_new_task_with_a_preview(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/define")
    page.locator("[data-name=Jar003]").first.wait_for(state="attached")
    for fold in page.locator(".somrs-define-fold [role=button]").all():
        fold.click()
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_role("alert").filter(has_text="Enter a goal first.")).to_be_visible()
    check(page)
    page.get_by_role("button", name="Close").click()
    write(page, "Jar003 isOn Platform001")
    page.get_by_role("button", name="Preview").click()
    expect(page.locator(".somrs-terms")).to_contain_text("Robot2")
    check(page)
    page.get_by_role("button", name="Templates").click()
    page.get_by_text("Save this task as a template").click()
    dialog = page.get_by_role("dialog", name="Save as a template")
    dialog.get_by_role("textbox", name="Name").fill("Bring the jar")
    check(page)
    dialog.get_by_role("button", name="Save").click()
    expect(dialog).to_be_hidden()
    page.get_by_role("button", name="Templates").click()
    expect(page.get_by_role("button", name="Remove the template Bring the jar")).to_be_visible()
    check(page)


def test_tasks(system: RunningSystem, window: OpenPage, check: Check, ended_tasks: dict[str, str]) -> None:
    page = window(f"{system.url}/tasks")
    expect(page.get_by_role("link", name=GOAL).first).to_be_visible()
    check(page)


def test_task_that_is_cancelled_under_way(system: RunningSystem, window: OpenPage, check: Check) -> None:
    task = submit_task(system, "Carton001 isOn Platform001")
    wait_for_task(system, task, carries)
    with system.paused("simulator"):
        page = window(f"{system.url}/tasks/{task}", "640", webgl=False)
        page.get_by_role("button", name="Floor plan").click()
        expect(message(page, "Execute")).to_have_count(1)
        check(page)
        page.get_by_role("button", name="Cancel this task").click()
        expect(page.get_by_role("dialog")).to_contain_text("is stopped")
        check(page)
    page.get_by_role("dialog").get_by_role("button", name="Cancel the task").click()
    wait_for_task(system, task, is_ended)
    expect(panel(page, "Story")).to_contain_text("Compensation")
    check(page)


def test_task_that_is_over(system: RunningSystem, window: OpenPage, check: Check, ended_tasks: dict[str, str]) -> None:
    page = window(f"{system.url}/tasks/{ended_tasks[GOAL]}", "640")
    message(page, "Failed").click()
    expect(page.get_by_role("region", name="The message")).to_be_visible()
    panel(page, "Plan").get_by_role("button", name="TransferObject").click()
    check(page)


def test_task_that_failed(system: RunningSystem, window: OpenPage, check: Check, ended_tasks: dict[str, str]) -> None:
    page = window(f"{system.url}/tasks/{ended_tasks[IMPOSSIBLE_GOAL]}", "640")
    expect(page.get_by_role("status").filter(has_text="No plan")).to_be_visible()
    page.get_by_role("button", name="Export").click()
    expect(page.get_by_role("menuitem", name="SVG")).to_be_visible()
    check(page)


def test_task_that_does_not_exist(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/tasks/12345678")
    expect(page.get_by_text("there is no task 12345678")).to_be_visible()
    check(page)


def test_fleet(system: RunningSystem, window: OpenPage, check: Check, ended_tasks: dict[str, str]) -> None:
    page = window(f"{system.url}/fleet")
    page.get_by_role("article", name="Robot1").get_by_role("button", name="Faults of Robot1").click()
    expect(page.get_by_role("menuitem", name="Repair the drive")).to_be_visible()
    check(page)


def test_history(system: RunningSystem, window: OpenPage, check: Check, ended_tasks: dict[str, str]) -> None:
    page = window(f"{system.url}/history")
    expect(page.get_by_role("link", name=GOAL).first).to_be_visible()
    check(page)
    page.get_by_label("Outcome", exact=True).click()
    expect(page.get_by_role("option", name="Failed")).to_be_visible()
    check(page)
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Export").click()
    expect(page.get_by_role("menuitem").first).to_be_visible()
    check(page)
    page.keyboard.press("Escape")
    page.get_by_label("Goal contains").fill("nothing of that kind")
    expect(page.get_by_text("No ended task matches these filters.")).to_be_visible()
    check(page)


def test_api(system: RunningSystem, window: OpenPage, check: Check) -> None:
    page = window(f"{system.url}/api/")
    query = page.locator(".opblock").filter(has_text="/map/query")
    query.locator(".opblock-summary-control").click()
    query.get_by_role("button", name="Try it out").click()
    query.get_by_placeholder("formula").fill("?Jar isOn Cupboard001")
    query.get_by_role("button", name="Execute").click()
    expect(query.get_by_text("Response body")).to_be_visible()
    check(page)


# The focus


def test_the_keyboard_begins_at_the_content_of_each_page(system: RunningSystem, window: OpenPage) -> None:
    page = window(system.url)
    for place in PAGE_LINKS:
        page.get_by_role("navigation", name="Pages", exact=True).get_by_role("link", name=place.label).press("Enter")
        page.wait_for_url(f"**{place.path}")
        expect(page.get_by_role("main", name=place.label)).to_be_focused()
        page.keyboard.press("Tab")
        assert page.get_by_role("main").evaluate("(main) => main !== document.activeElement && main.contains(document.activeElement)")
        assert page.evaluate("window.scrollY") == 0


def test_a_page_takes_the_focus_from_nobody(system: RunningSystem, window: OpenPage, ended_tasks: dict[str, str]) -> None:
    page = window("about:blank")
    page.add_init_script("""new MutationObserver((_, observer) => {
        const link = document.querySelector("nav a");
        if (link) [link.focus(), observer.disconnect()];
    }).observe(document, {childList: true, subtree: true})""")
    page.goto(f"{system.url}/tasks")
    expect(page.get_by_role("link", name=GOAL).first).to_be_visible()  # read after the script for the focus has run
    expect(page.get_by_role("link", name="SO-MRS")).to_be_focused()
