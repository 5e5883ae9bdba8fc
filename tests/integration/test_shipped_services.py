"""Tasks that need several of the shipped service types, planned and done on virtual time in a symbolic world."""

from __future__ import annotations

import pytest

from somrs.devices.symbolic.agent import SymbolicAgent
from somrs.devices.symbolic.world import SymbolicWorld
from somrs.ontology.services import ServiceKind
from somrs.protocol.messages.frp import Outcome
from tests.support.building import wide_building
from tests.support.virtual_system import VirtualSystem

SITE = (
    wide_building("Test")
    + """
  Cupboard001: {type: Cupboard, at: [1, 1, 0], Shape: {Form: Box, Width: 0.5, Depth: 1, Height: 0.8}}
  Table001: {type: Table, at: [8, 2, 0], Shape: {Form: Box, Width: 1, Depth: 1, Height: 0.7}}
  Door001: {type: Door, at: [5, 5, 0], Shape: {Form: Box, Width: 0.1, Depth: 1, Height: 2}, Open: false}
  Entrance: {type: Place, at: [4, 4]}
  Jar001: {type: Jar, at: [8, 2, 0.7]}
  Jar002: {type: Jar, at: [1, 1, 0.06]}
  Robot1: {type: PioneerP3DX, at: [3, 3], Charge: 40}
  Robot2: {type: PioneerP3DX, at: [5, 3], Charge: 90}
facts:
  - Jar001 isOn Table001
  - Jar002 isIn Cupboard001
"""
)


def _system() -> tuple[VirtualSystem, SymbolicWorld]:
    """A system whose robots offer all physical service types of the upper ontology, as far as the symbolic world does them."""
    system = VirtualSystem(site=SITE)
    contents = system.repository.contents
    world = SymbolicWorld(contents.ontology, contents.map)
    services = [service for service in contents.ontology.services.values() if service.kind is ServiceKind.PHYSICAL]
    for name in ("Robot1", "Robot2"):
        agent = SymbolicAgent(name=name, world=world, services=services, seconds=10.0)
        system.world.add(f"devices/{name}", system._new_device(agent.profile()), agent.carry_out)
    system.world.run(5)
    return system, world


@pytest.mark.parametrize(
    ("goal", "actions"),
    [
        ("Jar001 isIn Cupboard001", ["OpenCupboard", "PutInto"]),
        ("Jar001 isIn Cupboard001 AND Cupboard001.Open = FALSE", ["OpenCupboard", "PutInto", "CloseCupboard"]),
        ("Jar002 isOn Table001", ["OpenCupboard", "TakeOutOf"]),
        ("Jar002 isOn Table001 AND Jar001 isIn Cupboard001", ["OpenCupboard", "PutInto", "TakeOutOf"]),
        ("Door001.Open = TRUE", ["OpenDoor"]),
        ("Robot2 isAt Entrance", ["MoveTo"]),
        ("Robot1.Charge >= 80", ["ChargeBattery"]),
        ("Robot1.Charge = 100 AND Robot1 isAt Entrance", ["ChargeBattery", "MoveTo"]),
        ("Jar001 isOn Floor001", ["TransferObject"]),
    ],
)
def test_a_goal_is_reached_with_the_services_that_it_needs(goal: str, actions: list[str]) -> None:
    system, world = _system()
    (view,) = system.finish(system.submit(goal))
    assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
    assert sorted(action.service for action in world.actions) == sorted(actions)
    assert world.rejected == []


def test_a_shut_cupboard_is_opened_once_for_two_jars() -> None:
    system, world = _system()
    (view,) = system.finish(system.submit("Jar001 isIn Cupboard001 AND Jar002 isOn Table001 AND Cupboard001.Open = FALSE"))
    assert view.outcome is Outcome.ACCOMPLISHED
    order = [action.service for action in world.actions]
    assert order[0] == "OpenCupboard"
    assert order[-1] == "CloseCupboard"
    assert sorted(order[1:-1]) == ["PutInto", "TakeOutOf"]
