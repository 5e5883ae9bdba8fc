"""The robot link between the simulator and those who control robots, over real sockets and with the real simulation."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing, asynccontextmanager
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.devices.simulator.link.commands import (
    Approach,
    Command,
    DriveTo,
    Fault,
    Grip,
    LookAround,
    LookAt,
    Place,
    PutDown,
    RobotState,
    Sense,
    Status,
    Stop,
)
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import (
    HEARTBEAT,
    LONGEST,
    Ask,
    Break,
    ClientLine,
    Follow,
    Hello,
    Look,
    Mover,
    Order,
    Poses,
    RobotStatus,
    State,
    Unheard,
    Ways,
    Welcome,
    encode_line,
    read_by_client,
    read_by_server,
)
from somrs.devices.simulator.link.link import OperatorLink, RobotLink
from somrs.devices.simulator.server.connections import MOST_STATES
from somrs.devices.simulator.server.pictures import Pictures
from somrs.devices.simulator.server.server import Server
from somrs.devices.simulator.world.kinds import WorldKind
from somrs.devices.simulator.world.physics import PhysicsScene
from somrs.errors import RemoteError, SimulationError, UsageError, WireError
from somrs.ontology.objects import Object
from tests.support.command import somrs
from tests.support.hang import HANG_TIME
from tests.support.robot_lab import SITE, run, simulator

numbers = st.floats(allow_nan=False, allow_infinity=False)
names = st.text(max_size=20)
commands: st.SearchStrategy[Command] = st.one_of(
    st.builds(DriveTo, x=numbers, y=numbers, yaw=st.none() | numbers),
    st.builds(Approach, object=names),
    st.builds(Grip, object=names),
    st.builds(Place, support=names, x=st.none() | numbers, y=st.none() | numbers),
    st.builds(Sense, radius=st.none() | numbers),
    st.builds(LookAt, x=numbers, y=numbers, z=numbers, object=st.none() | names),
    st.builds(LookAround, object=st.none() | names),
    st.sampled_from([PutDown(), Stop(), Status()]),
)
ids = st.integers(-(2**63), 2**63 - 1)
lines: st.SearchStrategy[ClientLine] = st.one_of(
    st.builds(Hello, version=st.integers(0, 9), robot=st.none() | names, rate=st.floats(0, 1e6)),
    st.builds(Order, id=ids, command=commands),
    st.builds(Ask, id=ids, question=st.builds(Look, object=names)),
    st.builds(Ask, id=ids, question=st.builds(Follow, rate=st.floats(0, 1e6))),
    st.builds(Ask, id=ids, question=st.builds(Break, robot=names, fault=st.sampled_from(Fault), delay=st.none() | st.floats(0, 1e9))),
    st.builds(
        Ask,
        id=ids,
        question=st.builds(Ways, robot=names, stops=st.lists(names | st.tuples(numbers, numbers), max_size=3).map(tuple)),
    ),
)


@given(lines)
def test_a_line_is_read_as_it_was_written(line: ClientLine) -> None:
    text = encode_line(line)
    assert text.count(b"\n") == 1
    assert read_by_server(text) == line


@given(st.binary() | st.text().map(str.encode) | lines.map(lambda line: encode_line(line)[:-3]))
def test_what_is_no_line_is_a_wire_error(line: bytes) -> None:
    for read in (read_by_server, read_by_client):
        with contextlib.suppress(WireError):
            read(line)


class RawClient:
    """A client that writes and reads bytes."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    async def read_line(self) -> dict[str, Any]:
        line = await self.reader.readline()
        return dict(json.loads(line)) if line else {}

    async def request(self, line: bytes | dict[str, Any]) -> dict[str, Any]:
        """The answer, with states left out."""
        self.writer.write(line if isinstance(line, bytes) else json.dumps(line).encode() + b"\n")
        while (answer := await self.read_line()).get("say") == "state":
            pass
        return answer

    async def states_until(self, order: Order) -> list[dict[str, Any]]:
        """What it says of itself until the order is carried out."""
        self.writer.write(encode_line(order))
        states = []
        while (line := await self.read_line())["say"] == "state":
            states.append(line)
        return states


async def raw_client(server: Server, hello: dict[str, Any] | None = None) -> RawClient:
    client = RawClient(*await asyncio.open_connection(server.host, server.port))
    if hello is not None:
        assert (await client.request({"say": "hello", "version": 1, **hello}))["say"] == "welcome"
    return client


