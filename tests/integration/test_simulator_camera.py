"""Pictures of the simulated world."""

from __future__ import annotations

import asyncio
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from somrs.client.addresses import Addresses
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.server.simulation import Simulation
from somrs.devices.simulator.world.camera import Camera, close_up, opengl, overview, region, storey_view
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import SimulationError
from somrs.ontology.types import Value
from tests.support.command import somrs
from tests.support.simulated_tower import HEIGHT, tower
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


def pixels(png: bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.int_]]:
    return np.asarray(Image.open(io.BytesIO(png))).astype(int)


def count_red(png: bytes) -> int:
    picture = pixels(png)
    return int(((picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 0] > 2 * picture[..., 2]) & (picture[..., 0] > 90)).sum())


def test_a_picture_of_a_storey_shows_what_is_on_it_and_nothing_above_or_below(gl: str, world: WorldKind) -> None:
    carton: dict[str, Value] = {"Color": "Red", "Shape.Width": 1.0, "Shape.Depth": 1.0, "Shape.Height": 1.0}
    things = [thing("Below", "Carton", 4, 3, 0, **carton)]
    simulation = Simulation(tower(extra_objects=things), ONTOLOGY, world)
    camera = Camera(simulation.scene, 400, 300)

    def red_on(storey: str) -> int:
        span = simulation.span_of_storey(storey)
        assert span is not None
        return count_red(camera.picture(storey_view(simulation.scene, span)))

    assert red_on("Storey1") > 50, "the floor above hides nothing"
    assert red_on("Storey2") == 0
    simulation.add(thing("Above", "Carton", 4, 3, HEIGHT, **carton))
    assert red_on("Storey2") > 50
    camera.close()


def test_a_picture_has_the_width_that_is_asked_for(gl: str) -> None:
    simulation = Simulation(room(), ONTOLOGY, WorldKind.KINEMATIC)
    camera = Camera(simulation.scene, 400, 300)
    assert pixels(camera.picture(width=200)).shape == (150, 200, 3)
    assert pixels(camera.picture()).shape == pixels(camera.picture(width=900)).shape == (300, 400, 3)
    camera.close()


def test_the_command_saves_pictures_of_the_building_a_storey_and_an_object_and_says_what_there_is_not(gl: str, tmp_path: Path) -> None:
    async def test() -> None:
        server = Server(Simulation(tower((2, 2, 0)), ONTOLOGY, WorldKind.KINEMATIC))
        await server.start()
        try:
            Addresses(repository="", registry="", task_manager="", simulator=f"{server.host}:{server.port}").write(tmp_path)
            images = []
            for subject in ((), ("--of", "Storey1"), ("--of", "Robot1")):
                file = tmp_path / "picture.png"
                shown = await asyncio.to_thread(somrs, "picture", file, *subject, "--data", tmp_path)
                assert shown.returncode == 0, shown.stderr
                images.append(file.read_bytes())
            assert len({*images}) == 3
            wrong = await asyncio.to_thread(somrs, "picture", tmp_path / "no.png", "--of", "Storey9", "--data", tmp_path)
            assert wrong.returncode != 0
            assert "Storey9 is not in the simulated world" in wrong.stderr
        finally:
            await server.stop()

    asyncio.run(test())


def test_no_opengl_is_said_not_crashed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(SimulationError, match="no OpenGL is available"):
        opengl()
