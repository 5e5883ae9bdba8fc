"""Measures the windows' server with poses of 50 robots at 20 Hz for one, two and four viewers, and the loading of pages (`pages.py`).

The windows' server and the API are real processes. The poses come from the real simulator, in which 50 robots drive around, and from a
program that speaks the robot link and moves all 50 robots in every tick, because the simulator may not reach 20 Hz on two busy cores. CPU
is that of both servers, from /proc. Run it as `python benchmarks/gui.py`.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import random
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import aiohttp
import pages

from somrs.access.store import AccessStore, local_token
from somrs.client.addresses import Addresses
from somrs.devices.simulator.link.connection import RobotGaveUp
from somrs.devices.simulator.link.lines import Answer, Ask, Follow, Mover, Poses, RobotStatus, Welcome, encode_line, read_by_server
from somrs.devices.simulator.link.link import RobotLink
from somrs.ports import Reservation

ROBOTS = 50
RATE = 20.0
VIEWERS = (1, 2, 4)
ROUNDS = 3
ROUND_TIME = 5.0
WARM_UP = 1.0
HEADER = struct.Struct("<ddII")


def hall() -> str:
    """Return a site: a hall of 42 by 42 m with robots in rows."""
    floor = "{type: Floor, at: [21, 21, -0.1], Shape: {Form: Box, Width: 42, Depth: 42, Height: 0.1}}"
    storey = f"{{type: Storey, parts: {{Floor1: {floor}}}}}"
    lines = ["map: Hall", "objects:", f"  Building1: {{type: Building, parts: {{Storey1: {storey}}}}}"]
    for i in range(ROBOTS):
        x, y = home(i)
        lines.append(f"  Robot{i}: {{type: PioneerP3DX, at: [{x}, {y}, 0], Price: 10 EUR, Speed: 0.8}}")
        lines.append(f"  Jar{i}: {{type: Jar, at: [{x + 3}, {y + 3}, 0]}}")
    return "\n".join(lines) + "\n"


def home(robot: int) -> tuple[float, float]:
    return 2.0 + 4 * (robot % 10), 2.0 + 8 * (robot // 10)


class Processes:
    """A Repository, a Registry, and the windows of a site without devices. `simulator`: the address of another simulator than its own.
    `authorization`: the headers of a program on this computer."""

    def __init__(self, folder: Path, simulator: str | None = None) -> None:
        self._reservation = Reservation("127.0.0.1", 6)
        self.ports = ports = self._reservation.ports
        self.folder = folder
        self.addresses = Addresses(
            repository=f"http://127.0.0.1:{ports[0]}/repository",
            registry=f"http://127.0.0.1:{ports[1]}/registry",
            task_manager=f"http://127.0.0.1:{ports[2]}/task-manager",
            simulator=simulator or f"127.0.0.1:{ports[5]}",
            api=f"http://127.0.0.1:{ports[4]}/api",
            gui=f"http://127.0.0.1:{ports[3]}",
        )
        AccessStore(folder).renew_local_token()
        self.authorization = {"Authorization": f"Bearer {local_token(folder)}"}
        self._stack = ExitStack()

    def __enter__(self) -> Processes:
        (self.folder / "hall.yaml").write_text(hall())
        self.addresses.write(self.folder)
        self.start("repository", self.ports[0], "--site", str(self.folder / "hall.yaml"))
        self.start("registry", self.ports[1])
        self.servers = [self.start("api", self.ports[4]), self.start("gui", self.ports[3])]
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()
        self._reservation.close()

    def start(self, program: str, port: int, *options: str) -> int:
        """Start a program, and return its process id when it is ready."""
        line = [sys.executable, "-m", "somrs.cli.main", "run", program, "--data", str(self.folder), "--port", str(port), *options]
        process = subprocess.Popen(line, stdout=subprocess.PIPE, env=self._reservation.environment)
        self._stack.callback(process.wait)
        self._stack.callback(process.terminate)
        assert process.stdout is not None
        if not process.stdout.readline():
            raise SystemExit(f"{program} did not start")
        return process.pid

    def spent(self) -> float:
        """Return the CPU seconds of the two servers."""
        fields = [Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2].split() for process in self.servers]
        return sum(int(columns[11]) + int(columns[12]) for columns in fields) / os.sysconf("SC_CLK_TCK")


@dataclass(slots=True)
class ViewerTraffic:
    """The data that a viewer received."""

    ticks: float = 0
    moved: float = 0
    bytes: float = 0


async def watch_poses(processes: Processes, traffic: ViewerTraffic) -> None:
    poses = f"{processes.addresses.gui}/api/poses"
    async with aiohttp.ClientSession(headers=processes.authorization) as session, session.ws_connect(poses, compress=15) as socket:
        async for message in socket:
            if message.type is aiohttp.WSMsgType.BINARY:
                traffic.ticks += 1
                traffic.moved += HEADER.unpack_from(message.data)[3]
                traffic.bytes += len(message.data)


@contextmanager
def simulate_viewers(processes: Processes, viewers: int) -> Iterator[list[ViewerTraffic]]:
    traffic = [ViewerTraffic() for _ in range(viewers)]
    tasks = [asyncio.create_task(watch_poses(processes, viewer_traffic)) for viewer_traffic in traffic]
    yield traffic
    for task in tasks:
        task.cancel()


async def measure_viewers(processes: Processes, title: str) -> None:
    """Print the cost of each number of viewers for the two servers."""
    shares: dict[int, list[float]] = {viewers: [] for viewers in (0, *VIEWERS)}
    received: dict[int, list[ViewerTraffic]] = {viewers: [] for viewers in VIEWERS}
    for _ in range(ROUNDS):
        for viewers, viewer_shares in shares.items():
            with simulate_viewers(processes, viewers) as traffic:
                await asyncio.sleep(WARM_UP)
                cpu_before, started_at = processes.spent(), time.monotonic()
                start = [(viewer_traffic.ticks, viewer_traffic.moved, viewer_traffic.bytes) for viewer_traffic in traffic]
                await asyncio.sleep(ROUND_TIME)
                elapsed = time.monotonic() - started_at
                viewer_shares.append((processes.spent() - cpu_before) / elapsed)
                for viewer_traffic, (ticks, moved, size) in zip(traffic, start, strict=True):
                    received[viewers].append(
                        ViewerTraffic((viewer_traffic.ticks - ticks), (viewer_traffic.moved - moved), (viewer_traffic.bytes - size))
                    )
    print(f"\n{title:44} {'of a core':>10} {'each more':>10} {'ticks/s':>8} {'moved':>6} {'kB/s':>6}")
    before_share, before_viewers = 0.0, 0
    for viewers, viewer_shares in shares.items():
        share = sum(viewer_shares) / len(viewer_shares)
        increase = f"{(share - before_share) / (viewers - before_viewers):10.2%}" if viewers else f"{'':10}"
        totals = received.get(viewers, [])
        ticks = sum(viewer_traffic.ticks for viewer_traffic in totals) / max(1, len(totals)) / ROUND_TIME
        moved = sum(viewer_traffic.moved for viewer_traffic in totals) / max(1, sum(viewer_traffic.ticks for viewer_traffic in totals))
        size = sum(viewer_traffic.bytes for viewer_traffic in totals) / max(1, len(totals)) / ROUND_TIME / 1000
        print(f"  {f'{viewers} viewers':42} {share:10.2%} {increase} {ticks:8.1f} {moved:6.1f} {size:6.1f}", flush=True)
        before_share, before_viewers = share, viewers


# The robots


async def drive(address: str, robot: int) -> None:
    """Have a robot drive around a square until cancelled."""
    host, _, port = address.rpartition(":")
    x, y = home(robot)
    async with RobotLink(host, int(port), f"Robot{robot}", rate=0) as link:
        while True:
            for px, py in ((x + 1.5, y), (x + 1.5, y + 4.5), (x, y + 4.5), (x, y)):
                with contextlib.suppress(RobotGaveUp):
                    await link.drive_to(px, py)


async def measure_real() -> None:
    with tempfile.TemporaryDirectory() as folder, Processes(Path(folder)) as processes:
        processes.start("simulator", processes.ports[5], "--speed", "1")
        address = processes.addresses.simulator
        assert address is not None
        driving = [asyncio.create_task(drive(address, robot)) for robot in range(ROBOTS)]
        await measure_viewers(processes, "the real simulator, at real time")
        for task in driving:
            task.cancel()
        await asyncio.wait(driving)


@asynccontextmanager
async def player() -> AsyncIterator[str]:
    """Speak the operator's part of the robot link, and report robots that move all the time."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(encode_line(Welcome(time=0.0)))
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):  # cancelled at the end
            await reader.readuntil(b"\n")
            while not isinstance(request := read_by_server(await reader.readuntil(b"\n")), Ask) or not isinstance(request.question, Follow):
                pass
            writer.write(encode_line(Answer(id=request.id)))
            await play(writer)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        host, port = server.sockets[0].getsockname()
        yield f"{host}:{port}"


