"""Files: definitions taken over from YAML or OWL, with their problems and what would come of them shown before; and written to them."""

from __future__ import annotations

from collections.abc import Awaitable, Sequence

from nicegui import events, ui

from somrs.api.ontology import ImportOntology, ImportResult
from somrs.api.owl import OwlImportResult
from somrs.api.remote import LiveApi
from somrs.errors import ModelError, Problem, SomrsError
from somrs.gui.pages.ontology.consequences import show
from somrs.gui.pages.ontology.pieces import Word, cell, note, row, table, titled
from somrs.gui.shell import author, tell

MOST_BYTES = 20_000_000

KINDS = {".yaml": "yaml", ".yml": "yaml", ".ttl": "owl", ".owl": "owl", ".rdf": "owl", ".xml": "owl"}
"""What a file is, by how its name ends."""


def export_menu() -> None:
    """A button with the files that the ontology can be written to."""
    files = (
        ("YAML: what is beyond the upper ontology", "/api/ontology/export.yaml"),
        ("YAML: all of it", "/api/ontology/export.yaml?whole=true"),
        ("OWL 2 with SHACL (Turtle)", "/api/ontology/export.ttl"),
        ("OWL 2 with SHACL (RDF/XML)", "/api/ontology/export.ttl?format=xml"),
        ("OWL 2 with SHACL and the map (Turtle)", "/api/ontology/export.ttl?map=true"),
    )
    with ui.button("Export", icon="download").props("flat dense no-caps"), ui.menu().props("auto-close"):
        for label, address in files:
            ui.menu_item(label).props(f'href="{address}" download tag=a')


class Import:
    """The dialog that takes a file over."""

    def __init__(self, desk: LiveApi) -> None:
        self._desk = desk
        self._text, self._file = "", ""
        self._version: int | None = None
        with titled("Import definitions") as self._dialog, ui.card().classes("somrs-onto-dialog"):
            Word("h2", "Import definitions")
            note("A YAML file (ontology or map file) or an OWL file (Turtle, RDF/XML). Nothing is changed before you say so.")
            self._upload = ui.upload(label="Choose or drop a file", auto_upload=True, max_file_size=MOST_BYTES, on_upload=self._take).props(
                'accept=".yaml,.yml,.ttl,.owl,.rdf,.xml" flat bordered hide-upload-btn'
            )
            self._upload.classes("somrs-onto-upload")
            self._chosen = ui.label().classes("somrs-onto-doc")
            self._body = ui.element("div").classes("somrs-onto-dialog-body").props('aria-live="polite"')
            self._map = ui.checkbox("", on_change=self._consider)
            self._map.visible = False
            with ui.row().classes("somrs-onto-buttons"):
                ui.button("Go back", on_click=self._dialog.close).props("flat no-caps")
                self._take_over = ui.button("Take over", on_click=self._carry_out).props("unelevated no-caps")
                self._take_over.visible = False
        self._dialog.on("hide", self._dialog.delete)
        self._dialog.open()

    async def _take(self, event: events.UploadEventArguments) -> None:
        self._file, self._version = event.file.name, None
        self._chosen.text = f"In {self._file}:"
        self._upload.reset()
        self._take_over.visible = self._map.visible = False
        self._map.value = False
        try:
            self._text = (await event.file.read()).decode()
        except UnicodeDecodeError:
            self._say(
                [Problem(file=self._file, line=None, subject="file", rule="encoding", message="is no text in UTF-8; save it as such")]
            )
            return
        await self._consider()

    async def _consider(self) -> None:
        """Show what would come of the file."""
        if not self._text:
            return
        self._take_over.visible = False
        try:
            found = await self._run(dry=True)
        except ModelError as error:
            self._say(error.problems)
        except SomrsError as error:
            self._refused(str(error))
        else:
            self._body.clear()
            with self._body:
                show(found.consequences)
                if isinstance(found, OwlImportResult):
                    self._show_besides(found)
            self._version = found.consequences.version
            nothing = found.consequences.revision is None and not self._map.value
            self._take_over.visible = not (found.consequences.broken or nothing)

    def _show_besides(self, found: OwlImportResult) -> None:
        """What else is in an OWL file: objects, and what there are no words for."""
        self._map.visible = found.objects > 0
        individuals = f"{found.objects} individuals" if found.objects != 1 else "one individual"
        self._map.text = f"Put its {individuals} on the map, too: what the file says of them counts"
        if self._map.value:
            note(f"Changes of the map by its individuals: {found.all_on_map}.")
        if found.notes:
            Word("h3", f"Not taken over: {len(found.notes)}").classes("somrs-onto-heading")
            self._list(found.notes, "What to do")

    def _run(self, *, dry: bool) -> Awaitable[ImportResult]:
        ending = self._file[self._file.rfind(".") :].lower()
        # What was shown is what is done: not if somebody changed the same definitions since.
        version = None if dry else self._version
        body = ImportOntology(text=self._text, file=self._file, author=author(), expected_version=version)
        if KINDS.get(ending) == "owl":
            return self._desk.ontology.import_owl(body, dry=dry, map=self._map.value)
        return self._desk.ontology.import_yaml(body, dry=dry)

    async def _carry_out(self) -> None:
        try:
            done = await self._run(dry=False)
        except SomrsError as error:
            self._refused(str(error))
            return
        tell(f"{self._file} is taken over, in version {done.version}")
        self._dialog.close()

    def _refused(self, text: str) -> None:
        self._body.clear()
        with self._body, ui.element("div").classes("somrs-onto-banner somrs-onto-bad").props('role="alert"'):
            ui.icon("error")
            ui.label(text).classes("somrs-onto-pre")

    def _say(self, problems: list[Problem]) -> None:
        """Problems where they are: each with its line, and what stands there."""
        self._body.clear()
        with self._body, ui.element("div").props('role="alert"'):
            with Word("h3", "").classes("somrs-onto-heading somrs-onto-bad"):
                ui.icon("error")
                Word("span", f"{len(problems)} {'problem' if len(problems) == 1 else 'problems'}: nothing was taken over")
            self._list(problems, "What is wrong")

    def _list(self, problems: Sequence[Problem], heading: str) -> None:
        lines = self._text.splitlines()
        with table("Line", "What is there", heading):
            for one in problems:
                with row():
                    Word("td", str(one.line or ""))
                    with cell():
                        if one.line is not None and one.line <= len(lines):
                            Word("code", lines[one.line - 1].strip()[:160], "somrs-formula")
                    with cell():
                        ui.label(f"{one.subject}: {one.message}").classes("somrs-onto-pre" if "\n" in one.message else "")
