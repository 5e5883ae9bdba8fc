"""Pictures of the simulated world: now, or as soon as a robot has carried an object for some distance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from somrs.devices.simulator.link.lines import Picture
from somrs.devices.simulator.server.carrying import CarriedDistance
from somrs.devices.simulator.server.connections import Connection
from somrs.devices.simulator.server.simulation import Simulation
from somrs.errors import SimulationError, UsageError, WireError

if TYPE_CHECKING:
    from somrs.devices.simulator.world.camera import Camera


@dataclass(slots=True)
class _PlannedPicture:
    connection: Connection
    id: int
    subject: str | None
    width: int
    robot: str
    carried: float
    carried_distance: CarriedDistance = field(default_factory=CarriedDistance)


class Pictures:
    """Takes pictures of a simulation. The camera is created with the first picture, because it needs OpenGL."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._camera: Camera | None = None
        self._planned: list[_PlannedPicture] = []

    def take(self, subject: str | None, width: int) -> bytes:
        """A PNG of the world, of a storey, or of an object and its surroundings.

        Raises UsageError for an unknown object, WireError without OpenGL.
        """
        # The camera needs MuJoCo, which not every kind of world loads.
        from somrs.devices.simulator.world.camera import Camera, close_up, storey_view

        scene = self._simulation.scene
        span = self._simulation.span_of_storey(subject) if subject is not None else None
        if subject is not None and span is None and subject not in scene.world.solids:
            raise UsageError(f"{subject} is not in the simulated world, and no storey")
        try:
            self._camera = self._camera or Camera(scene)
            if span is not None:
                return self._camera.picture(storey_view(scene, span), width)
            return self._camera.picture(close_up(scene, subject) if subject is not None else None, width)
        except SimulationError as error:
            raise WireError("no-graphics", str(error)) from None

    def plan(self, connection: Connection, id: int, request: Picture) -> None:
        """Plan a picture whose time a robot's carrying decides. Raises UsageError for an unknown robot, or without one."""
        robot, carried = request.robot, request.carried
        if robot is None or carried is None:
            raise UsageError("a picture at a later time takes `robot`, and `carried`: the metres for which the robot has carried an object")
        if robot not in self._simulation.linked:
            raise UsageError(f"there is no robot {robot}; there are {', '.join(self._simulation.linked) or 'none'}")
        self._planned.append(_PlannedPicture(connection, id, request.subject, request.width, robot, carried))

    def due(self) -> Iterator[tuple[Connection, int, str | None, int]]:
        """Remove and yield the planned pictures that are due, with subject and width. Call it once per control period."""
        for picture in list(self._planned):
            if picture.connection.writer.transport.is_closing() or picture.robot not in self._simulation.linked:
                self._planned.remove(picture)
                continue
            metres = picture.carried_distance.measure(self._simulation.state(picture.robot))
            if metres is not None and metres >= picture.carried:
                self._planned.remove(picture)
                yield picture.connection, picture.id, picture.subject, picture.width

    def close(self) -> None:
        """Free the camera."""
        if self._camera is not None:
            self._camera.close()
