"""What an import brought in, and what it left out, assumed or moved, on one screen: what matters most comes first."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from somrs.sites import Site
    from somrs.sites.notes import Note

COUNTED = (
    "Storey", "Wall", "Door", "Lift", "Lane", "Waypoint", "Station", "Support", "Pedestrian", "Obstacle", "Graspable", "MobileRobot",
)  # fmt: skip
"""The types whose objects are counted; an object counts for the first one that it is of."""
_LINES = 12
"""How many kinds of notes fit on a screen, with the contents and what is said below them."""
_NAMED = 2
_WORDS = {
    "Support": ("table or shelf", "tables and shelves"),
    "Waypoint": ("waypoint or place", "waypoints and places"),
    "Graspable": ("thing", "things"),
    "Pedestrian": ("person", "people"),
    "MobileRobot": ("robot", "robots"),
}
_WITHOUT_ROBOTS = (
    "There is no robot in it, so nothing can be carried there. Add one on the page Map when the system runs, or to the file, "
    "such as one of the type DeliveryRobot."
)
_TITLES = {1: "left out", 2: "assumed", 3: "moved", 4: "note"}


def report(site: Site, *, details: bool) -> Group:
    """What is on the map, and the notes; with `details`, all of them and all that they are about."""
    parts: list[Text | Table] = [Text(_contents(site))]
    shown_notes = site.notes if details else site.notes[:_LINES]
    if shown_notes:
        parts.append(_table(shown_notes, details=details))
    if not any(site.ontology.is_subtype(object.type, "MobileRobot") for object in site.map.objects.values()):
        parts.append(Text(_WITHOUT_ROBOTS))
    parts += [Text(advice) for advice in dict.fromkeys(note.advice for note in shown_notes) if advice]
    if hidden := len(site.notes) - len(shown_notes):
        parts.append(Text(f"and {hidden} more kinds of notes: --details"))
    return Group(*parts)


def _contents(site: Site) -> str:
    counts = Counter(
        next((type for type in COUNTED if site.ontology.is_subtype(object.type, type)), None) for object in site.map.objects.values()
    )
    return f"{site.name}: " + ", ".join(f"{counts[type]} {_words(type, counts[type])}" for type in COUNTED if counts[type])


def _words(type: str, count: int) -> str:
    one, many = _WORDS.get(type, (type.lower(), f"{type.lower()}s"))
    return one if count == 1 else many


def _table(notes: tuple[Note, ...], *, details: bool) -> Table:
    table = Table(box=None, padding=(0, 1), show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right")
    table.add_column()
    for note in notes:
        named = note.subjects if details else note.subjects[:_NAMED]
        rest = f" and {len(note.subjects) - len(named)} more" if len(note.subjects) > len(named) else ""
        table.add_row(_TITLES[note.rank], str(len(note.subjects)), escape(f"{note.text}: {', '.join(named)}{rest}"))
    return table
