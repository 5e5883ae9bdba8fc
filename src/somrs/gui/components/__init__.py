"""UI components that NiceGUI does not provide: JavaScript elements, each with its Python class.

One folder for each subject. An element is `NAME.js`, or `NAME.py` and `NAME.js`. Elements import what the folder's `modules/index.js`
exports as `somrs-FOLDER`; modules import those of their folder as `./NAME.js`, and those of other folders as `somrs-FOLDER/NAME.js`.
"""

from __future__ import annotations

from pathlib import Path

from nicegui.dependencies import register_importmap_override

from somrs.gui.assets import publish
from somrs.gui.components.bundle import bundle

LIVE = Path(__file__).with_name("live.js")
"""JavaScript module that subscribes to the API's news."""


def publish_modules(modules: Path) -> None:
    """Let elements import what the modules in `FOLDER/modules` export as `somrs-FOLDER`, from one file."""
    folder = modules.parent
    content = bundle(modules / "index.js", components=folder.parent)
    register_importmap_override(f"somrs-{folder.name}", publish(f"{folder.name}.js", content))
