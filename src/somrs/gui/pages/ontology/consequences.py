"""What would come of a change, shown before anything is done."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from somrs.api.affected import WordUse, WordUserKind
from somrs.api.ontology import Consequences
from somrs.gui.pages.ontology.changes import Changed, changed, on_map
from somrs.gui.pages.ontology.pieces import Word, cell, note, row, table, titled
from somrs.gui.pages.task_words import key, path
from somrs.ontology.naming import Renaming

USERS = {WordUserKind.TASK: "running task", WordUserKind.ORDER: "standing order", WordUserKind.TEMPLATE: "template"}

MOST = 100
"""So many lines are shown of one list."""


async def confirmed(title: str, verb: str, found: Consequences, renamed: Sequence[Renaming] = (), said: str = "") -> bool:
    """Show what would come of it, and let the person go on or back. What breaks a rule can only be gone back from."""
    possible = not found.broken
    with titled(title) as dialog, ui.card().classes("somrs-onto-dialog"):
        Word("h2", title)
        if said:
            note(said)
        with ui.element("div").classes("somrs-onto-dialog-body"):
            show(found, renamed)
        with ui.row().classes("somrs-onto-buttons"):
            ui.button("Go back", on_click=lambda: dialog.submit(False)).props("flat no-caps" + ("" if possible else " autofocus"))
            if possible:
                ui.button(verb, on_click=lambda: dialog.submit(True)).props("unelevated no-caps autofocus")
    answer = await dialog
    if not dialog.is_deleted:
        dialog.delete()
    return bool(answer)


def show(found: Consequences, renamed: Sequence[Renaming] = ()) -> None:
    """All consequences, into the current element."""
    if found.broken:
        _broken(found)
    if found.offers:
        with ui.element("section"):
            _heading("warning", f"{_count(len(found.offers), 'service')} on offer could not be planned with any more", "busy")
            with table("Service", "Device", "Why"):
                for offer in found.offers[:MOST]:
                    with row():
                        Word("td", offer.service)
                        Word("td", offer.provider)
                        Word("td", offer.problem)
    if found.affected:
        _affected(found.affected)
    revised = changed(found.revision, renamed) if not found.broken else []
    if revised:
        with ui.element("section"):
            _heading("edit_note", f"{_count(len(revised), 'definition')} {'changes' if len(revised) == 1 else 'change'}", "accent")
            revision(revised)
    if found.changes and not found.broken:
        with ui.element("section"):
            total = max(found.all_changes, len(found.changes))
            _heading("map", f"The map changes with it: {_count(total, 'change')}", "accent")
            with ui.element("ul"):
                for line in on_map(found.changes)[:MOST]:
                    Word("li", line)
    if not (found.broken or revised or found.changes or found.offers or found.affected):
        note("Nothing would change.")


def _broken(found: Consequences) -> None:
    total = max(found.all_broken, len(found.broken))
    with ui.element("section").props('role="alert"'):
        _heading("error", f"This cannot be: {_count(total, 'rule')} would be broken", "bad")
        with table("What would not conform", "Why", "Rule"):
            for one in found.broken[:MOST]:
                with row():
                    with cell():
                        Word("b", one.subject)
                        Word("div", one.section.removesuffix("s"), "somrs-soft")
                    with cell():
                        ui.label(one.message).classes("somrs-onto-pre" if "\n" in one.message else "")
                    Word("td", one.rule, "somrs-soft")
        if total > len(found.broken[:MOST]):
            note(f"and {total - len(found.broken[:MOST])} more")


def _affected(users: Sequence[WordUse]) -> None:
    """Who keeps words that would be gone, and what that means."""
    with ui.element("section"):
        _heading("warning", "Tasks, orders and templates use words that would be gone", "busy")
        with table("What", "Which", "Why"):
            for one in users[:MOST]:
                with row():
                    Word("td", USERS[one.user_kind])
                    with cell():
                        _user(one)
                    Word("td", str(one))
        if len(users) > MOST:
            note(f"and {len(users) - MOST} more")
        note(
            "They keep the words that they have. A task fails when it has to look at its formula again, and an order is refused when it is "
            "due. Change orders and templates on the page New task."
        )


def _user(one: WordUse) -> None:
    """A task by its wish, which leads to its page; that is another tab, for the dialog waits here."""
    if one.user_kind is WordUserKind.TASK:
        with ui.link(target=path(one.id), new_tab=True).classes("somrs-onto-way"):
            Word("code", one.name)
        Word("div", f"task {key(one.id)[:8]}", "somrs-soft")
    else:
        ui.label(one.name)


def revision(revised: Sequence[Changed]) -> None:
    """What changes in the ontology, definition by definition."""
    with ui.element("ul").classes("somrs-onto-changes"):
        for one in revised[:MOST]:
            with ui.element("li"):
                Word("span", one.section.one, "somrs-soft")
                Word("b", one.name if one.verb != "renamed" else f"{one.old_name} → {one.name}")
                Word("span", one.verb, f"somrs-onto-verb somrs-onto-{one.verb}")
                for difference in one.differences:
                    with ui.element("div").classes("somrs-onto-difference"):
                        Word("span", f"{difference.field}: ", "somrs-soft")
                        Word("del", difference.before or "nothing")
                        Word("span", " → ").props('aria-label="becomes"')
                        Word("ins", difference.after or "nothing")
        if len(revised) > MOST:
            Word("li", f"and {len(revised) - MOST} more")


def _heading(icon: str, text: str, colour: str) -> None:
    with Word("h3", "").classes(f"somrs-onto-heading somrs-onto-{colour}"):
        ui.icon(icon)
        Word("span", text)


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
