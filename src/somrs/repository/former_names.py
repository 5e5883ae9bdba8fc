"""Names that objects had: a report that is late, or whose author does not know better, may still use them."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import structs

from somrs.ontology.homes import renamed_change
from somrs.ontology.map import Map
from somrs.ontology.naming import Renaming, Section
from somrs.ontology.objects import ObjectAdded, objects_of
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import MapPage, ReadMap, UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.protocol.messages.paging import fit_page
from somrs.repository.neighbour_view import View
from somrs.repository.provenance import Provenance
from somrs.repository.state import Contents


def with_current_names(update: UpdateMap, map: Map, ontology: Ontology, provenance: Provenance) -> UpdateMap:
    """The update with the names that its objects have now."""
    names = {name: former.name for name, former in provenance.former_names.items() if name not in map.objects}
    added = {change.object.name for change in update.changes if isinstance(change, ObjectAdded)}
    named, text = _named_objects(update), update.situation or ""
    used = {name: now for name, now in names.items() if name not in added and (name in named or name in text)}
    if not used:
        return update
    renamer = Renamer((Renaming(section=Section.OBJECTS, name=name, to=now) for name, now in used.items()), ontology)
    return structs.replace(
        update,
        changes=tuple(renamed_change(change, lambda name: used.get(name, name)) for change in update.changes),
        situation=renamer.text(update.situation),
        observation=_renamed_observation(update.observation, used) if update.observation is not None else None,
    )


def with_former_names(page: MapPage, question: ReadMap, contents: Contents, view: View | None = None) -> MapPage:
    """The page, if it is the first one of the map as it is, with names that objects had.

    Who reads the map anew may have missed how they got others. `view`: what the reader, a neighbour, sees; None: everything.
    """
    if question.after or question.situation is not None:
        return page
    objects = contents.map.objects
    latest_first = ((name, former.name) for name, former in reversed(contents.provenance.former_names.items()))
    names = ((name, now) for name, now in latest_first if name not in objects and now in objects and (view is None or view.shows_name(now)))
    return structs.replace(page, former_names=dict(fit_page(names)))  # as many as fit into the message


def _named_objects(update: UpdateMap) -> set[str]:
    """The objects that an update names, outside of its situation."""
    observation = update.observation or Observation()
    changed = (name for change in update.changes for name in objects_of(change))
    return {*observation.gone, *observation.searched, *observation.sought, *observation.missed, *changed}


def _renamed_observation(observation: Observation, names: Mapping[str, str]) -> Observation:
    gone, searched, sought, missed = (
        tuple(dict.fromkeys(names.get(name, name) for name in group))
        for group in (observation.gone, observation.searched, observation.sought, observation.missed)
    )
    return structs.replace(observation, gone=gone, searched=searched, sought=sought, missed=missed)
