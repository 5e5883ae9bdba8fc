"""Answers what asks for the map and the ontology: as they are, as they would be in a promised situation, as they were in an earlier
version, or as a neighbour may see them."""

from __future__ import annotations

from somrs.errors import InputError
from somrs.protocol.messages.knowledge import MapPage, OntologyPage, QueryMap, ReadMap, ReadOntology, Rows
from somrs.repository.former_names import with_former_names
from somrs.repository.history_queries import page_query
from somrs.repository.map_answers import MapAnswers
from somrs.repository.neighbour_view import View
from somrs.repository.pages import ontology_page
from somrs.repository.publishing import OWN_OBJECTS
from somrs.repository.state import Contents, Task


class Reading:
    """Reads `contents`, and changes nothing."""

    def __init__(self, contents: Contents) -> None:
        self._contents, self._answers = contents, MapAnswers()

    def answer(self, question: ReadOntology | ReadMap | QueryMap, reader: str) -> OntologyPage | MapPage | Rows | Task:
        """The answer to a reader, given by its address, or the task to find it: in the archive, or by long work. Raises InputError."""
        contents = self._contents
        if isinstance(question, QueryMap):
            return self._answers.answer(question, contents.map, contents.ontology, contents.version)
        if question.at_version is not None:
            if isinstance(question, ReadMap) and question.situation is not None:
                raise InputError("a situation is promised for the map as it is now: give `situation` or `at_version`, not both")
            return page_query(question, question.at_version, contents)
        if isinstance(question, ReadOntology):
            return ontology_page(contents.ontology, contents.version, question.after, contents.ontology_changed_at)
        neighbour = contents.neighbour_at(reader)
        shown = neighbour.settings if neighbour is not None else OWN_OBJECTS if question.own and contents.map.homes else None
        if shown is not None and question.situation is None:
            leaving = {handover.object for handover in contents.handovers.values() if handover.map == shown.map}
            view = View(shown, contents.map, contents.ontology)
            return with_former_names(view.page(contents.version, question.after, leaving), question, contents, view)
        answer = self._answers.answer(question, contents.map, contents.ontology, contents.version)
        return with_former_names(answer, question, contents) if isinstance(answer, MapPage) else answer
