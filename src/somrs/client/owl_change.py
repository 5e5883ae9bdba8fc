"""The changes that the import of an OWL file makes to an ontology and a map."""

from __future__ import annotations

from somrs.errors import ModelError, Problem
from somrs.ontology import owl
from somrs.ontology.conformance import violations_of
from somrs.ontology.differences import differences
from somrs.ontology.map import Map
from somrs.ontology.naming import find_definition, revise_ontology
from somrs.ontology.objects import Change, objects_of
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define, Revision
from somrs.repository.outcome import revision


class OwlChange:
    """The changes that the import of an OWL file makes. `define`: the request that changes the ontology."""

    def __init__(self, owl_content: owl.OwlImport, ontology: Ontology, author: str, expected_version: int | None = None) -> None:
        self._owl_content = owl_content
        self._renamer = Renamer(owl_content.renamings, ontology.extended(owl_content.ontology))
        removed = tuple(word for word in owl_content.removed if find_definition(ontology, word) is not None)
        ontology_before = self._renamer.ontology(revise_ontology(ontology, removed, ()))
        self._ontology_after = ontology_before.extended(self._renamer.definition(definition) for definition in owl_content.ontology)
        self.define = Define(
            definitions=(revision(ontology_before, self._ontology_after) or Revision()).after,
            removed=removed,
            renamed=owl_content.renamings,
            author=author,
            expected_version=expected_version,
        )

    @property
    def changes_ontology(self) -> bool:
        return bool(self.define.removed or self.define.renamed or any(self.define.definitions.all_definitions()))

    def on_map(self, current_map: Map, file: str) -> tuple[Change, ...]:
        """The changes of the map after those of the ontology.

        The individuals of the file replace the objects of the same names, with the facts whose first argument they are. Other objects stay.

        Raises:
            ModelError: the changed map would not conform to the ontology.
        """
        map_before, file_map = (map.changed(self._renamer.changes(map)) for map in (current_map, self._owl_content.map))
        facts = [fact for fact in map_before.facts() if not fact.arguments or fact.arguments[0] not in file_map.objects]
        map_after = Map({**map_before.objects, **file_map.objects}.values(), [*facts, *file_map.facts()])
        changes = tuple(differences(map_before, map_after))
        broken = violations_of(map_after, self._ontology_after, {name for change in changes for name in objects_of(change)})
        if broken:
            raise ModelError(
                [
                    Problem(file=file, line=None, subject=violation.subject, rule=violation.rule, message=violation.message)
                    for violation in broken
                ]
            )
        return changes
