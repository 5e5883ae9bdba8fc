"""The programs of a system come out of one process: each is a process like any other, and none outlives whoever wanted it."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from somrs.deployment.launcher import Launcher, LauncherProcess, Process, spawn_launcher
from somrs.errors import RemoteError
from tests.support import warm
from tests.support.paths import SCENARIO_1


def run_with_launcher(
    use: Callable[[Launcher], Awaitable[None]], start_launcher: Callable[[], LauncherProcess] = warm.begin_launcher
) -> None:
    async def run() -> None:
        launcher = Launcher(start_launcher())
        try:
            await use(launcher)
        finally:
            await launcher.stop()

    asyncio.run(run())


async def repository(launcher: Launcher, data: Path) -> Process:
    """One that runs until it is told to end."""
    program = await launcher.start(
        ["run", "repository", "--site", str(SCENARIO_1), "--data", str(data)], data.with_suffix(".log"), os.environ
    )
    assert b"ready" in await program.stdout.readline()
    return program


def runs(pid: int) -> bool:
    """Whether there is such a process; one that nobody has asked how it ended has no command line."""
    try:
        return bool(Path(f"/proc/{pid}/cmdline").read_bytes())
    except FileNotFoundError:
        return False


def wait_for_exit(pid: int) -> None:
    while runs(pid):
        time.sleep(0.02)


def test_a_program_writes_where_it_is_to_and_its_end_is_told(tmp_path: Path) -> None:
    async def use(launcher: Launcher) -> None:
        well = await launcher.start(["schema"], tmp_path / "well.log", os.environ)
        badly = await launcher.start(["no-such-command"], tmp_path / "badly.log", os.environ)
        assert b"$schema" in await well.stdout.read()
        assert await well.wait() == 0
        assert await badly.stdout.read() == b""
        assert await badly.wait() == badly.returncode == 2
        assert "no-such-command" in (tmp_path / "badly.log").read_text()
        assert (tmp_path / "well.log").read_text() == ""
        with pytest.raises(ProcessLookupError):
            badly.send_signal(signal.SIGTERM)
        badly.kill()

    run_with_launcher(use, spawn_launcher)


def test_each_has_an_environment_of_its_own(tmp_path: Path) -> None:
    async def use(launcher: Launcher) -> None:
        wide = await launcher.start(["--help"], tmp_path / "log", {**os.environ, "COLUMNS": "200"})
        narrow = await launcher.start(["--help"], tmp_path / "log", {**os.environ, "COLUMNS": "60"})
        wides, narrows = (await wide.stdout.read()).splitlines(), (await narrow.stdout.read()).splitlines()
        assert max(map(len, narrows)) <= 60 < max(map(len, wides))

    run_with_launcher(use)


def test_many_are_started_at_the_same_time(tmp_path: Path) -> None:
    async def use(launcher: Launcher) -> None:
        programs = await asyncio.gather(*(launcher.start(["schema"], tmp_path / f"{n}.log", os.environ) for n in range(20)))
        outputs = await asyncio.gather(*(program.stdout.read() for program in programs))
        assert len({program.pid for program in programs}) == 20
        assert len({*outputs}) == 1
        assert outputs[0]
        assert {await program.wait() for program in programs} == {0}

    run_with_launcher(use)


def test_who_looks_at_the_processes_sees_what_each_is(tmp_path: Path) -> None:
    async def use(launcher: Launcher) -> None:
        program = await repository(launcher, tmp_path / "data")
        line = Path(f"/proc/{program.pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
        assert line.startswith("somrs run repository --site")
        assert os.readlink(f"/proc/{program.pid}/fd/0") == os.devnull, "nobody is there to type anything"
        assert os.getsid(program.pid) == program.pid, "Ctrl-C is for who started the system, and not for each of its programs"
        program.send_signal(signal.SIGTERM)
        assert await program.wait() == 0

    run_with_launcher(use)


def test_what_is_killed_ends_by_the_signal(tmp_path: Path) -> None:
    async def use(launcher: Launcher) -> None:
        program = await repository(launcher, tmp_path / "data")
        assert program.returncode is None
        program.kill()
        assert await program.wait() == -signal.SIGKILL
        second_program = await repository(launcher, tmp_path / "data")
        assert second_program.pid != program.pid

    run_with_launcher(use)


def test_when_the_launcher_is_killed_all_end_and_another_starts_them_again(tmp_path: Path) -> None:
    async def use(launcher: Launcher) -> None:
        program = await repository(launcher, tmp_path / "data")
        os.kill(int(Path(f"/proc/{program.pid}/stat").read_text().rpartition(")")[2].split()[1]), signal.SIGKILL)
        assert await program.wait() == -signal.SIGKILL
        await repository(launcher, tmp_path / "data")

    run_with_launcher(use)


def test_a_start_that_the_launcher_does_not_live_to_see_is_refused(tmp_path: Path) -> None:
    async def use(launcher: Launcher) -> None:
        await launcher.start(["schema"], tmp_path / "log", os.environ)
        assert launcher.pid is not None
        os.kill(launcher.pid, signal.SIGSTOP)
        pending_start = asyncio.create_task(launcher.start(["schema"], tmp_path / "log", os.environ))
        await asyncio.sleep(0.1)
        os.kill(launcher.pid, signal.SIGKILL)
        with pytest.raises(RemoteError, match="somrs schema was not started"):
            await pending_start

    run_with_launcher(use)


def test_when_it_is_stopped_nothing_that_it_started_goes_on(tmp_path: Path) -> None:
    started: list[Process] = []

    async def use(launcher: Launcher) -> None:
        started.append(await repository(launcher, tmp_path / "data"))

    run_with_launcher(use)
    wait_for_exit(started[0].pid)


def test_programs_end_when_whoever_wanted_them_is_killed(tmp_path: Path) -> None:
    text = (
        "import asyncio, os, sys\nfrom pathlib import Path\nfrom somrs.deployment.launcher import Launcher\n"
        "async def run():\n"
        f"    line = ['run', 'repository', '--site', {str(SCENARIO_1)!r}, '--data', {str(tmp_path / 'data')!r}]\n"
        f"    program = await Launcher().start(line, Path({str(tmp_path / 'log')!r}), os.environ)\n"
        "    await program.stdout.readline()\n    print(program.pid, flush=True)\n    await program.wait()\n"
        "asyncio.run(run())\n"
    )
    with subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        pid = int(process.stdout.readline())
        assert runs(pid)
        process.kill()
    wait_for_exit(pid)


FORK_SCRIPT = """
import asyncio, os, signal, sys, threading
from pathlib import Path
from somrs.deployment.launcher import Launcher, fork_launcher

