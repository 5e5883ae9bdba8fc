"""Task templates: a menu to use one with its blanks filled in, and a dialog to save the current task as one."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from somrs.errors import SomrsError
from somrs.gui.author import author
from somrs.gui.components.confirm_dialog import confirm
from somrs.gui.components.fields.picker import Choice, Picker, things
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.news import follow
from somrs.gui.pages.define.blanks import mentioned_things, propose_blank_names, replace_with_blanks, types_of
from somrs.gui.pages.define.form import Form
from somrs.gui.shell import guarded, notify
from somrs.protocol.messages.orders import Blank, Filled, Template, TemplateSaved


class TemplateMenu:
    def __init__(self, form: Form) -> None:
        self._form = form
        self._templates: tuple[Template, ...] = ()
        self._dialog = ui.dialog()
        with (
            ui.button("Templates", icon="bookmarks").props("flat dense no-caps"),
            ui.menu().props('role="group" aria-label="Templates"').classes("somrs-define-menu") as self._menu,
        ):
            self._list = ui.element("div").classes("somrs-define-templates")
            ui.separator()
            ui.menu_item("Save this task as a template", on_click=guarded(self._save_as_template)).props("role=button").classes(
                "somrs-define-keep"
            )
        follow(form.api.context.hub, "templates", self._read, lambda _: self._read())

    async def _read(self) -> None:
        try:
            self._templates = (await self._form.api.orders.templates()).templates
        except SomrsError:
            self._templates = ()
        self._list.clear()
        with self._list:
            if not self._templates:
                ui.label("There are none yet. You can save the current task as one.").classes("somrs-soft somrs-define-empty")
            for template in self._templates:
                self._row(template)

    def _row(self, template: Template) -> None:
        with ui.element("div").classes("somrs-define-template"):
            use = ui.menu_item(on_click=partial(guarded(self._use), template)).props("role=button")
            use.classes("somrs-define-template-use")
            with use, ui.element("div"):
                ui.label(template.name).classes("somrs-define-template-name")
                ui.label(template.note or " ".join(template.task.effect.split())).classes("somrs-soft")
            remove_button = ui.button(icon="delete", on_click=partial(guarded(self._remove), template)).props("flat dense round size=sm")
            remove_button.props(f'aria-label="Remove the template {template.name}"')

    # Using a template

    async def _use(self, template: Template) -> None:
        self._menu.close()
        if not template.blanks:
            await self._fill(template, {})
            return
        values = {blank.name: blank.default for blank in template.blanks}
        self._dialog.clear()
        self._dialog.props["aria-label"] = template.name
        with self._dialog, ui.card().classes("somrs-dialog"):
            ui.label(template.name).classes("somrs-title")
            if template.note:
                ui.label(template.note).classes("somrs-soft")
            for blank in template.blanks:
                with ui.element("div").classes("somrs-define-field"):
                    ui.label(blank.label or blank.name).classes("somrs-define-label")
                    _blank_field(blank, values)
            with ui.element("div").classes("somrs-dialog-ways"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                fill = ui.button("Use it", on_click=guarded(partial(self._fill, template, values)))
                fill.props("unelevated no-caps color=primary")
        self._dialog.open()

    async def _fill(self, template: Template, values: dict[str, str]) -> None:
        filled_values = {name: value for name, value in values.items() if value}
        task = await self._form.api.orders.fill_template(template.name, Filled(values=filled_values))
        self._form.draft.load_task(task)
        self._form.draft.template = template.name
        self._form.changed()
        self._dialog.close()

    # Saving a template

    async def _save_as_template(self) -> None:
        self._menu.close()
        task = self._form.draft.task()
        if not task.effect:
            notify("Enter a goal first.", bad=True)
            return
        context = self._form.api.context
        thing_names = mentioned_things(task, context.map)
        blank_choices = dict.fromkeys(thing_names, False)
        types = {thing: context.map.objects[thing].type for thing in thing_names}
        self._dialog.clear()
        self._dialog.props["aria-label"] = "Save as a template"
        with self._dialog, ui.card().classes("somrs-dialog"):
            ui.label("Save as a template").classes("somrs-title")
            name_field = _line("Name", self._form.draft.template, "Name of the template")
            note = _line("Note", "", "Purpose")
            if thing_names:
                ui.label("Blanks to fill in at each use").classes("somrs-define-label somrs-define-or")
            for thing in thing_names:
                with ui.element("div").classes("somrs-define-blank"):
                    box = ui.checkbox(thing, on_change=lambda event, thing=thing: blank_choices.update({thing: bool(event.value)}))
                    shown_at_once(box).props("dense")
                    ui.label("any").classes("somrs-soft")
                    options = [Choice(value=type_name) for type_name in types_of(thing, context.map, context.ontology)]
                    pick = partial(types.__setitem__, thing)
                    Picker(f"Type for {thing}", value=types[thing], options=options, on_pick=pick)
            with ui.element("div").classes("somrs-dialog-ways"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")

                async def save() -> None:
                    blanks = propose_blank_names({thing: types[thing] for thing in thing_names if blank_choices[thing]})
                    saved = TemplateSaved(
                        task=replace_with_blanks(task, blanks),
                        blanks=tuple(Blank(name=name, type=types[thing], default=thing) for thing, name in blanks.items()),
                        note=(note.value or "").strip(),
                        by=author(),
                    )
                    await self._save((name_field.value or "").strip(), saved)

                ui.button("Save", on_click=guarded(save)).props("unelevated no-caps color=primary")
        self._dialog.open()

    async def _save(self, name: str, saved: TemplateSaved) -> None:
        if not name:
            notify("A template needs a name.", bad=True)
            return
        is_existing = any(template.name == name for template in self._templates)
        if is_existing and not await confirm(f"There is a template {name} already. It will be replaced.", "Replace"):
            return
        await self._form.api.orders.save_template(name, saved)
        self._form.draft.template = name
        self._dialog.close()
        notify(f"Template {name} saved.")

    async def _remove(self, template: Template) -> None:
        self._menu.close()
        if await confirm(f"The template {template.name} will be removed for all users. Tasks made from it stay.", "Remove"):
            await self._form.api.orders.remove_template(template.name, template.version)


def _blank_field(blank: Blank, values: dict[str, str]) -> None:
    if blank.type in ("number", "text"):
        field = ui.input(value=blank.default, on_change=lambda event: values.update({blank.name: event.value or ""}))
        field.props(f'outlined dense aria-label="{blank.label or blank.name}"').classes("somrs-wide")
        return
    pick = partial(values.__setitem__, blank.name)
    label, hint = blank.label or blank.name, f"Which {blank.type}"
    if blank.type == "truth":
        picker = Picker(label, value=blank.default, options=[Choice(value="TRUE"), Choice(value="FALSE")], on_pick=pick)
    else:
        picker = Picker(label, value=blank.default, placeholder=hint, source=things(type=blank.type), on_pick=pick)
    picker.classes("somrs-wide")


def _line(label: str, value: str, placeholder: str) -> ui.input:
    with ui.element("div").classes("somrs-define-field"):
        ui.label(label).classes("somrs-define-label")
        return ui.input(value=value, placeholder=placeholder).props(f'outlined dense aria-label="{label}"').classes("somrs-wide")