def test_a_robot_carries_a_jar_and_says_where_it_is_all_the_time() -> None:
    async def test() -> None:
        states: list[RobotState] = []
        async with simulator() as server, RobotLink(server.host, server.port, "Robot1", on_state=states.append) as robot:
            await robot.approach("Jar1")
            result = await robot.grip("Jar1")
            assert result.state.holding == "Jar1"
            await robot.approach("Platform1")
            result = await robot.place("Platform1")
            assert result.state.holding is None
            (jar_sighting,) = [sighting for sighting in result.object_states if sighting.object == "Jar1"]
            assert jar_sighting.support == "Platform1"
            assert jar_sighting.z == pytest.approx(0.3, abs=0.005)
            assert abs(jar_sighting.x - 6.5) < 0.4
            assert robot.state is not None
            assert robot.state.time >= result.state.time
            times = [state.time for state in states]
            assert times == sorted(times)
            assert len(states) > 10
            surroundings = await robot.sense()
            assert "Jar" in [sighting.type for sighting in surroundings.sightings]

    run(test())


def test_a_command_that_cannot_be_carried_out_says_why(world: WorldKind) -> None:
    async def test() -> None:
        async with simulator(world=world) as server, RobotLink(server.host, server.port, "Robot1") as robot:
            for command, reason in (
                (Grip(object="Nothing"), "unknown-object"),
                (PutDown(), "not-holding"),
                (DriveTo(x=4, y=0.8), "unreachable"),
                (DriveTo(x=1e300, y=-1e300), "unreachable"),
                (Grip(object="Table1"), "not-possible"),
            ):
                with pytest.raises(RobotGaveUp) as error_info:
                    await robot.command(command)
                assert error_info.value.reason == reason
                assert error_info.value.state is not None
            assert (await robot.drive_to(2, 2)).state.y == pytest.approx(2, abs=0.03)

    run(test())


def test_a_command_ends_the_one_before_and_stop_stops() -> None:
    async def test() -> None:
        async with simulator(speed=5) as server, RobotLink(server.host, server.port, "Robot1") as robot:
            drive_task = asyncio.create_task(robot.drive_to(7, 5))
            while robot.state is None or robot.state.activity != "DriveTo":
                await asyncio.sleep(0.01)
            stopped = await robot.stop()
            with pytest.raises(RobotGaveUp) as error_info:
                await drive_task
            assert error_info.value.reason == "stopped"
            await asyncio.sleep(0.3)
            final_state = (await robot.status()).state
            assert math.dist((final_state.x, final_state.y), (stopped.state.x, stopped.state.y)) < 0.4

    run(test())


def test_a_robot_has_one_controller_at_a_time() -> None:
    async def test() -> None:
        async with simulator() as server:
            async with RobotLink(server.host, server.port, "Robot1"):
                second = await raw_client(server)
                refused = await second.request({"say": "hello", "version": 1, "robot": "Robot1"})
                assert (refused["say"], refused["reason"]) == ("error", "taken")
                assert await second.read_line() == {}, "and the connection is closed"
                await raw_client(server, {"robot": "Robot2"})
            async with RobotLink(server.host, server.port, "Robot1") as robot:
                assert (await robot.status()).state.x == pytest.approx(2, abs=0.01)

    run(test())


@pytest.mark.parametrize(
    ("first", "reason", "expected_text"),
    [
        (b'{"say":"hello","version":2,"robot":{"new":"form"}}\n', "version", "SO-MRS robot link 1"),
        (b'{"say":"hello","protocol":"other","version":1}\n', "version", "other 1"),
        (b'{"say":"hello","robot":"Robot1"}\n', "hello-first", "version"),
        (b"GET / HTTP/1.1\r\n", "hello-first", "hello"),
        (b'{"say":"command","version":1,"id":1,"command":{"do":"Stop"}}\n', "hello-first", "hello"),
        (b'{"say":"hello","version":1,"robot":"Robot9"}\n', "unknown-robot", "Robot1, Robot2"),
        (b'{"say":"hello","version":1,"rate":-1}\n', "hello-first", "rate"),
    ],
)
def test_a_connection_that_begins_wrongly_is_told_why_and_closed(first: bytes, reason: str, expected_text: str) -> None:
    async def test() -> None:
        async with simulator() as server:
            client = await raw_client(server)
            answer = await client.request(first)
            assert (answer["say"], answer["reason"]) == ("error", reason)
            assert expected_text in answer["description"]
            assert await client.read_line() == {}

    run(test())


def test_malformed_lines_are_answered_and_nothing_breaks() -> None:
    async def test() -> None:
        async with simulator() as server:
            client = await raw_client(server, {"robot": "Robot1"})
            for line in (
                b"\n",
                b"\xff\xfe\n",
                b"{}\n",
                b"[" * 5000 + b"\n",
                b'{"say":"command","id":"x","command":{"do":"Stop"}}\n',
                b"null\n",
            ):
                answer = await client.request(line)
                assert (answer["say"], answer["reason"]) == ("error", "malformed"), line
            for wrong in ({"do": "Fly"}, {"do": "DriveTo", "x": "far", "y": 1}, {"do": "DriveTo", "x": 1}):
                assert (await client.request({"say": "command", "id": 1, "command": wrong}))["reason"] == "malformed"
            assert (await client.request({"say": "command", "id": 2, "command": {"do": "Status"}}))["id"] == 2
            too_long = await client.request(b'{"say":"' + b"x" * LONGEST + b'"}\n')
            assert too_long["reason"] == "too-long"
            assert await client.read_line() == {}
            half = await raw_client(server, {})
            half.writer.write(b'{"say":"ask"')
            half.writer.close()
            async with RobotLink(server.host, server.port, "Robot1") as robot:
                await robot.status()

    run(test())