async def play(writer: asyncio.StreamWriter) -> None:
    movers = tuple(Mover(name=f"Robot{i}", numbers=9) for i in range(ROBOTS))
    robots = {mover.name: RobotStatus(activity="DriveTo") for mover in movers}
    robot_indices, started_at, tick = tuple(range(ROBOTS)), time.monotonic(), 0
    while True:
        clock = time.monotonic()
        values = []
        for i in range(ROBOTS):
            x, y = home(i)
            turn = 0.5 * clock + i
            pose = (x + math.cos(turn), y + math.sin(turn), 0.0, turn % math.tau - math.pi)
            arm = (math.sin(turn), 0.57 + 0.2 * random.random(), 0.3, 0.0, 0.05)
            values += [round(value, 4) for value in (*pose, *arm)]
        line = Poses(time=clock, clock=clock, movers=movers if not tick else None, moved=robot_indices, values=tuple(values), robots=robots)
        writer.write(encode_line(line))
        await writer.drain()
        tick += 1
        robots = {}
        await asyncio.sleep(max(0.0, started_at + tick / RATE - time.monotonic()))


async def measure_played() -> None:
    async with player() as address:
        with tempfile.TemporaryDirectory() as folder, Processes(Path(folder), address) as processes:
            await measure_viewers(processes, "played: every robot moved in every tick")


def main() -> None:
    print(f"The servers' CPU for poses of {ROBOTS} robots at {RATE:.0f} Hz; {ROUNDS} rounds of {ROUND_TIME:.0f} s each")
    asyncio.run(measure_played())
    asyncio.run(measure_real())
    pages.main()


if __name__ == "__main__":
    main()
