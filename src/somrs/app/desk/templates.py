"""Templates of tasks: tasks that people state often, with a name, and with blanks that are filled in when they are used."""

from __future__ import annotations

import msgspec

from somrs.protocol.clients import Submit


class Blank(msgspec.Struct, frozen=True, kw_only=True):
    """What is filled in: `{Thing}` in the formulas of the task. `type` is a type of the ontology, or `number` or `text`; `default` is taken
    when nothing is said."""

    name: str
    type: str = "Object"
    default: str = ""
    label: str = ""


class Template(msgspec.Struct, frozen=True, kw_only=True):
    """A task to be stated again and again. `version` counts its changes."""

    name: str
    task: Submit
    blanks: tuple[Blank, ...] = ()
    note: str = ""
    version: int = 0
    changed_at: float = 0.0
    changed_by: str = ""


class Templates(msgspec.Struct, frozen=True, kw_only=True):
    templates: tuple[Template, ...]


class TemplateSaved(msgspec.Struct, frozen=True, kw_only=True):
    """What is to be kept under a name. `expected_version`: the version that one saw (0: there was none of this name); if it is another by
    now, somebody else changed it, and nothing is saved. None: whatever there is."""

    task: Submit
    blanks: tuple[Blank, ...] = ()
    note: str = ""
    by: str = ""
    expected_version: int | None = None


class Filled(msgspec.Struct, frozen=True, kw_only=True):
    """What is written in the blanks, by their names."""

    values: dict[str, str] = {}
