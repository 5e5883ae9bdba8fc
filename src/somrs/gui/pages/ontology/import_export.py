"""Import of definitions from YAML or OWL, with problems and consequences shown first; export to these formats."""

from __future__ import annotations

from collections.abc import Awaitable, Sequence

from nicegui import events, ui

from somrs.api.ontology import ImportOntology, ImportResult
from somrs.api.owl import OwlImportResult
from somrs.api.remote import LiveApi
from somrs.errors import ModelError, Problem, SomrsError
from somrs.gui.author import author
from somrs.gui.components.fields.shown_at_once import shown_at_once
from somrs.gui.pages.ontology.consequences import show_consequences
from somrs.gui.pages.ontology.elements import TextTag, cell, note, row, table, titled_dialog
from somrs.gui.shell import notify

_MOST_BYTES = 20_000_000

KINDS = {".yaml": "yaml", ".yml": "yaml", ".ttl": "owl", ".owl": "owl", ".rdf": "owl", ".xml": "owl"}
"""Kind of a file by its extension."""

UPLOAD_HEADER = """<q-btn flat no-caps icon="upload_file" label="Choose or drop a file" class="full-width" @click="props.pickFiles" />
<span hidden><q-uploader-add-trigger /></span>"""
"""A button with a name; Quasar's own has none, and contains the field for the file."""


def export_menu() -> None:
    """Add a button with a menu of the export formats."""
    files = (
        ("YAML: without the upper ontology", "/api/ontology/export.yaml"),
        ("YAML: with the upper ontology", "/api/ontology/export.yaml?whole=true"),
        ("OWL 2 with SHACL (Turtle)", "/api/ontology/export.ttl"),
        ("OWL 2 with SHACL (RDF/XML)", "/api/ontology/export.ttl?format=xml"),
        ("OWL 2 with SHACL and the map (Turtle)", "/api/ontology/export.ttl?map=true"),
    )
    with ui.button("Export", icon="download").props("flat dense no-caps"), ui.menu().props("auto-close"):
        for label, address in files:
            ui.menu_item(label).props(f'href="{address}" download tag=a')


class Import:
    """The dialog for an import."""

    def __init__(self, api: LiveApi) -> None:
        self._api = api
        self._text, self._file = "", ""
        self._version: int | None = None
        with titled_dialog("Import definitions") as self._dialog, ui.card().classes("somrs-onto-dialog"):
            TextTag("h2", "Import definitions")
            note("A YAML file (ontology or map file) or an OWL file (Turtle, RDF/XML). You can review the changes before the import.")
            self._upload = ui.upload(auto_upload=True, max_file_size=_MOST_BYTES, on_upload=self._receive_file).props(
                'accept=".yaml,.yml,.ttl,.owl,.rdf,.xml" flat bordered hide-upload-btn'
            )
            self._upload.classes("somrs-onto-upload").add_slot("header", UPLOAD_HEADER)
            self._chosen = ui.label().classes("somrs-onto-doc")
            self._body = ui.element("div").classes("somrs-onto-dialog-body").props('aria-live="polite"')
            self._map = shown_at_once(ui.checkbox("", on_change=self._consider))
            self._map.visible = False
            with ui.row().classes("somrs-onto-buttons"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                self._import_button = ui.button("Import", on_click=self._carry_out).props("unelevated no-caps")
                self._import_button.visible = False
        self._dialog.on("hide", self._dialog.delete)
        self._dialog.open()

    async def _receive_file(self, event: events.UploadEventArguments) -> None:
        self._file, self._version = event.file.name, None
        self._chosen.text = f"In {self._file}:"
        self._upload.reset()
        self._import_button.visible = self._map.visible = False
        self._map.value = False
        try:
            self._text = (await event.file.read()).decode()
        except UnicodeDecodeError:
            self._show_problems(
                [Problem(file=self._file, line=None, subject="file", rule="encoding", message="is not UTF-8 text; save it as UTF-8")]
            )
            return
        await self._consider()

    async def _consider(self) -> None:
        """Show the consequences of the import."""
        if not self._text:
            return
        self._import_button.visible = False
        try:
            preview = await self._run(dry=True)
        except ModelError as error:
            self._show_problems(error.problems)
        except SomrsError as error:
            self._show_refusal(str(error))
        else:
            self._body.clear()
            with self._body:
                show_consequences(preview.consequences)
                if isinstance(preview, OwlImportResult):
                    self._show_unmapped(preview)
            self._version = preview.consequences.version
            is_empty = preview.consequences.revision is None and not self._map.value
            self._import_button.visible = not (preview.consequences.broken or is_empty)

    def _show_unmapped(self, preview: OwlImportResult) -> None:
        """Show what else an OWL file contains: objects, and statements that cannot be imported."""
        self._map.visible = preview.objects > 0
        individuals = f"{preview.objects} individuals" if preview.objects != 1 else "one individual"
        self._map.text = f"Also add its {individuals} to the map; values in the file replace those on the map"
        if self._map.value:
            note(f"Changes of the map by its individuals: {preview.all_on_map}.")
        if preview.notes:
            TextTag("h3", f"Not imported: {len(preview.notes)}").classes("somrs-onto-heading")
            self._list(preview.notes, "What to do")

    def _run(self, *, dry: bool) -> Awaitable[ImportResult]:
        ending = self._file[self._file.rfind(".") :].lower()
        # Import only what was shown: not if the same definitions have changed since.
        version = None if dry else self._version
        body = ImportOntology(text=self._text, file=self._file, author=author(), expected_version=version)
        if KINDS.get(ending) == "owl":
            return self._api.ontology.import_owl(body, dry=dry, map=self._map.value)
        return self._api.ontology.import_yaml(body, dry=dry)

    async def _carry_out(self) -> None:
        try:
            reply = await self._run(dry=False)
        except SomrsError as error:
            self._show_refusal(str(error))
            return
        notify(f"{self._file} imported, version {reply.version}")
        self._dialog.close()

    def _show_refusal(self, text: str) -> None:
        self._body.clear()
        with self._body, ui.element("div").classes("somrs-onto-banner somrs-onto-bad").props('role="alert"'):
            ui.icon("error")
            ui.label(text).classes("somrs-onto-pre")

    def _show_problems(self, problems: list[Problem]) -> None:
        """Show problems with their lines in the file."""
        self._body.clear()
        with self._body, ui.element("div").props('role="alert"'):
            with TextTag("h3", "").classes("somrs-onto-heading somrs-onto-bad"):
                ui.icon("error")
                TextTag("span", f"{len(problems)} {'problem' if len(problems) == 1 else 'problems'}: nothing was imported")
            self._list(problems, "What is wrong")

    def _list(self, problems: Sequence[Problem], heading: str) -> None:
        lines = self._text.splitlines()
        with table("Line", "Content", heading):
            for problem in problems:
                with row():
                    TextTag("td", str(problem.line or ""))
                    with cell():
                        if problem.line is not None and problem.line <= len(lines):
                            TextTag("code", lines[problem.line - 1].strip()[:160], "somrs-formula")
                    with cell():
                        ui.label(f"{problem.subject}: {problem.message}").classes("somrs-onto-pre" if "\n" in problem.message else "")
