"""One upgrade: submits tasks to the last release, kills it, and continues with the current code."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import signal
import sys
from dataclasses import dataclass, field
from pathlib import Path

from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.errors import RemoteError, UsageError
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase, TaskRow
from verification.upgrade_runs.release import ROOT

UP_TIME = 300.0
"""Seconds within which a system has to start, also on a busy machine."""

END_TIME = 600.0
"""Seconds within which tasks have to end after the upgrade. They take about ten; a task that takes longer is stuck."""

LONGEST = 8.0
"""The maximum time from the first task to the kill, in seconds."""

UNDER_WAY = 3.0
"""The approximate duration of a task, in seconds: a task that was submitted within this time before the kill is running then."""

SNAPSHOT = Path(__file__).with_name("snapshot.py")

GOALS = ("letter lies harbour", "crate lies mill", "letter lies harbour AND crate lies mill", "letter lies market", "crate lies market")


@dataclass(slots=True, kw_only=True)
class Result:
    """The result of an upgrade. `problem` is empty if it passed. `task_count`: the number of tasks that were running at the kill."""

    seed: int
    killed_at: float
    task_count: int = 0
    problem: str = ""
    ended: dict[str, str] = field(default_factory=dict)


class Tree:
    """A system that runs with the code in a folder."""

    def __init__(self, tree: Path, site: Path, data: Path, log: Path) -> None:
        self._tree, self._site, self._data, self._log = tree, site, data, log
        self._process: asyncio.subprocess.Process | None = None
        self._kept: list[int] = []
        """The processes that outlive the system: the world, and its stopped parent."""

    async def start(self, world: str | None = None) -> None:
        """Start the system in the given world or one of its own, and return when it is ready. Raises UsageError with the system's output if
        it does not start."""
        with self._log.open("ab") as log:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "verification.upgrade_runs.up",
                str(self._site),
                str(self._data),
                *([world] if world is not None else []),
                cwd=self._tree,
                env=self._environment,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                start_new_session=True,
            )
        assert self._process.stdout is not None
        async with asyncio.timeout(UP_TIME):
            first_line = await self._process.stdout.readline()
        if not first_line.startswith(b"up:"):
            await self._process.wait()
            raise UsageError(self._log.read_text(errors="replace").strip()[-2000:] or "it ended at once")

    async def write_snapshots(self) -> None:
        """Replace the records in the journals by snapshots, as after hours of operation. Raises UsageError with the program's errors."""
        program = await asyncio.create_subprocess_exec(
            sys.executable, str(SNAPSHOT), str(self._data), env=self._environment, stderr=asyncio.subprocess.PIPE
        )
        _, errors = await program.communicate()
        if program.returncode:
            raise UsageError(f"no snapshots were written: {errors.decode(errors='replace')[-2000:]}")

    @property
    def _environment(self) -> dict[str, str]:
        return {**os.environ, "PYTHONPATH": f"{self._tree / 'src'}{os.pathsep}{self._tree}"}

    async def kill(self) -> None:
        """SIGKILL all programs at the same time, as a power failure does, except the world, which ends when its parent ends."""
        assert self._process is not None, "it was started"
        self._process.send_signal(signal.SIGSTOP)  # it must not restart programs
        world = next(id for id, words in processes(self._data) if b"world" in words)
        launcher = _parent(world)
        os.kill(launcher, signal.SIGSTOP)
        self._kept = [launcher, world]
        while killed := [id for id, _ in processes(self._data) if id != world]:
            for id in killed:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(id, signal.SIGKILL)
            await asyncio.sleep(0.05)
        await self._process.wait()

    async def end(self) -> None:
        """SIGKILL all programs of the system."""
        for id in self._kept:
            with contextlib.suppress(ProcessLookupError):
                os.kill(id, signal.SIGKILL)
        if self._process is None or self._process.returncode is not None:
            return
        self._process.send_signal(signal.SIGSTOP)
        for id, _ in processes(self._data):
            with contextlib.suppress(ProcessLookupError):
                os.kill(id, signal.SIGKILL)
        await self._process.wait()


def _parent(process: int) -> int:
    """Return the process id of the parent process."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return int(fields[1])


def processes(data: Path) -> list[tuple[int, list[bytes]]]:
    """Return the processes of the systems of a data folder, each with the words of its command line. A launcher gives the programs that it
    forks a title, which has spaces between the words."""
    matches = []
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").split() if entry.name.isdigit() else []
        except OSError:  # it has just ended
            continue
        if str(data).encode() in words and int(entry.name) != os.getpid():
            matches.append((int(entry.name), words))
    return matches


async def run(seed: int, release: Path, site: Path, folder: Path) -> Result:
    """Play the upgrade of a seed."""
    chance = random.Random(seed)
    result = Result(seed=seed, killed_at=chance.uniform(0.0, LONGEST))
    data = folder / f"{seed}"
    log = folder / f"{seed}.log"
    old, new = Tree(release, site, data, log), Tree(ROOT, site, data, log)
    try:
        await old.start()
        world = Addresses.read(data).world
        result.task_count = len(await _state_tasks(chance, data, result.killed_at))
        await old.kill()
        if seed % 2:
            await old.write_snapshots()
        await new.start(world)
        await _finish_tasks(data, result)
    except (UsageError, RemoteError, TimeoutError) as error:
        result.problem = str(error) or f"{type(error).__name__}: the run did not finish"
    finally:
        await old.end()
        await new.end()
    return result


async def _state_tasks(chance: random.Random, data: Path, seconds: float) -> list[TaskRow]:
    """Submit tasks at random moments for so many seconds. Return those that are running then."""
    moments = sorted([0.0, *(chance.uniform(max(0.0, seconds - UNDER_WAY), seconds) for _ in range(chance.randint(1, 3)))])
    async with Client(Addresses.read(data)) as client:
        passed = 0.0
        for moment in moments:
            await asyncio.sleep(moment - passed)
            passed = moment
            await client.submit(Submit(effect=chance.choice(GOALS)))
        await asyncio.sleep(seconds - passed)
        return [row for row in await client.rows() if row.phase is not Phase.ENDED]


async def _finish_tasks(data: Path, result: Result) -> None:
    """Wait until every task has ended, and check the outcomes."""
    async with Client(Addresses.read(data)) as client, asyncio.timeout(END_TIME):
        rows = await client.rows()
        while any(row.phase is not Phase.ENDED for row in rows):
            await asyncio.sleep(0.2)
            rows = await client.rows()
    result.ended = {row.effect: str(row.outcome) for row in rows}
    wrong = [row for row in rows if row.outcome is not Outcome.ACCOMPLISHED]
    if wrong:
        result.problem = "; ".join(f"{row.effect} ended {row.outcome}: {row.explanation}" for row in wrong)
