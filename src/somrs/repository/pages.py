"""Cuts the ontology and the map into pages that fit into messages."""

from __future__ import annotations

from bisect import bisect_right

from somrs.ontology.objects import Fact, Map
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import MapPage, OntologyPage, by_kind
from somrs.protocol.messages.paging import fit_page


def ontology_page(ontology: Ontology, version: int, offset: int, changed_at: int) -> OntologyPage:
    """The page that follows the first `offset` definitions. `changed_at`: the version in which the ontology changed last."""
    definitions = list(ontology)
    page = list(fit_page(definitions[max(offset, 0) :]))
    end = max(offset, 0) + len(page)
    return OntologyPage(definitions=by_kind(page), version=version, next=end, more=end < len(definitions), changed_at=changed_at)


class MapPages:
    """The pages of a map, in the order of object names."""

    def __init__(self, map: Map) -> None:
        self.map = map
        self._names = sorted(map.objects)
        self._facts: dict[str, list[Fact]] = {}
        for fact in map.facts():
            self._facts.setdefault(fact.arguments[0] if fact.arguments else "", []).append(fact)

    def page(self, version: int, last_name: str) -> MapPage:
        """The page that follows the object `last_name`. Facts without arguments are on the first page."""
        start = bisect_right(self._names, last_name) if last_name else 0
        rows = ((self.map.objects[name], self._facts.get(name, [])) for name in self._names[start:])
        page = list(fit_page(rows))
        facts = [fact for _, facts in page for fact in facts]
        return MapPage(
            objects=tuple(object for object, _ in page),
            facts=tuple(facts if last_name else [*self._facts.get("", []), *facts]),
            version=version,
            more=start + len(page) < len(self._names),
        )
