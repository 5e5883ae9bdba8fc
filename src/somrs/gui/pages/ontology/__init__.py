"""Ontology: view and edit the definitions of types, attributes, relations, functions and services.

`page.py` is the page. `index.py` is its left side, `sheet.py` shows a definition, `editor.py` (with `forms.py`, `fields.py`, `drafts.py`,
`form_parser.py`) edits one, `actions.py` has the actions without a form, `history_dialog.py` the history, `import_export.py` the files.
"""

from __future__ import annotations

from somrs.gui.pages.ontology.page import register

__all__ = ["register"]
