"""The consequences of a change of the ontology, shown for confirmation."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui import ui

from somrs.api.definition_uses import DefinitionUse, DefinitionUserKind
from somrs.api.ontology import Consequences
from somrs.gui.pages.ontology.changes import DefinitionChange, definition_changes, map_change_lines
from somrs.gui.pages.ontology.elements import TextTag, cell, note, row, table, titled_dialog
from somrs.gui.pages.task_text import task_path
from somrs.ontology.naming import Renaming
from somrs.protocol.messages.event_text import short_id

_USERS = {DefinitionUserKind.TASK: "running task", DefinitionUserKind.ORDER: "standing order", DefinitionUserKind.TEMPLATE: "template"}

LINE_LIMIT = 100
"""Limit of lines shown per list."""


async def confirm_change(
    title: str, verb: str, consequences: Consequences, renamings: Sequence[Renaming] = (), explanation: str = ""
) -> bool:
    """Show the consequences and ask for confirmation. A change that breaks a rule can only be cancelled. Returns whether it was
    confirmed."""
    possible = not consequences.broken
    with titled_dialog(title) as dialog, ui.card().classes("somrs-onto-dialog"):
        TextTag("h2", title)
        if explanation:
            note(explanation)
        with ui.element("div").classes("somrs-onto-dialog-body"):
            show_consequences(consequences, renamings)
        with ui.row().classes("somrs-onto-buttons"):
            ui.button("Cancel", on_click=lambda: dialog.submit(False)).props("flat no-caps" + ("" if possible else " autofocus"))
            if possible:
                ui.button(verb, on_click=lambda: dialog.submit(True)).props("unelevated no-caps autofocus")
    answer = await dialog
    if not dialog.is_deleted:
        dialog.delete()
    return bool(answer)


def show_consequences(consequences: Consequences, renamings: Sequence[Renaming] = ()) -> None:
    """Show all consequences in the current element."""
    if consequences.broken:
        _show_broken_rules(consequences)
    if consequences.offers:
        with ui.element("section"):
            _heading("warning", f"{_count(len(consequences.offers), 'service')} on offer could no longer be used in plans", "busy")
            with table("Service", "Device", "Why"):
                for offer in consequences.offers[:LINE_LIMIT]:
                    with row():
                        TextTag("td", offer.service)
                        TextTag("td", offer.provider)
                        TextTag("td", offer.problem)
    if consequences.affected:
        _show_affected(consequences.affected)
    revised = definition_changes(consequences.revision, renamings) if not consequences.broken else []
    if revised:
        with ui.element("section"):
            _heading("edit_note", f"{_count(len(revised), 'definition')} {'changes' if len(revised) == 1 else 'change'}", "accent")
            show_revision(revised)
    if consequences.changes and not consequences.broken:
        with ui.element("section"):
            total = max(consequences.all_changes, len(consequences.changes))
            _heading("map", f"The map changes with it: {_count(total, 'change')}", "accent")
            with ui.element("ul"):
                for line in map_change_lines(consequences.changes)[:LINE_LIMIT]:
                    TextTag("li", line)
    if not (consequences.broken or revised or consequences.changes or consequences.offers or consequences.affected):
        note("Nothing would change.")


def _show_broken_rules(consequences: Consequences) -> None:
    total = max(consequences.all_broken, len(consequences.broken))
    with ui.element("section").props('role="alert"'):
        _heading("error", f"Not possible: {_count(total, 'rule')} would be broken", "bad")
        with table("Subject", "Why", "Rule"):
            for broken_rule in consequences.broken[:LINE_LIMIT]:
                with row():
                    with cell():
                        TextTag("b", broken_rule.subject)
                        TextTag("div", broken_rule.section.removesuffix("s"), "somrs-soft")
                    with cell():
                        ui.label(broken_rule.message).classes("somrs-onto-pre" if "\n" in broken_rule.message else "")
                    TextTag("td", broken_rule.rule, "somrs-soft")
        if total > len(consequences.broken[:LINE_LIMIT]):
            note(f"and {total - len(consequences.broken[:LINE_LIMIT])} more")


def _show_affected(users: Sequence[DefinitionUse]) -> None:
    """The tasks, standing orders and templates that use removed names."""
    with ui.element("section"):
        _heading("warning", "Tasks, orders and templates use names that would be removed", "busy")
        with table("Kind", "Name", "Reason"):
            for affected in users[:LINE_LIMIT]:
                with row():
                    TextTag("td", _USERS[affected.user_kind])
                    with cell():
                        _show_user(affected)
                    TextTag("td", str(affected))
        if len(users) > LINE_LIMIT:
            note(f"and {len(users) - LINE_LIMIT} more")
        note(
            "They keep the old names. A task fails when its formula is evaluated again, and a standing order is refused when it is "
            "due. Change orders and templates on the page New task."
        )


def _show_user(affected: DefinitionUse) -> None:
    """A row for one user of a name. A task links to its page in a new tab, so that the dialog stays open."""
    if affected.user_kind is DefinitionUserKind.TASK:
        with ui.link(target=task_path(affected.id), new_tab=True).classes("somrs-onto-way"):
            TextTag("code", affected.name)
        TextTag("div", f"task {short_id(affected.id)}", "somrs-soft")
    else:
        ui.label(affected.name)


def show_revision(revised: Sequence[DefinitionChange]) -> None:
    """The changes of the ontology, one per definition."""
    with ui.element("ul").classes("somrs-onto-changes"):
        for change in revised[:LINE_LIMIT]:
            with ui.element("li"):
                TextTag("span", change.section.singular, "somrs-soft")
                TextTag("b", change.name if change.verb != "renamed" else f"{change.old_name} → {change.name}")
                TextTag("span", change.verb, f"somrs-onto-verb somrs-onto-{change.verb}")
                for difference in change.differences:
                    with ui.element("div").classes("somrs-onto-difference"):
                        TextTag("span", f"{difference.field}: ", "somrs-soft")
                        TextTag("del", difference.before or "nothing")
                        TextTag("span", " → ").props('aria-label="becomes"')
                        TextTag("ins", difference.after or "nothing")
        if len(revised) > LINE_LIMIT:
            TextTag("li", f"and {len(revised) - LINE_LIMIT} more")


def _heading(icon: str, text: str, colour: str) -> None:
    with TextTag("h3", "").classes(f"somrs-onto-heading somrs-onto-{colour}"):
        ui.icon(icon)
        TextTag("span", text)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
