"""Pictures of the simulated world."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.camera import Camera, close_up, opengl, overview, region
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import SimulationError
from tests.support.simulator_room import ONTOLOGY, room, thing


@pytest.fixture(scope="module")
def gl() -> str:
    try:
        return opengl()
    except SimulationError as error:
        pytest.skip(str(error))


def test_pictures_show_the_room(gl: str, world: WorldKind) -> None:
    simulation = Simulation(room(), ONTOLOGY, world)
    camera = Camera(simulation.scene, 400, 300)
    views = (overview(simulation.scene), region(simulation.scene, 6.5, 1.5, 1.5), close_up(simulation.scene, "Robot1"))
    pictures = [np.asarray(Image.open(io.BytesIO(camera.picture(view)))) for view in views]
    assert all(picture.shape == (300, 400, 3) and picture.std() > 15 for picture in pictures)
    simulation.add(thing("Cup1", "Cup", 6.5, 1.5, 0.3, Color="Green"))
    new_picture = np.asarray(Image.open(io.BytesIO(camera.picture(views[1]))))
    green = (new_picture[..., 1] > new_picture[..., 0] * 1.5) & (new_picture[..., 1] > new_picture[..., 2] * 1.3)
    assert green.sum() > 20, "what appears in the world appears in its pictures"
    camera.close()


def test_no_opengl_is_said_not_crashed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(SimulationError, match="no OpenGL is available"):
        opengl()