def test_robots_and_operators_may_say_only_what_is_theirs() -> None:
    async def test() -> None:
        async with simulator() as server:
            operator = await raw_client(server, {})
            assert (await operator.request({"say": "command", "id": 1, "command": {"do": "Stop"}}))["reason"] == "not-allowed"
            robot = await raw_client(server, {"robot": "Robot1"})
            questions = ({"ask": "break", "robot": "Robot1", "fault": "drive"}, {"ask": "ways", "robot": "Robot2", "through": []})
            for question in questions:
                answer = await robot.request({"say": "ask", "id": 7, "question": question})
                assert (answer["reason"], answer["id"]) == ("not-allowed", 7)
            assert (await robot.request({"say": "hello", "version": 1}))["reason"] == "not-allowed"
            assert (await robot.request({"say": "ask", "id": 8, "question": {"ask": "ways", "robot": "Robot1", "through": ["Jar1"]}}))[
                "lengths"
            ]

    run(test())


def test_a_drive_that_dies_under_way_leaves_the_jar_on_the_floor_and_says_where(world: WorldKind) -> None:
    async def test() -> None:
        async with (
            simulator(world=world) as server,
            RobotLink(server.host, server.port, "Robot1") as robot,
            OperatorLink(server.host, server.port) as operator,
        ):
            await operator.schedule("Robot1", Fault.DRIVE, carried=2.0)
            await robot.approach("Jar1")
            gripped = (await robot.grip("Jar1")).state
            with pytest.raises(RobotGaveUp) as error_info:
                await robot.approach("Platform1")
            assert error_info.value.reason == "drive-dead"
            state = error_info.value.state
            assert state is not None
            assert state.faults == (Fault.DRIVE,)
            assert 1.5 < math.dist((state.x, state.y), (gripped.x, gripped.y)) < 2.1
            (jar,) = [sighting for sighting in error_info.value.object_states if sighting.object == "Jar1"]
            truth = await operator.observe("Jar1")
            assert truth.support == jar.support == "Floor1"
            assert math.dist((jar.x, jar.y), (truth.x, truth.y)) < 0.003
            with pytest.raises(RobotGaveUp):
                await robot.drive_to(2, 2)
            await operator.repair("Robot1", Fault.DRIVE)
            await robot.drive_to(2, 2)

    run(test())


def test_a_gripper_that_sticks_once_it_has_put_the_jar_down() -> None:
    async def test() -> None:
        async with (
            simulator() as server,
            RobotLink(server.host, server.port, "Robot1") as robot,
            OperatorLink(server.host, server.port) as operator,
        ):
            with pytest.raises(UsageError, match="one of the two"):
                await operator.schedule("Robot1", Fault.GRIPPER, released=True, carried=1.0)
            await operator.schedule("Robot1", Fault.GRIPPER, released=True)
            await robot.approach("Jar1")
            assert (await robot.grip("Jar1")).state.faults == ()
            await robot.approach("Platform1")
            result = await robot.place("Platform1")
            assert result.state.faults == ()
            assert (await operator.observe("Jar1")).support == "Platform1"
            assert (await robot.status()).state.faults == (Fault.GRIPPER,)
            await robot.approach("Jar1")
            with pytest.raises(RobotGaveUp) as error_info:
                await robot.grip("Jar1")
            assert error_info.value.reason == "gripper-stuck"
            await operator.repair("Robot1", Fault.GRIPPER)
            await robot.grip("Jar1")

    run(test())


def test_a_fault_after_some_time_and_one_that_is_called_off() -> None:
    async def test() -> None:
        async with (
            simulator() as server,
            RobotLink(server.host, server.port, "Robot1") as robot,
            OperatorLink(server.host, server.port) as operator,
        ):
            await operator.schedule("Robot1", Fault.DRIVE, delay=1.0)
            await operator.repair("Robot1", Fault.DRIVE)
            await robot.drive_to(2, 4.5)
            await operator.schedule("Robot1", Fault.DRIVE, delay=1.0)
            start_time = (await operator.clock()).time
            with pytest.raises(RobotGaveUp) as error_info:
                await robot.drive_to(7, 5)
            assert error_info.value.reason == "drive-dead"
            assert error_info.value.state is not None
            assert 1.0 <= error_info.value.state.time - start_time < 3.0
            with pytest.raises(UsageError, match="give the time of the fault"):
                await operator.schedule("Robot1", Fault.DRIVE)
            with pytest.raises(UsageError, match="Robot1, Robot2"):
                await operator.schedule("Robot9", Fault.DRIVE, delay=1)

    run(test())


