"""Ontology: what kinds of things there are, read and changed.

`page.py` is the page; `index.py` its left side, `sheet.py` what is read of a definition, `editor.py` (with `forms.py`, `fields.py`,
`drafts.py`, `form_parser.py`) how one is written, `actions.py` what is done without a form, `history_dialog.py` the history,
`import_export.py` files."""

from __future__ import annotations

from somrs.gui.pages.ontology.page import register

__all__ = ["register"]
