"""Engines side by side: what ends well, what ends badly, and that nothing is left of either."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from somrs.errors import RemoteError
from somrs.planner_service.engine_race import Entrant, race

ANSWERS = "import sys; open(sys.argv[2], 'w').write('(3)\\n(1)\\n; cost = 2\\n')"
ENDLESS = "import time; time.sleep(600)"
FALLS = "import os; os.abort()"
PROVES = "import sys; sys.exit(11)"
HUNGRY = "import time; held = bytearray(2 * 1024 ** 3); time.sleep(600)"


def engine(program: str, name: str = "engine", share: float = 1.0) -> Entrant:
    def command(task: Path, plan: Path) -> Sequence[str]:
        return [sys.executable, "-c", program, str(task), str(plan)]

    return Entrant(name=name, command=command, share=share, proves=frozenset({11}))


@pytest.fixture
def task(tmp_path: Path) -> Path:
    file = tmp_path / "task.sas"
    file.write_text("a task")
    return file


def noting(program: str, task: Path) -> tuple[str, Callable[[], list[int]]]:
    """The program, which first notes the id of its process; and what was noted, by each start."""
    notes = task.with_name("notes")
    first = f"import os; open({str(notes)!r}, 'a').write(f'{{os.getpid()}}\\n'); "
    return first + program, lambda: [int(line) for line in notes.read_text().split()] if notes.exists() else []


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_the_first_plan_counts_and_nobody_runs_on(task: Path) -> None:
    program, noted = noting(ENDLESS, task)
    wait = "while not (os.path.exists(notes) and os.path.getsize(notes)): time.sleep(0.01)"
    slow_answer = f"import time, os\nnotes = {str(task.with_name('notes'))!r}\n{wait}\n{ANSWERS}"
    won = race([engine(program, "never"), engine(slow_answer, "answers")], task, 60, max_running=2)
    assert (won.engine_name, won.operators) == ("answers", ("3", "1"))
    assert [alive(pid) for pid in noted()] == [False]


def test_a_proof_that_there_is_no_plan_is_an_answer(task: Path) -> None:
    assert race([engine(ENDLESS), engine(PROVES, "proves")], task, 60, max_running=2).operators is None


def test_one_that_falls_makes_room_for_the_next(task: Path) -> None:
    assert race([engine(FALLS, "falls"), engine(ANSWERS, "answers")], task, 60, max_running=1).engine_name == "answers"


def test_one_that_is_killed_is_started_again_once(task: Path) -> None:
    waits, noted = noting(f"import time, os; time.sleep(0 if len(open({str(task.with_name('notes'))!r}).readlines()) > 1 else 600); ", task)

    def kill_the_first() -> None:
        while not noted():
            time.sleep(0.01)
        os.kill(noted()[0], signal.SIGKILL)

    killer = threading.Thread(target=kill_the_first)
    killer.start()
    assert race([engine(waits + ANSWERS)], task, 60).operators == ("3", "1")
    killer.join()
    assert len(noted()) == 2


def test_one_that_is_killed_again_and_again_is_given_up(task: Path) -> None:
    program, noted = noting("os.kill(os.getpid(), 9)", task)
    with pytest.raises(RemoteError, match="engine ended with code -9"):
        race([engine(program)], task, 60)
    assert len(noted()) == 2


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited where the system can do so from outside")
def test_one_that_wants_too_much_memory_ends_without_harm(task: Path) -> None:
    with pytest.raises(RemoteError, match="MemoryError"):
        race([engine(HUNGRY)], task, 60, memory=1024**3)


def test_one_that_used_its_share_makes_room_and_the_last_has_all_the_time(task: Path) -> None:
    won = race(
        [engine(ENDLESS, "never", 0.01), engine("import time; time.sleep(1); " + ANSWERS, "answers", 0.001)], task, 60, max_running=1
    )
    assert won.engine_name == "answers"


def test_nobody_runs_on_when_time_is_up(task: Path) -> None:
    program, noted = noting(ENDLESS, task)
    with pytest.raises(RemoteError, match="no plan was found in 2 s"):
        race([engine(program)], task, 2)
    assert [alive(pid) for pid in noted()] == [False]
