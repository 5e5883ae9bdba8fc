"""Recognition in symbolic worlds: what devices see of the world, which the map may not have."""

from __future__ import annotations

import pytest

from somrs.devices.symbolic.agent import SymbolicAgent
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.ontology.objects import Change, Fact, FactAdded, FactRemoved, Object, ObjectAdded, ValueSet
from somrs.ontology.types import Value
from somrs.protocol.messages.frp import Outcome
from tests.support.virtual_system import SITE, VirtualSystem

EYE = 'types:\n  Eye: {parent: Camera, driver: "somrs.devices.symbolic.device:SymbolicDevice"}\n'
SEEING_SITE = SITE.replace("facts:", "  Eye1: {type: Eye, at: [0.5, 0.5, 2]}\nfacts:")


class Seeing:
    """A system with a symbolic camera, whose world differs from the map.

    Jar002 is not on Cupboard001, where the map has it, but on Cupboard002; and there is a green jar on Cupboard001.
    """

    def __init__(self) -> None:
        self.system = VirtualSystem(site=EYE + SEEING_SITE)
        contents = self.system.repository.contents
        green: dict[str, Value] = {"PositionX": 1.0, "PositionY": 0.8, "PositionZ": 0.8, "Color": "Green"}
        changes: list[Change] = [
            FactRemoved(Fact("isOn", ("Jar002", "Cupboard001"))),
            FactAdded(Fact("isOn", ("Jar002", "Cupboard002"))),
            ValueSet("Jar002", "PositionY", 4.2),
            ObjectAdded(Object(name="Hidden", type="Jar", values=green)),
            FactAdded(Fact("isOn", ("Hidden", "Cupboard001"))),
        ]
        self.world = SymbolicWorld(contents.ontology, contents.map.changed(changes))
        agent = SymbolicAgent(name="Eye1", world=self.world, services=self.world.offers("Eye1"), seconds=1.0)
        self.system.world.add("devices/Eye1", self.system._new_device(agent.profile()), agent.carry_out)
        self.system.world.run(5)


@pytest.fixture
def seeing() -> Seeing:
    return Seeing()


def test_a_device_with_a_camera_offers_what_recognises(seeing: Seeing) -> None:
    assert {service.name for service in seeing.world.offers("Eye1")} == {"RecognizeSituation", "LookAt", "LookInto"}
    assert seeing.world.offers("Robot1") == ()


def test_recognising_changes_nothing_in_the_world(seeing: Seeing) -> None:
    before = seeing.world.map
    assert seeing.world.perform("RecognizeSituation", {"Object": "Jar002"}, "Eye1") is None
    assert seeing.world.map == before
    assert [(action.service, action.changes) for action in seeing.world.actions] == [("RecognizeSituation", ())]


def test_things_are_seen_by_their_looks_and_furniture_by_its_name(seeing: Seeing) -> None:
    situation = seeing.world.result("LookAt", {"Place": "Cupboard002"}, "Eye1")
    assert "Jar00" not in situation
    assert "?Seen0: Jar isOn Cupboard002" in situation
    assert "?Seen1" in situation
    assert "?Seen0.Shape.Radius" in situation
    assert seeing.world.result("LookAt", {"Place": "Platform001"}, "Eye1") == "Eye1.Working = TRUE"


def test_what_nobody_knew_comes_to_the_map_when_somebody_looks(seeing: Seeing) -> None:
    system = seeing.system
    (view,) = system.finish(system.submit("?Thing: Jar isOn Cupboard001", recognise=True))
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    (name,) = [name for name, object in system.map.objects.items() if object.values.get("Color") == "Green"]
    assert name != "Hidden"
    assert system.map.has_fact("isOn", (name, "Cupboard001"))


def test_an_object_is_found_where_it_is(seeing: Seeing) -> None:
    system = seeing.system
    (view,) = system.finish(system.submit("Jar002.Unknown = FALSE", recognise=True))
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert system.map.has_fact("isOn", ("Jar002", "Cupboard002"))
    assert not system.map.has_fact("isOn", ("Jar002", "Cupboard001"))
