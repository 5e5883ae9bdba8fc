"""Cuts the ontology and the map into pages that fit into messages."""

from __future__ import annotations

from somrs.ontology.map import Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import MapPage, OntologyPage, by_kind
from somrs.protocol.messages.paging import fit_page


def ontology_page(ontology: Ontology, version: int, offset: int, changed_at: int) -> OntologyPage:
    """The page that follows the first `offset` definitions. `changed_at`: the version in which the ontology changed last."""
    definitions = list(ontology)
    page = list(fit_page(definitions[max(offset, 0) :]))
    end = max(offset, 0) + len(page)
    return OntologyPage(definitions=by_kind(page), version=version, next=end, more=end < len(definitions), changed_at=changed_at)


def map_page(map: Map, version: int, last_name: str) -> MapPage:
    """The page that follows the object `last_name`, in the order of names. Facts without arguments are on the first page."""
    rows = ((map.objects[name], [*map.facts_from(name)]) for name in map.names_after(last_name))
    page = list(fit_page(rows))
    facts = [fact for _, facts in page for fact in facts]
    next_name = next(map.names_after(page[-1][0].name), None) if page else None
    return MapPage(
        objects=tuple(object for object, _ in page),
        facts=tuple(facts if last_name else [*map.facts_without_arguments(), *facts]),
        version=version,
        more=next_name is not None,
        map=map.name,
    )