def test_a_simulator_that_is_slow_is_no_silent_robot() -> None:
    """However long nothing comes: only what the simulator says of the robot counts."""

    async def speak(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\n")
        writer.write(encode_line(Welcome(robot="Robot1", time=0.0)))
        for line in lines:
            await line_permits.acquire()
            writer.write(encode_line(line))
        await ended.wait()
        writer.close()

    async def test() -> None:
        server = await asyncio.start_server(speak, "127.0.0.1", 0)
        host, port = server.sockets[0].getsockname()[:2]
        async with RobotLink(host, port, "Robot1", silence=3 * HEARTBEAT) as robot:
            answer = asyncio.create_task(robot.status())
            for line in lines:
                await asyncio.sleep(0.2)
                assert not robot.silent
                assert not answer.done()
                line_permits.release()
                if isinstance(line, State):
                    await wait_until(lambda: robot.state is not None)
            with pytest.raises(RobotGaveUp, match="has sent nothing for 3 s"):
                await answer
            assert robot.silent
        ended.set()
        server.close()

    state_line = State(state=RobotState(time=1.0, x=1.0, y=2.0, yaw=0.0))
    lines: list[State | Unheard] = [Unheard(), Unheard(), state_line, Unheard(), Unheard(), Unheard()]
    line_permits, ended = asyncio.Semaphore(0), asyncio.Event()
    run(test())


def test_a_silent_robot_is_noticed_and_heard_again_when_repaired() -> None:
    async def test() -> None:
        async with (
            simulator() as server,
            RobotLink(server.host, server.port, "Robot1", silence=1.4) as robot,
            OperatorLink(server.host, server.port) as operator,
        ):
            await operator.schedule("Robot1", Fault.SILENT, delay=1.0)
            with pytest.raises(RobotGaveUp) as error_info:
                await robot.drive_to(7, 5)
            assert error_info.value.reason == "silent"
            assert robot.silent
            assert error_info.value.state is not None
            await operator.repair("Robot1", Fault.SILENT)
            await wait_until(lambda: not robot.silent)
            await robot.drive_to(2, 2)

    run(test())


def test_a_cut_link_is_noticed_at_once_and_made_again_after_repair() -> None:
    async def test() -> None:
        async with (
            simulator() as server,
            RobotLink(server.host, server.port, "Robot1") as robot,
            OperatorLink(server.host, server.port) as operator,
        ):
            await operator.schedule("Robot1", Fault.LINK, delay=1.0)
            with pytest.raises(RobotGaveUp) as error_info:
                await robot.drive_to(7, 5)
            assert error_info.value.reason == "link-lost"
            await asyncio.sleep(0.5)
            assert not robot.connected
            assert (await operator.robots())["Robot1"].faults == (Fault.LINK,)
            await operator.repair("Robot1", Fault.LINK)
            await robot.drive_to(2, 2)

    run(test())


def test_a_robot_whose_controller_is_gone_stops() -> None:
    async def test() -> None:
        async with simulator(speed=4) as server, OperatorLink(server.host, server.port) as operator:
            client = await raw_client(server, {"robot": "Robot1"})
            client.writer.write(encode_line(Order(id=1, command=DriveTo(x=7, y=5))))
            while (await operator.robots())["Robot1"].activity != "DriveTo":
                await asyncio.sleep(0.01)
            client.writer.transport.abort()
            while (await operator.robots())["Robot1"].activity is not None:
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.3)
            first = (await operator.robots())["Robot1"]
            await asyncio.sleep(0.3)
            second = (await operator.robots())["Robot1"]
            assert math.dist((first.x, first.y), (second.x, second.y)) < 0.02

    run(test())


def test_the_link_finds_a_server_that_was_restarted() -> None:
    async def test() -> None:
        async with simulator() as server, RobotLink(server.host, server.port, "Robot1") as robot:
            await robot.drive_to(2, 2)
            await server.stop()
            restarted_server = Server(server.simulation, port=server.port)
            await restarted_server.start()
            await robot.drive_to(2, 2.5)
            await restarted_server.stop()

    run(test())


def test_nobody_there_and_nobody_known() -> None:
    async def test() -> None:
        async with simulator() as server:
            with pytest.raises(RemoteError, match="no robot Robot9; the robots here are: Robot1, Robot2"):
                await RobotLink(server.host, server.port, "Robot9").connect()

    run(test())


