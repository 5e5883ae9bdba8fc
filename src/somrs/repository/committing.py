"""Makes the outcome of a change the state of the Repository."""

from __future__ import annotations

from msgspec import structs

from somrs.kernel.component import EffectsReturning, Record
from somrs.protocol.messages.knowledge import Event, MapChanged
from somrs.repository.outcome import Outcome, note_provenance
from somrs.repository.publishing import Committed
from somrs.repository.rollback import inverse
from somrs.repository.state import Contents, DefinitionChange


class Committing:
    """Changes the contents. It has no state of its own."""

    def __init__(self, contents: Contents) -> None:
        self._contents = contents

    def commit(
        self, outcome: Outcome, author: str, now: float, *, task: str | None = None, undoes: int | None = None
    ) -> EffectsReturning[Committed | None]:
        """Apply an outcome without broken rules. `task`: the one that reports; `undoes`: the version that is reverted.

        Returns the change, of which subscribers are to be told; None if nothing has changed.
        """
        contents, map_before = self._contents, self._contents.map
        note_provenance(contents.provenance, outcome, contents.map, author, now)
        if not outcome.changes and outcome.revision is None:
            return None
        event = Event(
            version=contents.version + 1,
            at=now,
            author=author,
            changes=outcome.changes,
            revision=outcome.revision,
            renamed=outcome.renamed,
            undoes=undoes,
            before=inverse(contents.map, outcome.changes),
            reception=outcome.reception,
            merged=outcome.merged,
        )
        contents.version = event.version
        if task is not None:
            contents.reservations.note_changes(task, outcome.altered)
        if new_names := event.new_names:
            contents.reservations.rename(new_names)
        contents.map, contents.ontology = outcome.map, outcome.ontology
        contents.changed_at.update(dict.fromkeys(outcome.objects, event.version))
        for definition_key in outcome.definitions:
            contents.defined_at.setdefault(definition_key.section, {})[definition_key.name] = DefinitionChange(
                version=event.version, author=event.author
            )
        yield Record(event)
        news = outcome.change_notice(event.version) if event.revision is not None else MapChanged(event=structs.replace(event, before=()))
        return Committed(news, map_before)
