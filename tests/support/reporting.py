"""A Repository with the laboratory that receives reports, for tests of what becomes of them."""

from __future__ import annotations

from somrs.kernel.component import Record, Send
from somrs.ontology.map import Map
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.knowledge import Alteration, Consider, Considered, Event, Updated, UpdateMap
from somrs.protocol.messages.observations import Observation, Reception
from somrs.repository.component import Repository
from tests.support.lab import CLIENT, REPOSITORY, contents, deliver_request

RED_JAR = "?It: Jar isOn Table2 AND ?It.Color = Red AND ?It.PositionX = 8 AND ?It.PositionY = 8.1 AND ?It.PositionZ = 0.7"
"""A sighting of a jar that the laboratory does not have."""


class Reporting:
    """A Repository with the laboratory, and the answers to reports."""

    def __init__(self) -> None:
        self.repository = Repository(REPOSITORY, contents())
        self.events: list[Event] = []

    def report(self, situation: str | None = None, now: float = 100.0, **observation: object) -> Body:
        seen = Observation(**observation) if observation else None  # type: ignore[arg-type]  # as the fields
        return self.update(UpdateMap(situation=situation, author="Camera1", observation=seen), now)

    def update(self, body: Alteration, now: float = 100.0) -> Body:
        effects = deliver_request(self.repository, body, now)
        self.events += [effect.entry for effect in effects if isinstance(effect, Record) and isinstance(effect.entry, Event)]
        (answer,) = [effect.message.body for effect in effects if isinstance(effect, Send) and effect.message.header.recipient == CLIENT]
        return answer

    def consider(self, change: Alteration) -> Considered:
        """Return what the change would do."""
        (send,) = deliver_request(self.repository, Consider(change=change), 100.0)
        assert isinstance(send, Send)
        assert isinstance(send.message.body, Considered), send.message.body
        return send.message.body

    def reception(self, situation: str | None = None, now: float = 100.0, **observation: object) -> Reception:
        answer = self.report(situation, now, **observation)
        assert isinstance(answer, Updated), answer
        return answer.reception or Reception()

    @property
    def map(self) -> Map:
        return self.repository.contents.map

    def place(self, name: str) -> str | None:
        return next(
            (fact.arguments[1] for fact in self.map.facts_about(name) if fact.relation == "isOn" and fact.arguments[0] == name), None
        )
