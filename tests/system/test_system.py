"""Whole systems of real processes, with the simulator and over SOAP/HTTP: what the README promises."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from somrs.cli.import_commands import importer, write_import
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.client.simulator_link import operator_link
from somrs.client.trace import Line
from somrs.demo.scenarios import play
from somrs.deployment.supervision import keep_running
from somrs.deployment.system import System
from somrs.devices.simulator.link.commands import Fault
from somrs.devices.simulator.link.link import OperatorLink
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.errors import FormulaError, UsageError
from somrs.ontology.files.dump import dump_map
from somrs.ontology.files.loading import upper
from somrs.ontology.objects import Fact
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from tests.support import warm
from tests.support.accomplishing import accomplish, finished
from tests.support.command import program
from tests.support.hang import HANG_TIME
from tests.support.paths import ROOT, SCENARIO_1, SHARED
from tests.support.simulated_tower import HEIGHT, tower
from tests.support.simulator_room import thing

pytestmark = pytest.mark.long

OFFICE = SHARED / "sites" / "office.building.yaml"


@asynccontextmanager
async def running(
    data: Path, *site: Path, world: WorldKind = WorldKind.PHYSICS, speed: str = "max"
) -> AsyncIterator[tuple[System, Client, OperatorLink]]:
    async with (
        System(site, data, speed=speed, world=world, launcher=warm.launcher()) as system,
        Client(system.addresses) as client,
        operator_link(system.addresses) as operator,
    ):
        yield system, client, operator


def lines_of(folder: Path) -> list[Line]:
    return [msgspec.json.decode(line, type=Line) for line in (folder / "messages.jsonl").read_bytes().splitlines()]


EACH_WORLD = pytest.mark.parametrize("world", [WorldKind.KINEMATIC, pytest.param(WorldKind.PHYSICS, marks=pytest.mark.slow)])
"""The scenarios that are not in the paper are about messages: in `make test`, things move without contacts and friction."""


@EACH_WORLD
def test_a_transaction_survives_dead_robots_a_dead_task_manager_and_a_client_that_changes_its_mind(
    tmp_path: Path, world: WorldKind
) -> None:
    console = Console(file=(tmp_path / "said.txt").open("w"), width=150)
    code = asyncio.run(play("2", tmp_path / "out", None, console, launcher=warm.launcher(), world=world))
    assert code == 0, (tmp_path / "said.txt").read_text()
    output = (tmp_path / "said.txt").read_text()
    assert "NO" not in output.split("Checks")[1]
    assert "<svg" in (tmp_path / "out" / "timeline.svg").read_text()


@EACH_WORLD
def test_robots_and_a_person_achieve_together_what_none_can_alone(tmp_path: Path, world: WorldKind) -> None:
    console = Console(file=(tmp_path / "said.txt").open("w"), width=150)
    folder = tmp_path / "out"
    code = asyncio.run(play("3", folder, None, console, launcher=warm.launcher(), world=world))
    output = (tmp_path / "said.txt").read_text()
    assert code == 0, output
    assert "NO" not in output.split("Checks")[1]
    executed = [line.recipient for line in lines_of(folder) if line.type == "Execute"]
    assert executed == [
        "Robot1.OpenDoor",
        "Patrol1.RecognizeSituation",
        "Scale001.WeighObject",
        "Robot2.TransferObject",
        "Anna.SealJar",
    ]
    ET.parse(folder / "messages.svg")
    if "no pictures" not in output:
        assert sorted(picture.stem for picture in folder.glob("?.png")) == ["A", "B", "C", "D", "E"]


def conversation(folder: Path) -> list[Line]:
    """What was said but for Progress; first two are asked, and one of them gets the contract."""
    lines = [line for line in lines_of(folder) if line.type != "Progress"]
    types = [line.type for line in lines]
    assert types[:4] == ["Arrange", "Arrange", "Terms", "Terms"]
    assert sorted(types[4:6]) == ["Accept", "Cancel"]
    assert len({line.transaction for line in lines}) == 1
    ET.parse(folder / "messages.svg")
    assert (folder / "map-before.yaml").read_text() != (folder / "map-after.yaml").read_text()
    return lines


def test_a_system_with_a_kinematic_world_does_the_same(tmp_path: Path) -> None:
    async def test() -> None:
        async with running(tmp_path, SCENARIO_1, world=WorldKind.KINEMATIC) as (_, client, operator):
            view = await accomplish(client, "Jar002 isOn Platform001")
            assert view.outcome == "accomplished", view.explanation
            jar = await operator.observe("Jar002")
            assert (jar.support, jar.z) == ("Platform001", 0.3)

    asyncio.run(test())


def test_the_papers_scenario_as_a_program_without_opengl(tmp_path: Path) -> None:
    """All goes well; everything is there but the pictures."""
    line = [sys.executable, "-m", "somrs.cli.main", "demo", "1", "--out", str(tmp_path / "out")]  # OpenGL is chosen when it is imported
    env = {**os.environ, "MUJOCO_GL": "disable", "SOMRS_GRAPHICS": "disable"}
    result = subprocess.run(line, capture_output=True, text=True, env=env, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "no pictures" in result.stdout
    assert not list((tmp_path / "out").glob("*.png"))
    assert [line.type for line in conversation(tmp_path / "out")][6:] == ["Execute", "Completed", "End"]


def test_the_papers_scenario_with_a_drive_that_breaks(tmp_path: Path) -> None:
    console = Console(file=(tmp_path / "said.txt").open("w"), width=150)
    folder = tmp_path / "out"
    code = asyncio.run(play("1b", folder, None, console, launcher=warm.launcher()))
    assert code == 0, (tmp_path / "said.txt").read_text()
    lines = conversation(folder)
    types = [line.type for line in lines]
    assert types[6:] == ["Execute", "Failed", "Arrange", "Terms", "Accept", "Execute", "Completed", "End", "End"]
    failed = lines[types.index("Failed")]
    second_arrange = lines[types.index("Arrange", 6)]
    for axis in "XYZ":
        position_match = re.search(rf"Jar002\.Position{axis} = [-\d.]+", str(failed.body["situation"]))
        assert position_match is not None
        assert position_match[0] in str(second_arrange.body["precondition"])
    assert {line.recipient for line in lines if line.type == "End"} == {"Robot1.TransferObject", "Robot2.TransferObject"}
    assert failed.sender != second_arrange.recipient
    if "no pictures" not in (tmp_path / "said.txt").read_text():
        assert sorted(picture.stem for picture in folder.glob("?.png")) == ["A", "B", "C", "D", "E", "F"]


def test_an_unknown_scenario_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="7"):
        asyncio.run(play("7", tmp_path / "out", None))


@pytest.mark.skipif(not OFFICE.exists(), reason="the office is not in ../shared/sites")
def test_the_office(tmp_path: Path) -> None:
    """Two delivery robots, two tasks at once, and one for something that is nowhere."""
    import_site = importer(OFFICE)
    assert import_site is not None
    office = tmp_path / "office.map.yaml"
    write_import(import_site, OFFICE, office)
    parcel = tmp_path / "parcel.yaml"
    parcel.write_text(
        "uses: [office.map.yaml]\n"
        "map: Parcels\n"
        "objects:\n"
        "  Carton001: {type: Carton, at: [7.0, -3.5, 0]}\n"
        "  Carton002: {type: Carton, at: [7.0, -3.5, 0]}\n"
        "facts:\n"
        "  - Carton001 isOn supplies\n"
    )

    async def run() -> None:
        async with running(tmp_path / "run", parcel) as (_, client, operator):
            first = await client.submit(Submit(effect="Coke001 isOn lounge"))
            second = await client.submit(Submit(effect="Carton001 isOn coe"))
            views = await asyncio.wait_for(asyncio.gather(finished(client, first), finished(client, second)), HANG_TIME)
            assert [view.outcome for view in views] == [Outcome.ACCOMPLISHED] * 2, views
            assert (await operator.observe("Coke001")).support == "lounge"
            assert (await operator.observe("Carton001")).support == "coe"
            nowhere = await accomplish(client, "Carton002 isOn lounge")
            assert nowhere.outcome is Outcome.FAILED
            assert "Carton002" in nowhere.explanation
            with pytest.raises(FormulaError, match="Coke001"):
                await client.submit(Submit(effect="Coke007 isOn lounge"))

    asyncio.run(run())


def test_a_new_kind_of_device_joins_while_the_system_runs(tmp_path: Path) -> None:
    """The tutorial docs/tutorials/your-own-device.md, with the file that it is about."""
    data = tmp_path / "run"
    tutorial = (ROOT / "docs" / "tutorials" / "your-own-device.md").read_text()
    command_match = re.search(r'somrs do "(.+)"', tutorial)
    assert command_match is not None
    effect = command_match[1]

    async def run() -> None:
        async with running(data, SCENARIO_1, world=WorldKind.KINEMATIC) as (_, client, operator):
            with pytest.raises(FormulaError, match="wasWashedBy"):
                await client.submit(Submit(effect=effect))
            washer = subprocess.Popen(
                [sys.executable, ROOT / "examples" / "jar_washer.py", "--name", "Washer001", "--data", data], stdout=subprocess.PIPE
            )
            try:
                assert washer.stdout is not None
                ready = json.loads(await asyncio.to_thread(washer.stdout.readline))
                assert ready["ready"] == "Washer001"
                view = await accomplish(client, effect)
                assert view.outcome is Outcome.ACCOMPLISHED, view.explanation
                assert [step.service_type for step in view.steps] == ["TransferObject", "WashJar", "TransferObject"]
                assert view.steps[1].service == "Washer001.WashJar"
                assert (await operator.observe("Jar002")).support == "Platform001"
            finally:
                washer.send_signal(signal.SIGTERM)
                assert await asyncio.to_thread(washer.wait, HANG_TIME) == 0
            assert "Washer001.WashJar" not in {offer.service for offer in await client.services()}
            late_view = await accomplish(client, "Jar003 wasWashedBy Washer001", waits=False)
            assert late_view.outcome is Outcome.FAILED
            assert "wasWashedBy" in late_view.explanation

    asyncio.run(run())


def test_the_repository_survives_a_kill_and_its_map_is_gone_on_with_by_its_own_site_only(tmp_path: Path) -> None:
    """What was acknowledged is there when the same data folder is started again."""
    other_site = tmp_path / "other.yaml"
    other_site.write_text(SCENARIO_1.read_text())

    async def run() -> None:
        async with running(tmp_path / "run", SCENARIO_1, world=WorldKind.KINEMATIC) as (system, client, _):
            with pytest.raises(UsageError, match=r"in use by a system that runs.*--data"):
                async with System([SCENARIO_1], tmp_path / "run", launcher=warm.launcher()):
                    pass
            late = await asyncio.to_thread(program, "up", str(SCENARIO_1), "--fresh", "--data", str(tmp_path / "run"))
            assert late.returncode == 2
            assert "in use by a system that runs" in late.stderr
            assert Addresses.read(tmp_path / "run") == system.addresses, "the one that runs can still be found"
            assert (tmp_path / "run" / "repository.sqlite").exists(), "`--fresh` deletes nothing of a system that runs"
            view = await accomplish(client, "Jar002 isOn Platform001")
            assert view.outcome is Outcome.ACCOMPLISHED
            system.programs["repository"].process.kill()
        with pytest.raises(UsageError, match="--fresh"):
            async with System([other_site], tmp_path / "run", launcher=warm.launcher()):
                pass
        async with running(tmp_path / "run", SCENARIO_1, world=WorldKind.KINEMATIC) as (_, client, operator):
            assert (await client.query("Jar002 isOn Platform001")).rows
            assert (await operator.observe("Jar002")).support == "Platform001", "the world is built from the map that was kept"

    asyncio.run(run())


def test_a_robot_that_falls_silent_with_the_jar_ends_the_task_and_is_not_asked_again(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(tmp_path / "run", SCENARIO_1, world=WorldKind.KINEMATIC) as (_, client, operator):
            await operator.schedule("Robot1", Fault.SILENT, carried=1.0)
            view = await accomplish(client, "Jar002 isOn Platform001", waits=False)
            assert view.outcome is Outcome.FAILED
            assert "sent nothing" in view.explanation
            assert (await client.query("Robot1.Working = FALSE")).rows
            second_view = await accomplish(client, "Jar003 isOn Platform001")
            assert second_view.outcome is Outcome.ACCOMPLISHED, second_view.explanation
            assert second_view.steps[0].service == "Robot2.TransferObject"

    asyncio.run(run())


def test_whatever_is_killed_is_started_again(tmp_path: Path) -> None:
    """One process after the other, and then the one that they come out of, which ends them all; then a task, as if nothing had been."""

    async def run() -> None:
        async with running(tmp_path / "run", SCENARIO_1, world=WorldKind.KINEMATIC) as (system, client, _):
            notices: list[str] = []
            supervisor = asyncio.create_task(keep_running(system, notices.append))
            for name, program in system.programs.items():
                program.process.kill()
                async with asyncio.timeout(HANG_TIME):
                    while f"{name} is back" not in notices:
                        await asyncio.sleep(0.05)
            (launcher,) = {
                int(Path(f"/proc/{child.process.pid}/stat").read_text().rpartition(")")[2].split()[1]) for child in system.programs.values()
            }
            os.kill(launcher, signal.SIGKILL)
            async with asyncio.timeout(HANG_TIME):
                while {notices.count(f"{name} is back") for name in system.programs} != {2}:
                    await asyncio.sleep(0.05)
            supervisor.cancel()
            assert f"Robot1 ended (signal SIGKILL; see {tmp_path / 'run' / 'logs' / 'Robot1.log'}); starting it again" in notices
            async with asyncio.timeout(HANG_TIME):
                while len(await client.services()) < 2:  # the robots' leases are with the Registry that was killed
                    await asyncio.sleep(0.1)
            assert (await accomplish(client, "Jar002 isOn Platform001")).outcome is Outcome.ACCOMPLISHED

    asyncio.run(run())


LATE_LAMP = """
from somrs.errors import DeviceError
from somrs.service_manager.sdk.device import Device, Situation, Task, service


