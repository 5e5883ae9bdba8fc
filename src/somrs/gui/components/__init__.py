"""UI components that NiceGUI does not provide: JavaScript elements, each with its Python class.

One folder for each subject. An element is `NAME.js`, or `NAME.py` and `NAME.js`; its `modules` are imported in the browser as
`somrs-FOLDER/NAME.js`.
"""

from __future__ import annotations

from pathlib import Path

LIVE = Path(__file__).with_name("live.js")
"""JavaScript module that subscribes to the API's news."""