def test_operators_see_the_truth_and_move_things() -> None:
    async def test() -> None:
        async with simulator() as server, OperatorLink(server.host, server.port) as operator:
            jar = await operator.observe("Jar1")
            assert jar.support == "Table1"
            assert math.dist((jar.x, jar.y), (1.15, 4)) < 0.01
            await operator.move("Jar1", 3, 3, 0.0)
            await operator.idle()
            assert (await operator.observe("Jar1")).support == "Floor1"
            assert set(await operator.robots()) == {"Robot1", "Robot2"}
            with pytest.raises(UsageError, match="Jar9"):
                await operator.observe("Jar9")
            with pytest.raises(UsageError, match="Table1"):
                await operator.move("Table1", 3, 3, 0)

    run(test())


class PoseFollower:
    """What somebody who follows the poses knows."""

    def __init__(self) -> None:
        self.movers: tuple[Mover, ...] = ()
        self.poses: dict[str, tuple[float, ...]] = {}
        self.robots: dict[str, RobotStatus] = {}
        self.lines: list[Poses] = []

    def add_poses(self, line: Poses) -> None:
        if line.movers is not None:
            self.movers, self.poses = line.movers, {}
        values = iter(line.values)
        for i in line.moved:
            self.poses[self.movers[i].name] = tuple(islice(values, self.movers[i].numbers))
        assert not list(values), "as many numbers as the movers have"
        self.robots.update(line.robots)
        self.lines.append(line)


async def follow(link: OperatorLink, followed: PoseFollower, rate: float = 50.0) -> None:
    async with aclosing(link.poses(rate)) as lines:
        async for line in lines:
            followed.add_poses(line)


@asynccontextmanager
async def following(server: Server, rate: float = 50.0) -> AsyncIterator[tuple[OperatorLink, PoseFollower]]:
    """An operator who follows poses, and knows where everything is."""
    followed = PoseFollower()
    async with OperatorLink(server.host, server.port) as link:
        task = asyncio.create_task(follow(link, followed, rate))
        await wait_until(lambda: followed.poses)
        try:
            yield link, followed
            assert not task.done(), task
        finally:
            task.cancel()
            await asyncio.wait({task})


async def wait_until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(HANG_TIME):
        while not condition():
            await asyncio.sleep(0.01)


def test_who_follows_poses_knows_where_everything_is(world: WorldKind) -> None:
    async def test() -> None:
        async with (
            simulator(speed=20, world=world) as server,
            following(server) as (operator, followed),
            RobotLink(server.host, server.port, "Robot1") as robot,
        ):
            assert set(followed.poses) == {"Robot1", "Robot2", "Jar1", "Anvil1"}
            assert {mover.name: mover.numbers for mover in followed.movers} == {"Robot1": 9, "Robot2": 9, "Jar1": 6, "Anvil1": 6}
            await robot.grip("Jar1")
            await wait_until(lambda: followed.robots["Robot1"].holding == "Jar1")
            x, y, _, yaw, turret, _, reach, *_ = followed.poses["Robot1"]
            jar = followed.poses["Jar1"]
            assert math.dist(jar[:2], (x + reach * math.cos(yaw + turret), y + reach * math.sin(yaw + turret))) < 0.05, "it is in the hand"
            await robot.place("Platform1")
            await operator.idle()
            jar_sighting = await operator.observe("Jar1")
            await wait_until(lambda: math.dist(followed.poses["Jar1"][:3], (jar_sighting.x, jar_sighting.y, jar_sighting.z)) < 0.002)
            moved = {followed.movers[i].name for line in followed.lines[1:] for i in line.moved}
            assert moved == {"Robot1", "Jar1"}, "nothing is said of what stands still"
            await wait_until(lambda: followed.robots["Robot1"] == RobotStatus())

    run(test())


def test_nothing_is_said_while_nothing_moves_but_that_one_is_there() -> None:
    async def test() -> None:
        for speed in (None, 4):
            async with simulator(speed=speed) as server, following(server) as (operator, followed):
                await operator.idle()
                line_count = len(followed.lines)
                await asyncio.sleep(2.2)
                news = followed.lines[line_count:]
                assert 1 <= len(news) <= 4
                assert not any(line.moved or line.values or line.robots for line in news)
                await operator.move("Jar1", 3, 3, 0.0)
                await wait_until(lambda: math.dist(followed.poses["Jar1"][:2], (3, 3)) < 0.05)

    run(test())


def _calculated_time(server: Server) -> float:
    """The time that the physics has come to."""
    assert isinstance(server.simulation.scene, PhysicsScene)
    return float(server.simulation.scene.data.time)


async def wait_until_at_rest(server: Server) -> float:
    """Wait until the world rests, which takes it a second of its time. The time that the physics has come to."""
    last_time = -1.0
    while (now := _calculated_time(server)) != last_time:
        last_time = now
        await asyncio.sleep(0.5)
    return now


