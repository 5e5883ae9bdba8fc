"""What an OWL file would change in an ontology, and on a map."""

from __future__ import annotations

from somrs.errors import ModelError, Problem
from somrs.ontology import owl
from somrs.ontology.conformance import violations_of
from somrs.ontology.naming import find_definition, revise_ontology
from somrs.ontology.objects import Change, Map, differences, objects_of
from somrs.ontology.renaming import Renamer
from somrs.ontology.types import Ontology
from somrs.protocol.messages.knowledge import Define, Revision
from somrs.repository.outcome import revision


class OwlChange:
    """What a file that was read changes in an ontology: `define` leads to it."""

    def __init__(self, found: owl.OwlImport, ontology: Ontology, author: str, expected_version: int | None = None) -> None:
        self._found = found
        self._renamer = Renamer(found.renamings, ontology.extended(found.ontology))
        removed = tuple(what for what in found.removed if find_definition(ontology, what) is not None)
        before = self._renamer.ontology(revise_ontology(ontology, removed, ()))
        self._after = before.extended(self._renamer.definition(one) for one in found.ontology)
        self.define = Define(
            definitions=(revision(before, self._after) or Revision()).after,
            removed=removed,
            renamed=found.renamings,
            author=author,
            expected_version=expected_version,
        )

    @property
    def changes_ontology(self) -> bool:
        return bool(self.define.removed or self.define.renamed or any(self.define.definitions.all_definitions()))

    def on_map(self, now: Map, file: str) -> tuple[Change, ...]:
        """How the file's individuals change the map, once the ontology is as it says: they are as it says, with the facts whose first
        argument they are; other objects stay. Raises ModelError when the map would not conform."""
        before, found = (map.changed(self._renamer.changes(map)) for map in (now, self._found.map))
        facts = [fact for fact in before.facts() if not fact.arguments or fact.arguments[0] not in found.objects]
        after = Map({**before.objects, **found.objects}.values(), [*facts, *found.facts()])
        changes = tuple(differences(before, after))
        broken = violations_of(after, self._after, {name for change in changes for name in objects_of(change)})
        if broken:
            raise ModelError([Problem(file=file, line=None, subject=one.subject, rule=one.rule, message=one.message) for one in broken])
        return changes