class Lamp(Device):
    type = "Lamp"

    async def open(self) -> None:
        if not (self.data / "on").exists():
            raise DeviceError("the lamp is not connected")

    @service("MoveTo", duration="1 s")
    async def move(self, task: Task) -> Situation:
        return None
"""


def test_devices_that_share_a_process_come_back_with_it_and_one_that_does_not_start_holds_up_nobody(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "lamp.py").write_text(LATE_LAMP)
    site = tmp_path / "site.yaml"
    types = f"types:\n  Lamp: {{parent: StationaryDevice, driver: '{tmp_path / 'lamp.py'}:Lamp'}}\n"
    lamp = "  Lamp001: {type: Lamp, at: [1, 7, 0], Shape: {Form: Box, Width: 0.1, Depth: 0.1, Height: 0.1}}\n"
    site.write_text(SCENARIO_1.read_text().replace("objects:\n", f"{types}\nobjects:\n{lamp}", 1))
    data = tmp_path / "run"

    async def run() -> None:
        async with (
            System([site], data, speed="max", world=WorldKind.KINEMATIC, launcher=warm.launcher(), devices_per_process=10) as system,
            Client(system.addresses) as client,
        ):
            assert "Lamp001 did not start: the lamp is not connected; it is tried again" in caplog.messages
            addresses = {offer.provider: offer.address for offer in await client.services()}
            assert set(addresses) == {"Robot1", "Robot2"}
            notices: list[str] = []
            supervisor = asyncio.create_task(keep_running(system, notices.append))
            (data / "on").touch()
            system.programs["devices-1"].process.kill()
            async with asyncio.timeout(HANG_TIME):
                while "devices-1 is back" not in notices:
                    await asyncio.sleep(0.05)
            offers = {offer.provider: offer.address for offer in await client.services()}
            assert set(offers) == {"Robot1", "Robot2", "Lamp001"}
            assert offers.items() >= addresses.items(), "coordinators find the devices where they were"
            assert (await accomplish(client, "Jar002 isOn Platform001")).outcome is Outcome.ACCOMPLISHED
            supervisor.cancel()

    asyncio.run(run())


def test_a_system_that_cannot_start_says_why_and_leaves_nothing_running(tmp_path: Path) -> None:
    site = tmp_path / "empty.yaml"
    site.write_text("ontology: empty\n")

    async def run() -> None:
        system = System([site], tmp_path / "run", launcher=warm.launcher())
        with pytest.raises(UsageError, match="no map"):
            async with system:
                pass
        assert all(program.process.returncode is not None for program in system.programs.values())

    asyncio.run(run())


def test_a_robot_delivers_to_another_storey(tmp_path: Path) -> None:
    site = tmp_path / "tower.yaml"
    jar, lies = thing("Jar1", "Jar", 2.0, 5.0, 0.74), Fact("isOn", ("Jar1", "Table1"))
    site.write_text(dump_map(tower((2, 2, 0), extra_objects=[jar], extra_facts=[lies]), upper(), "tower"))

    async def test() -> None:
        async with running(tmp_path, site, world=WorldKind.KINEMATIC) as (_, client, operator):
            view = await accomplish(client, "Jar1 isOn Table2")
            assert view.outcome == "accomplished", view.explanation
            assert (await operator.observe("Jar1")).support == "Table2"
            assert (await client.query(f"Robot1.PositionZ = {HEIGHT:g} AND Jar1.PositionZ > {HEIGHT:g}")).rows
            await operator.fault("Lift1", Fault.DRIVE)
            view = await accomplish(client, "Jar1 isOn Table1", waits=False)
            assert view.outcome == "failed"
            assert "Lift1 is out of order" in view.explanation
            await operator.repair("Lift1", Fault.DRIVE)
            view = await accomplish(client, "Jar1 isOn Table1")
            assert view.outcome == "accomplished", view.explanation

    asyncio.run(test())