def test_in_a_world_at_rest_time_passes_without_any_physics() -> None:
    async def test() -> None:
        async with simulator(speed=4) as server, OperatorLink(server.host, server.port) as operator:
            calculated = await wait_until_at_rest(server)
            request_time, first_time, answer_time = time.monotonic(), (await operator.clock()).time, time.monotonic()
            await asyncio.sleep(1.0)
            second_request_time, last_time = time.monotonic(), (await operator.clock()).time
            assert 4 * (second_request_time - answer_time - 0.5) < last_time - first_time < 4 * (time.monotonic() - request_time + 0.5)
            assert _calculated_time(server) == calculated
            await operator.schedule("Robot2", Fault.GRIPPER, delay=1.0)
            await wait_until(lambda: server.simulation.robots["Robot2"].faults)

    run(test())


def test_a_world_at_rest_moves_again_as_soon_as_there_is_something_to_move() -> None:
    async def test() -> None:
        async with (
            simulator(speed=4) as server,
            following(server) as (_, followed),
            RobotLink(server.host, server.port, "Robot1") as robot,
        ):
            await wait_until_at_rest(server)
            result = await robot.drive_to(2, 2.5)
            assert math.dist((result.state.x, result.state.y), (2, 2.5)) < 0.1
            await wait_until_at_rest(server)
            server.simulation.remove("Table1")
            await wait_until(lambda: followed.poses["Jar1"][2] < 0.1)

    run(test())


def test_poses_come_at_the_rate_that_was_asked_for() -> None:
    async def test() -> None:
        async with (
            simulator(speed=2) as server,
            following(server, 10) as (_, followed),
            RobotLink(server.host, server.port, "Robot1") as robot,
        ):
            drive_task = asyncio.create_task(robot.drive_to(7, 5))
            await wait_until(lambda: len(followed.lines) > 12)
            clocks = [line.clock for line in followed.lines]
            assert clocks[-1] - clocks[2] >= 0.08 * (len(clocks) - 3), "lower bounds only, which a busy machine cannot break"
            await robot.stop()
            with contextlib.suppress(RobotGaveUp):
                await drive_task

    run(test())


def test_a_fault_is_said_to_who_follows() -> None:
    async def test() -> None:
        async with simulator() as server, following(server) as (operator, followed):
            await operator.fault("Robot1", Fault.DRIVE)
            await wait_until(lambda: followed.robots["Robot1"].faults == (Fault.DRIVE,))
            await operator.repair("Robot1", Fault.DRIVE)
            await wait_until(lambda: followed.robots["Robot1"].faults == ())

    run(test())


def test_what_comes_and_goes_makes_another_set_of_movers(world: WorldKind) -> None:
    async def test() -> None:
        async with simulator(world=world) as server, following(server) as (operator, followed):
            server.simulation.add(Object(name="Jar2", type="Jar", values={"PositionX": 1.15, "PositionY": 4.2, "PositionZ": 0.7}))
            await operator.idle()
            await wait_until(lambda: "Jar2" in followed.poses)
            server.simulation.remove("Anvil1")
            await operator.idle()
            await wait_until(lambda: set(followed.poses) == {"Robot1", "Robot2", "Jar1", "Jar2"})

    run(test())


def test_one_who_takes_poses_late_gets_them_as_one() -> None:
    async def test() -> None:
        async with simulator(speed=10) as server, OperatorLink(server.host, server.port) as operator:
            followed = PoseFollower()
            async with aclosing(operator.poses(50)) as lines:
                followed.add_poses(await anext(lines))
                await operator.move("Jar1", 3, 3, 0.0)
                async with RobotLink(server.host, server.port, "Robot1") as robot:
                    result = await robot.drive_to(4, 4)
                await operator.idle()
                await asyncio.sleep(0.2)
                followed.add_poses(await anext(lines))
                assert math.dist(followed.poses["Jar1"][:2], (3, 3)) < 0.05
                assert math.dist(followed.poses["Robot1"][:2], (result.state.x, result.state.y)) < 0.02
                with pytest.raises(UsageError, match="already"):
                    await anext(operator.poses())
            async with aclosing(operator.poses(50)) as lines:
                assert (await anext(lines)).movers, "and one may follow again"

    run(test())


def test_whose_connection_is_lost_follows_anew() -> None:
    async def test() -> None:
        async with simulator() as server, OperatorLink(server.host, server.port) as operator:
            follow_task = asyncio.create_task(follow(operator, followed := PoseFollower()))
            await wait_until(lambda: followed.poses)
            await server.stop()
            with pytest.raises(RobotGaveUp, match="lost"):
                await follow_task
            restarted_server = Server(server.simulation, port=server.port)
            await restarted_server.start()
            async with aclosing(operator.poses()) as new_lines:
                assert (await anext(new_lines)).movers
            await restarted_server.stop()

    run(test())


