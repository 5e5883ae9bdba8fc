"""Map: view, search and edit the map, and show its history.

`page.py` is the page. Its right side has `sheet.py` for the selected object (with `form.py`, `fields.py`, `relations.py`), `add_panel.py`
for new objects, `search_panel.py` for queries and `changes.py` for the history; `version_slider.py` is below the plan. `moves.py` and
`proposals.py` compute the changes of moving and adding objects; `value_input.py` and `change_text.py` format values and changes.
"""

from __future__ import annotations

from somrs.gui.pages.map.page import register

__all__ = ["register"]
