"""Bystanders: people, who move things and report some of it, and cameras, which report what they see, in the midst of all tasks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from somrs.ontology.homes import full_text
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.observations import Observation
from verification.fault_runs.scenario import Move, Slam
from verification.fault_runs.sightings import survey_report

if TYPE_CHECKING:
    from verification.fault_runs.scenario_run import ScenarioRun


class Bystanders:
    """The people and the cameras of a run."""

    def __init__(self, scenario_run: ScenarioRun) -> None:
        self._world, self._reality, self._sightings = scenario_run.world, scenario_run.reality, scenario_run.witness.sightings
        self._organisations = scenario_run.organisations
        self._note, self._thing_type = scenario_run.note, scenario_run.scenario.thing_type

    def move(self, move: Move) -> None:
        self._note(f"a person puts {move.thing} on {move.place}{', and reports it' if move.is_reported else ''}")
        self._reality.move_object(move.thing, ("isOn", move.place), self._world.now, None, "a person")
        self._reality.doubtful.add(move.thing)
        if move.is_reported:
            self._send_update("a person", f"{move.thing} isOn {move.place}", move.place)

    def slam(self, slam: Slam) -> None:
        self._note(f"a person {'opens' if slam.is_open else 'shuts'} {slam.door}")
        self._reality.move_object(slam.door, slam.is_open, self._world.now, None, "a person")
        self.report_sighting(slam.door)

    def report_sighting(self, object: str) -> None:
        state = self._reality.state(object)
        place = object if isinstance(state, bool) else state[1]
        self._send_update("a camera", self._reality.situation_of(object), place, Observation(as_of=self._world.now))

    def report_survey(self, place: str) -> None:
        things = self._reality.things_on(place)
        looks = [self._sightings.looks(thing) for thing in things]
        report = survey_report(looks, place, self._thing_type)
        id = self._send_update("a camera", report, place, Observation(as_of=self._world.now, searched=(place,)))
        self._sightings.surveyed(id, looks, self._world.now)

    def report_loss(self, object: str) -> None:
        self._reality.doubtful.add(object)  # its mark may hide what devices have reported
        self._send_update("a person", f"{object}.Unknown = TRUE", object)

    def _send_update(self, author: str, situation: str | None, place: str, observation: Observation | None = None) -> str:
        """Send a report to the Repository that has the place, and return the id of the message."""
        self._note(f"{author} reports: {situation or 'nothing is there'}")
        id = message_id(author, self._world.now, situation, *(observation.searched if observation is not None else ()))
        map = next(iter(self._organisations.homes(place)), self._organisations.first_map)
        contents = self._organisations.contents(map)
        text = full_text(situation, contents.map, contents.ontology) if situation is not None and contents is not None else situation
        header = Header(sender="client", recipient=self._organisations.repositories[map], message_id=id, reply_to="client")
        self._world.send(Message(header=header, body=UpdateMap(situation=text, author=author, observation=observation)))
        return id