def test_robots_do_not_follow_poses() -> None:
    async def test() -> None:
        async with simulator() as server:
            robot = await raw_client(server, {"robot": "Robot1"})
            refused = await robot.request({"say": "ask", "id": 1, "question": {"ask": "poses"}})
            assert refused["reason"] == "not-allowed"

    run(test())


def test_a_thing_that_fell_over_is_said_to_lie() -> None:
    async def test() -> None:
        async with simulator(speed=4) as server, following(server) as (operator, followed):
            await operator.move("Jar1", 1.31, 4, 0.7)  # over the table's edge
            await wait_until(lambda: followed.poses["Jar1"][2] < 0.1)
            *_, pitch, roll = followed.poses["Jar1"]
            assert max(abs(pitch), abs(roll)) > 1.0

    run(test())


def test_ways_are_as_long_as_what_is_driven_then() -> None:
    async def test() -> None:
        places: list[RobotState] = []
        async with simulator() as server, RobotLink(server.host, server.port, "Robot1", rate=50, on_state=places.append) as robot:
            first, second = await robot.ways("Jar1", "Platform1")
            assert first is not None
            assert second is not None
            for target, estimate in (("Jar1", first), ("Platform1", second)):
                start_state = robot.state or (await robot.status()).state
                places.clear()
                if target == "Jar1":
                    await robot.grip(target)
                else:
                    await robot.approach(target)
                points = [(start_state.x, start_state.y), *((state.x, state.y) for state in places)]
                driven = sum(math.dist(start, end) for start, end in pairwise(points))
                assert estimate == pytest.approx(driven, abs=0.8)
            assert await robot.ways((20.0, 20.0), "Jar1") == (None, None)
            assert (await robot.ways("Floor1", (3.0, 3.0)))[0] == 0

    run(test())


def test_a_robot_with_a_dead_drive_is_in_the_way_of_others() -> None:
    async def test() -> None:
        async with simulator() as server, OperatorLink(server.host, server.port) as operator:
            free_length = (await operator.ways("Robot1", (6.0, 2.1)))[0]
            assert free_length is not None
            await operator.fault("Robot2", Fault.DRIVE)
            detour = (await operator.ways("Robot1", (6.0, 2.1)))[0]
            assert detour is not None
            assert (await operator.ways("Robot2", "Jar1"))[0] is not None, "it would have to drive that far, if it could"

    run(test())


def test_a_picture_is_a_png_or_there_is_a_clear_word(world: WorldKind) -> None:
    async def test() -> None:
        async with simulator(world=world) as server, OperatorLink(server.host, server.port) as operator:
            message = ""
            try:
                png = await operator.picture("Jar1")
            except SimulationError as error:
                png, message = b"", str(error)
            assert png.startswith(b"\x89PNG") or "OpenGL" in message
            with pytest.raises(UsageError, match="Jar9"):
                await operator.picture("Jar9")

    run(test())


def test_pictures_of_a_robot_that_carries_are_taken_at_that_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test() -> None:
        async with (
            simulator() as server,
            RobotLink(server.host, server.port, "Robot1") as robot,
            OperatorLink(server.host, server.port) as operator,
        ):

            def describe_robot(pictures: Pictures, subject: str | None, width: int) -> bytes:
                state = server.simulation.state("Robot1")
                return json.dumps([subject, state.holding, state.x, state.y]).encode()

            monkeypatch.setattr(Pictures, "take", describe_robot)
            for planned, trouble in (
                ({"robot": "Robot9", "carried": 1.0}, "there is no robot Robot9"),
                ({"robot": "Robot1"}, "takes `robot`, and `carried`"),
                ({"carried": 1.0}, "takes `robot`, and `carried`"),
            ):
                with pytest.raises(UsageError, match=trouble):
                    await operator.picture("Jar1", **planned)
            requests = [asyncio.create_task(operator.picture("Jar1", robot="Robot1", carried=metres)) for metres in (0.0, 1.0)]
            await robot.approach("Jar1")
            await robot.grip("Jar1")
            await robot.approach("Platform1")
            (_, _, *gripped), (subject, holding, *carried) = [json.loads(await request) for request in requests]
            assert (subject, holding) == ("Jar1", "Jar1")
            assert 0.7 < math.dist(gripped, carried) < 1.1
            left = asyncio.create_task(operator.picture("Jar1", robot="Robot1", carried=90.0))
            await robot.place("Platform1")
            assert not left.done()
            left.cancel()

    run(test())


def test_time_passes_as_fast_as_wanted_and_not_at_all_when_nothing_moves() -> None:
    async def passed(speed: float | None) -> float:
        async with simulator(speed) as server, OperatorLink(server.host, server.port) as operator:
            await operator.idle()
            started_at, clock_before = time.monotonic(), (await operator.clock()).time
            await asyncio.sleep(0.6)
            assert (await operator.clock()).speed == speed
            return ((await operator.clock()).time - clock_before) / (time.monotonic() - started_at)

    async def test() -> None:
        # A busy machine may stop this test, or the simulator, for a while: what is asserted is the order of magnitude.
        for speed in (1, 10):
            assert speed / 10 < await passed(speed) < speed * 2
        assert await passed(None) == 0

    run(test())


