"""What befalls the machine: programs that are stopped, disks that are full or cannot be written, clocks that jump, files that are damaged.

Each but the first has a system of its own.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

from somrs.deployment.supervision import keep_running
from somrs.errors import SomrsError, UsageError
from somrs.kernel.codec import Schema
from somrs.kernel.component import Stateful
from somrs.kernel.durability import JournalCodec
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.protocol.messages.submission import Submit
from somrs.registry.component import SCHEMA as REGISTRY
from somrs.repository.component import SCHEMA as REPOSITORY
from somrs.scheduling.component import SCHEMA as SCHEDULER
from somrs.scheduling.store import orders_journal
from somrs.service_manager.participant.participant import SCHEMA as SERVICE_MANAGER
from somrs.storage.journal import Journal
from somrs.storage.repository_store import repository_journal
from somrs.task_manager.manager import SCHEMA as TASK_MANAGER
from verification.attack.target import PATIENCE, Defect, Skipped, Target, attacked_system, expect

GOALS = ("Jar002 isOn Platform001", "Jar002 isOn Cupboard001")

FLIPS = 200
"""The places of each file in which a bit is flipped, one at a time."""

RECOVERY_TIME = 300.0
"""Seconds within which a program is started again, and a system recovers, also on a busy machine."""

SMALL_DISK = 96 * 2**20
"""Bytes of a disk that is filled."""

MACHINE = Path(__file__).with_name("machine.c")
"""What programs load (`LD_PRELOAD`) so that their time of day jumps, or their disk cannot be written."""


# Programs that are stopped


async def stopped_programs_are_replaced(target: Target) -> None:
    """A program that stands still (SIGSTOP) holds up no other one, and is replaced."""
    notices: list[str] = []
    supervising = asyncio.create_task(keep_running(target.system, notices.append))
    try:
        for name in [*target.system.programs]:
            await _stop(target, name, notices)
            await _recovered(target)
    finally:
        supervising.cancel()
        await asyncio.gather(supervising, return_exceptions=True)


async def _stop(target: Target, name: str, notices: list[str]) -> None:
    process_id = target.system.programs[name].process.pid
    os.kill(process_id, signal.SIGSTOP)
    try:
        if name != "api":
            answer = await target.request(target.api, path="/api/tasks")
            expect(answer.status in (200, 503), f"while {name} stands still, the API answers {answer.status}: {answer.text[:200]}")
        await _until(lambda: f"{name} is back" in notices, f"{name} stands still, and is not replaced: {notices[-3:]}")
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process_id, signal.SIGCONT)


# Disks


async def a_full_disk_stops_nobody_for_good(folder: Path) -> None:
    async with _small_disk(folder) as disk, attacked_system(disk / "data") as target:
        await _accomplish(target, GOALS[0])
        filler = disk / "filler"
        with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
            while True:
                file.write(bytes(4096))
        await _refuses_then_goes_on(target, filler.unlink)


async def a_disk_that_cannot_be_written_stops_nobody_for_good(folder: Path) -> None:
    marker = folder / "read-only"
    async with _machine(folder, MACHINE_READ_ONLY=marker) as target:
        await _accomplish(target, GOALS[0])
        marker.touch()
        await _refuses_then_goes_on(target, marker.unlink)


async def _refuses_then_goes_on(target: Target, mend: Callable[[], object]) -> None:
    """While nothing can be stored, what only reads is answered, and what changes something is refused; afterwards all goes on."""
    try:
        refused_count = 0
        for number in range(200):  # there may be room in the files themselves
            try:
                async with asyncio.timeout(PATIENCE):
                    await target.client.update(UpdateMap(situation=f"Jar002.Weight = {number + 1} g"))
            except SomrsError:
                refused_count += 1
        expect(refused_count, "nothing is refused, although nothing can be stored")
        await _look_at_tasks(target)
        await target.client.rows()
    finally:
        mend()
    await _recovered(target)
    await _accomplish(target, GOALS[1])


async def _look_at_tasks(target: Target) -> None:
    for _ in range(int(PATIENCE)):
        answer = await target.request(target.api, path="/api/tasks")
        if answer.status == 200:
            return
        await asyncio.sleep(1.0)
    raise Defect(f"while nothing can be stored, the list of tasks is {answer.status}: {answer.text[:600]}")


@contextlib.asynccontextmanager
async def _small_disk(folder: Path) -> AsyncIterator[Path]:
    folder.mkdir(parents=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK}", "none", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        raise Skipped("only root can mount a small disk")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


# Clocks


async def a_time_of_day_that_jumps_ends_nothing(folder: Path) -> None:
    """Tasks are accomplished while the time of day jumps, forward and back, also by programs that are started again then."""
    offset = folder / "offset"
    async with _machine(folder, MACHINE_OFFSET=offset) as target:
        for number, seconds in enumerate((3600, -3600, 0, 86400, -86400)):
            task = asyncio.create_task(_accomplish(target, GOALS[number % 2]))
            await asyncio.sleep(0.2)
            offset.write_text(str(seconds))
            shown = subprocess.run([sys.executable, "-c", "import time; print(time.time())"], check=True, capture_output=True).stdout
            expect(abs(float(shown) - seconds - time.time()) < PATIENCE, f"the time of day is not {seconds} s wrong")
            await task
            for name in ("repository", "registry", "task-manager"):
                target.system.programs[name].process.kill()
                await target.system.programs[name].process.wait()
                await target.system.restart(name)
            await _recovered(target)


@contextlib.asynccontextmanager
async def _machine(folder: Path, **files: Path) -> AsyncIterator[Target]:
    """A system whose programs have the machine that `machine.c` makes of these files."""
    folder.mkdir(parents=True)
    library = folder / "machine.so"
    compiler = shutil.which("cc")
    if compiler is None:
        raise Skipped("there is no C compiler (cc): install gcc")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(MACHINE), "-ldl"], check=True)
    variables = {"LD_PRELOAD": str(library)} | {name: str(path) for name, path in files.items()}
    os.environ.update(variables)
    try:
        async with attacked_system(folder / "data") as target:
            yield target
    finally:
        for name in variables:
            del os.environ[name]


# Files


async def damaged_files_are_noticed(folder: Path) -> None:
    """With a bit flipped anywhere, a file of a component is refused with its name, or has what it had."""
    async with attacked_system(folder / "data") as target:
        for goal in GOALS:
            await _accomplish(target, goal)
    draw = random.Random(1)
    for file, (schema, open_journal) in _journals(folder / "data").items():
        whole = _content(file, schema, open_journal)
        content = file.read_bytes()
        for place in draw.sample(range(len(content)), FLIPS):
            damaged = bytearray(content)
            damaged[place] ^= 1 << draw.randrange(8)
            copy = folder / file.name
            copy.write_bytes(damaged)
            shutil.copy(file.with_name(f"{file.name}-mark"), copy.with_name(f"{copy.name}-mark"))
            try:
                found = _content(copy, schema, open_journal)
            except UsageError as error:
                expect(str(copy) in str(error), f"{file.name}: with byte {place} damaged, the file is not named: {error}")
            else:
                expect(found == whole, f"{file.name}: that byte {place} is damaged is not noticed")
            finally:
                for left_file in folder.glob(f"{file.name}*"):
                    left_file.unlink()


OpenJournal = Callable[[Path, str], Journal]
"""Opens a file that was written for a setting."""


def _journals(data: Path) -> dict[Path, tuple[Schema, OpenJournal]]:
    """The journals of a data folder: the schema of each, and how it is opened."""

    def journal_of(schema: Schema) -> OpenJournal:
        return lambda path, setting: Journal(path, schema, setting)

    by_name: dict[str, tuple[Schema, OpenJournal]] = {
        "repository.sqlite": (REPOSITORY, lambda path, setting: repository_journal(path)),
        "registry.sqlite": (REGISTRY, journal_of(REGISTRY)),
        "task-manager.sqlite": (TASK_MANAGER, journal_of(TASK_MANAGER)),
        "orders.sqlite": (SCHEDULER, lambda path, setting: orders_journal(path)),
    }
    of_devices = {file: (SERVICE_MANAGER, journal_of(SERVICE_MANAGER)) for file in sorted((data / "devices").glob("*.sqlite"))}
    return {data / name: kind for name, kind in by_name.items()} | of_devices


def _content(file: Path, schema: Schema, open_journal: OpenJournal) -> bytes:
    """What a component has from its file, as bytes. Raises UsageError."""
    try:
        with contextlib.closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as db:
            setting, address = db.execute("SELECT setting, address FROM life").fetchone()
    except (sqlite3.Error, TypeError, UnicodeDecodeError):  # the component says what is wrong
        setting, address = "", "http://127.0.0.1/"
    journal = open_journal(file, str(setting))
    try:
        journaled, was_there = journal.begin(str(address), _refuse)
        expect(was_there, "a component has begun anew")
        return JournalCodec(schema).encode_snapshot(journaled)
    finally:
        journal.close()


def _refuse(address: str) -> Stateful:
    raise UsageError(f"the component at {address} has lost its file")


# Parts


async def _accomplish(target: Target, goal: str) -> None:
    task = await target.client.submit(Submit(effect=goal), patience=PATIENCE)
    await _until_async(lambda: _has_ended(target, task), f"{goal} does not end")
    outcome = (await target.client.read_task(task)).view.outcome
    expect(outcome == "accomplished", f"{goal} is {outcome}")


async def _has_ended(target: Target, task: str) -> bool:
    return (await target.client.read_task(task)).view.outcome is not None


async def _recovered(target: Target) -> None:
    """Return when the system is well again. Raises Defect, with what is wrong, when it is not."""
    problem = "it has not been looked at"
    end = time.monotonic() + RECOVERY_TIME
    while time.monotonic() < end:
        try:
            await target.check()
        except (SomrsError, OSError) as error:
            problem = str(error)
            await asyncio.sleep(1.0)
        else:
            return
    raise Defect(f"the system does not recover: {problem}")


async def _until(condition: Callable[[], bool], problem: str) -> None:
    async def holds() -> bool:
        return condition()

    await _until_async(holds, problem)


async def _until_async(condition: Callable[[], Awaitable[bool]], problem: str) -> None:
    end = time.monotonic() + RECOVERY_TIME
    while not await condition():
        if time.monotonic() > end:
            raise Defect(problem)
        await asyncio.sleep(0.1)
