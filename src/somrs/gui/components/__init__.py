"""What pages are made of and NiceGUI does not bring: components of our own, in JavaScript, each with its Python side.

A folder for each kind of thing that they draw. Beside an element (`NAME.js`, or `NAME.py` and `NAME.js`) are the `modules` that it is made
of, which the browser finds as `somrs-FOLDER/NAME.js`.
"""

from __future__ import annotations

from pathlib import Path

LIVE = Path(__file__).with_name("live.js")
"""News from the API, for elements that follow it by themselves."""
