"""Surveys of cameras, which report things by their looks, and the check that the Repository recognises each thing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from somrs.ontology.objects import ObjectAdded
from somrs.ontology.qualified_names import plain_name
from somrs.protocol.messages.envelope import Message, normalised_id
from somrs.protocol.messages.knowledge import Event, Updated
from verification.fault_runs.site import looks_of
from verification.fault_runs.violation import Property, Violation

if TYPE_CHECKING:
    from verification.fault_runs.scenario_run import ScenarioRun


def survey_report(looks: Sequence[str], place: str, thing_type: str) -> str | None:
    """The report of a camera that sees things with these looks on the place: typed variables, in the order of the looks."""
    parts = (
        f'?Seen{number}: {thing_type} isOn {place} AND ?Seen{number}.Texture = "{texture}" AND '
        f"?Seen{number}.PositionX = 1 AND ?Seen{number}.PositionY = 1 AND ?Seen{number}.PositionZ = 0"
        for number, texture in enumerate(looks)
    )
    return " AND ".join(parts) or None


class Sightings:
    """Follows which name on the map each thing has, and checks that it has only one."""

    def __init__(self, scenario_run: ScenarioRun) -> None:
        self._scenario_run = scenario_run
        scenario = scenario_run.scenario
        self._names = {looks_of(thing): thing for thing, _ in (*scenario.things, *scenario.hidden)}
        """The name of each thing, by its looks; that of a hidden thing is none on the map yet."""
        self._surveys: dict[str, tuple[str, ...]] = {}
        """The looks of the things that each survey saw, by the id of its report."""
        self._there: dict[float, set[str]] = {}
        """The looks of the things that surveys saw, by their times."""
        self._record_counts: Counter[str] = Counter()

    def looks(self, thing: str) -> str:
        return next(looks for looks, name in self._names.items() if name == thing)

    def surveyed(self, report: str, looks: Sequence[str], time: float) -> None:
        """A camera sends this report of things with these looks."""
        self._surveys[normalised_id(report)] = tuple(looks)
        self._there.setdefault(time, set()).update(looks)

    def learn_names(self) -> None:
        """Follow what the Repository records: each thing comes to the map once, and nothing is missed that was seen."""
        for address in self._scenario_run.organisations.repositories.values():
            records = self._scenario_run.world.records.get(address, [])
            for record in records[self._record_counts[address] :]:
                if isinstance(record, Event):
                    self._follow(record)
            self._record_counts[address] = len(records)

    def _follow(self, event: Event) -> None:
        for change in event.changes:
            looks = change.object.values.get("Texture") if isinstance(change, ObjectAdded) else None
            if isinstance(change, ObjectAdded) and isinstance(looks, str):
                if self._scenario_run.scenario.repositories > 1 and plain_name(change.object.name) == self._names[looks]:
                    continue  # it comes to the map of a neighbour, or gets another home
                if self._names[looks] not in self._scenario_run.reality.unnamed:
                    raise Violation(Property.IDENTITY, f"{self._names[looks]} came to the map once more, as {change.object.name}")
                self._scenario_run.reality.name(self._names[looks], change.object.name)
                self._names[looks] = change.object.name
        if event.reception is not None and event.reception.as_of is not None:
            seen = {self._names[looks] for looks in self._there.get(event.reception.as_of, ())}
            if missed := seen.intersection(map(plain_name, event.reception.missing)):
                raise Violation(Property.IDENTITY, f"{min(missed)} was seen, and the map marks it as missing")

    def read(self, message: Message) -> None:
        """Check the names that the Repository gives to what was seen."""
        looks = self._surveys.get(normalised_id(message.header.relates_to or ""))
        if looks is None or not isinstance(message.body, Updated) or message.body.reception is None:
            return
        names: Mapping[str, str] = message.body.reception.names
        for number, texture in enumerate(looks):
            name = names.get(f"Seen{number}")
            if name is not None and plain_name(name) != self._names[texture]:
                raise Violation(Property.IDENTITY, f"{self._names[texture]} was seen, and was taken for {name}")
