"""Map: the floor plan of the environment, read, searched, changed, and looked back at.

`page.py` is the page; on its right side `sheet.py` shows the object that is chosen (with `form.py`, `fields.py`, `relations.py`),
`add_panel.py` what new objects are made with, `search_panel.py` what is looked for, `changes.py` what happened; below the plan are
`version_slider.py`. `moves.py` and `proposals.py` say what moving and adding change on the map, `value_input.py` and `change_text.py` how
values and changes are written."""

from __future__ import annotations

from somrs.gui.pages.map.page import register

__all__ = ["register"]
