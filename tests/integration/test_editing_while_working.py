"""The ontology and the map are edited while tasks run: nobody falls over, and who comes later works with the new words."""

from __future__ import annotations

import pytest

from somrs.ontology.naming import DefinitionKey, Section
from somrs.ontology.types import Constraint, ObjectType
from somrs.protocol.messages.envelope import Header, Message, message_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.knowledge import Alteration, Define, Defined, Definitions, MergeObject, RenameObject, Updated
from somrs.protocol.messages.task_views import Phase
from somrs.runtime.virtual_time import Work
from somrs.service_manager.sdk.orders import Order, ServiceFailed
from tests.support.keeper import renaming
from tests.support.virtual_system import Robot, VirtualSystem

GOAL = "Jar002 isOn Platform001"


def slips(order: Order) -> Work:
    yield 30.0, ServiceFailed("slipped", f"{order.inputs['Object']} isOn Floor001")


def alter(system: VirtualSystem, alteration: Alteration) -> object:
    """Somebody edits; what the Repository answers."""
    id = message_id("editor", system.world.now)
    header = Header(sender="client", recipient="repository", message_id=id, reply_to="client")
    system.world.send(Message(header=header, body=alteration))
    system.world.run(1)
    return next(message.body for message in system.client.received if message.header.relates_to == id)


EDITS: list[Alteration] = [
    renaming(Section.TYPES, "Jar", "Pot"),
    renaming(Section.TYPES, "Platform", "Stage"),
    renaming(Section.TYPES, "PioneerP3DX", "Pioneer"),
    renaming(Section.RELATIONS, "isAdjacentTo", "isBeside"),
    renaming(Section.ATTRIBUTES, "Texture", "Surface"),
    Define(removed=(DefinitionKey(section=Section.TYPES, name="Bottle"), DefinitionKey(section=Section.FUNCTIONS, name="range"))),
    Define(
        definitions=Definitions(
            types=(ObjectType(name="Platform", parent="Support", constraints=(Constraint(attribute="Weight", maximum=9),)),)
        )
    ),
    RenameObject(name="Tin001", to="Tin002"),
    RenameObject(name="Cupboard001", to="Shelf001"),
]


@pytest.mark.parametrize("edit", EDITS, ids=lambda edit: str(edit)[:90])
@pytest.mark.parametrize("fails", [False, True])
def test_a_task_is_accomplished_whatever_is_called_otherwise_meanwhile(edit: Alteration, fails: bool) -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=slips if fails else None), Robot("Robot2", 20, 60))
    task = system.submit(GOAL)
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    assert isinstance(alter(system, edit), Defined | Updated)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
    assert system.map.has_fact("isOn", ("Jar002", "Platform001"))
    assert system.manager.state.replica.version == system.repository.contents.version
    assert set(system.registry.ontology.types) == set(system.repository.contents.ontology.types)
    system.restart_manager()
    system.world.run(10)
    (next_view,) = system.finish(system.submit("Jar001 isOn Platform001"))
    assert next_view.outcome is Outcome.ACCOMPLISHED


NEW_NAMES = [
    (RenameObject(name="Jar002", to="Krug"), "Krug isOn Platform001"),
    (RenameObject(name="Platform001", to="Stage001"), "Jar002 isOn Stage001"),
    (MergeObject(name="Jar002", into="LostJar"), "LostJar isOn Platform001"),
]


@pytest.mark.parametrize(("edit", "goal"), NEW_NAMES)
@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("moment", ["planned", "arranging", "executing"])
def test_a_task_goes_on_with_the_new_names_of_its_objects(edit: RenameObject | MergeObject, goal: str, fails: bool, moment: str) -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=slips if fails else None), Robot("Robot2", 20, 60), planning=2.0)
    task = system.submit(GOAL)
    if moment == "arranging":
        assert system.world.run(60, lambda: bool(system.view(task).steps))
    elif moment == "executing":
        assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    assert alter(system, edit) == Updated(version=1)
    (view,) = system.finish(task)
    assert (view.phase, view.outcome) == (Phase.ENDED, Outcome.ACCOMPLISHED), view.explanation
    assert view.effect == goal
    name, _, place = goal.split()
    assert system.map.has_fact("isOn", (name, place))
    assert not system.repository.contents.reservations.claimants
    (next_view,) = system.finish(system.submit(f"Tin001 isOn {place}"))
    assert next_view.outcome is Outcome.ACCOMPLISHED


def test_a_task_that_waits_for_another_goes_on_with_the_new_names() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60), Robot("Robot2", 20, 60))
    first, second = system.submit(GOAL), system.submit("Jar002 isOn Cupboard002")
    assert system.world.run(60, lambda: system.view(second).phase is Phase.WAITING)
    assert alter(system, MergeObject(name="Jar002", into="LostJar")) == Updated(version=1)
    views = system.finish(first, second)
    assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED, Outcome.ACCOMPLISHED]
    assert views[1].effect == "LostJar isOn Cupboard002"
    assert system.map.has_fact("isOn", ("LostJar", "Cupboard002"))


def test_the_words_of_a_task_may_be_renamed_and_come_back_before_it_needs_them() -> None:
    system = VirtualSystem(Robot("Robot1", 10, 60, works=slips), Robot("Robot2", 20, 60))
    task = system.submit("?Jar: Jar isOn Platform001")
    assert system.world.run(60, lambda: any(step.state is State.EXECUTING for step in system.view(task).steps))
    alter(system, renaming(Section.TYPES, "Jar", "Pot"))
    assert isinstance(alter(system, renaming(Section.TYPES, "Pot", "Jar")), Defined)
    (view,) = system.finish(task)
    assert view.outcome is Outcome.ACCOMPLISHED
