"""The kinds of simulated worlds, and the making of one."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # so that the command line, which offers the kinds, starts fast
    from somrs.devices.simulator.world.scene import Scene
    from somrs.ontology.map import Map
    from somrs.ontology.types import Ontology


class WorldKind(StrEnum):
    """What moves a simulated world."""

    PHYSICS = "physics"
    """Forces, contacts and friction, computed by MuJoCo."""
    KINEMATIC = "kinematic"
    """Robots drive as they are told, and things follow hands: for many robots."""


def make_scene(kind: WorldKind, map: Map, ontology: Ontology) -> Scene:
    """The world of a map. Raises SimulationError."""
    # Only the world of this kind is imported: the other one does not need MuJoCo.
    if kind is WorldKind.KINEMATIC:
        from somrs.devices.simulator.world.kinematics import KinematicScene

        return KinematicScene(map, ontology)
    from somrs.devices.simulator.world.physics import PhysicsScene

    return PhysicsScene(map, ontology)