async def run(begun, log):
    launcher = Launcher(begun)
    first = launcher.pid
    well, badly = [await launcher.start([word], log, os.environ) for word in ("--help", "no-such-command")]
    print((await well.stdout.read()).decode().split()[0], await well.wait(), await badly.wait())
    print(Path(f"/proc/{first}/cmdline").read_text(), os.getsid(first) == first != os.getsid(0))
    os.kill(first, signal.SIGKILL)
    while launcher.pid == first:
        await asyncio.sleep(0.01)
    again = await launcher.start(["--help"], log, os.environ)
    print(launcher.pid not in (None, first), await again.wait())
    await launcher.stop()
    print(launcher.pid)

if "thread" in sys.argv:
    threading.Thread(target=threading.Event().wait, daemon=True).start()
asyncio.run(run(fork_launcher(), Path(sys.argv[1])))
print("over")
"""


@pytest.mark.parametrize("extra_arguments", [[], ["thread"]])
def test_a_launcher_comes_out_of_the_process_that_wants_it(tmp_path: Path, extra_arguments: list[str]) -> None:
    line = [sys.executable, "-c", FORK_SCRIPT, str(tmp_path / "log"), *extra_arguments]
    result = subprocess.run(line, capture_output=True, text=True, check=False)
    assert result.stderr == ""
    assert result.stdout.replace("\0", "").splitlines() == ["Usage: 0 2", "somrs launcher True", "True 0", "None", "over"]
