"""What the camera of a robot, or one that stands still, reports of what it sees."""

from __future__ import annotations

from msgspec import structs

from somrs.devices.simulator.link.commands import CommandDone, RobotState, Sense
from somrs.devices.simulator.world.recognition import FURNITURE, RECOGNISED, landmarks, sightings
from somrs.devices.simulator.world.scene import Scene
from somrs.devices.simulator.world.vision import clear_points, view


def sensed(scene: Scene, state: RobotState, viewer: str, command: Sense) -> CommandDone:
    """What the viewer sees now. `state`: that of the viewer."""
    states, clear = view(scene, viewer, command.radius), clear_points(scene, viewer, command.expected)
    if not command.furniture:
        recognised = sightings(scene, viewer, states, command.like)
        return CommandDone(state=state, object_states=landmarks(scene, states), sightings=recognised, clear=clear)
    recognised = sightings(scene, viewer, states, command.like, (*RECOGNISED, *FURNITURE))
    nameless = tuple(structs.replace(sighting, support=None, container=None) for sighting in recognised)
    return CommandDone(state=state, sightings=nameless, clear=clear)