def test_states_come_at_the_rate_that_was_asked_for_and_not_in_floods() -> None:
    async def test() -> None:
        for rate, speed in ((20, 1), (1000, 20)):
            async with simulator(speed) as server:
                started_at = time.monotonic()
                client = await raw_client(server, {"robot": "Robot1", "rate": rate})
                client.writer.write(encode_line(Order(id=1, command=DriveTo(x=7, y=5))))
                times: list[float] = []
                while len(times) < 10:
                    if (line := await client.read_line())["say"] == "state":
                        times.append(line["state"]["time"])
                # Lower bounds, which a busy machine cannot break. The rate counts simulated time; a heartbeat may come between.
                assert times[-1] - times[0] >= 8 / rate
                assert time.monotonic() - started_at >= 9 / MOST_STATES

    run(test())


def test_a_robot_that_stands_says_so_about_once_a_second_however_often_its_state_was_asked_for() -> None:
    async def test() -> None:
        async with simulator(speed=20) as server:
            drives, stands = [await raw_client(server, {"robot": robot, "rate": 50}) for robot in ("Robot1", "Robot2")]
            started_at = time.monotonic()
            moving_states = await drives.states_until(Order(id=1, command=DriveTo(x=7, y=5)))
            standing_states = await stands.states_until(Order(id=1, command=Status()))
            assert len(moving_states) > 10
            assert 1 <= len(standing_states) <= 2 + (time.monotonic() - started_at) / HEARTBEAT

    run(test())


def test_one_who_does_not_listen_keeps_nobody_waiting() -> None:
    async def test() -> None:
        async with simulator() as server, RobotLink(server.host, server.port, "Robot1") as robot:
            deaf = await raw_client(server, {"robot": "Robot2", "rate": 1000})
            for i in range(3000):
                deaf.writer.write(encode_line(Order(id=i, command=Status())))
            await robot.drive_to(2, 4.5)

    run(test())


def test_the_program_serves_a_map_until_it_is_told_to_end(tmp_path: Path) -> None:
    (tmp_path / "lab.yaml").write_text(SITE)
    line = [sys.executable, "-m", "somrs.cli.main", "run", "simulator", "--site", str(tmp_path / "lab.yaml"), "--speed", "max"]
    with subprocess.Popen(line, stdout=subprocess.PIPE) as program:
        assert program.stdout is not None
        host, _, port = json.loads(program.stdout.readline())["at"].partition(":")

        async def test() -> None:
            async with RobotLink(host, int(port), "Robot2") as robot:
                await robot.drive_to(5, 2)

        run(test())
        program.send_signal(signal.SIGTERM)
        assert program.wait(HANG_TIME) == 0


@pytest.mark.parametrize(
    ("text", "arguments", "expected_text"),
    [
        ("ontology: mine\n", [], "there is no map in it"),
        (SITE, ["--speed", "fast"], "a speed is"),
        (SITE, ["--port", "{taken}"], "cannot listen"),
    ],
)
def test_the_program_says_what_is_wrong(tmp_path: Path, text: str, arguments: list[str], expected_text: str) -> None:
    (tmp_path / "lab.yaml").write_text(text)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        filled_arguments = [argument.format(taken=listener.getsockname()[1]) for argument in arguments]
        ended = somrs("run", "simulator", "--site", tmp_path / "lab.yaml", *filled_arguments)
    assert ended.returncode == 2
    assert expected_text in ended.stderr


def test_who_follows_poses_sees_leaves_move(world: WorldKind) -> None:
    async def test() -> None:
        shape = "Shape: {Form: Box, Width: 0.5, Depth: 1, Height: 0.9}"
        cupboard = f"  Cupboard1: {{type: Cupboard, at: [3, 5.5, 0], turned: -90 deg, {shape}}}\n"
        async with (
            simulator(speed=20, text=SITE.replace("  Jar1:", f"{cupboard}  Jar1:"), world=world) as server,
            following(server) as (operator, followed),
            RobotLink(server.host, server.port, "Robot1") as robot,
        ):
            assert followed.poses["Cupboard1"] == (0.0, 0.0), "two leaves, both shut"
            await robot.open_doors("Cupboard1")
            await operator.idle()
            await wait_until(lambda: min(followed.poses["Cupboard1"]) > 0.7)
            index = next(i for i, mover in enumerate(followed.movers) if mover.name == "Cupboard1")
            assert sum(index in line.moved for line in followed.lines) > 5, "they did not jump"

    run(test())
