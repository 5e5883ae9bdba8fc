"""What hangs is found, and what only waits is not."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from somrs.deployment.watchdog import BEAT_VARIABLE, MOST_CPU, Activity, Heartbeat, LoopWatch, read_activity, read_beat

Looks = Sequence[tuple[int | None, Activity | None]]


def reasons(looks: Looks) -> list[str | None]:
    watch = LoopWatch()
    return [watch.look(beat, activity) for beat, activity in looks]


@pytest.mark.parametrize(
    "looks",
    [
        [(number, Activity("S", 0.01 * number)) for number in range(1, 1000)],
        [(1, Activity("S", 1.0)) for _ in range(100_000)],
        [(1, Activity("R", 1.0)) for _ in range(100_000)],
        [(1, Activity("D", 1.0)) for _ in range(100_000)],
        [(None, Activity("R", 1.0 * number)) for number in range(1000)],
        [(number // 50, Activity("R", 2.0 * number)) for number in range(50, 5000)],
        [(1, Activity("T" if number % 3 else "S", 1.0)) for number in range(1000)],
        [(1, Activity("t", 1.0)) for _ in range(1000)],
        [(1, None) for _ in range(1000)],
    ],
    ids=["idle", "waiting", "starved", "disk", "starting", "slow", "continued", "debugged", "unseen"],
)
def test_what_is_well_is_left_alone(looks: Looks) -> None:
    assert {*reasons(looks)} == {None}


def test_a_loop_that_works_without_turning_hangs() -> None:
    looks = [(number, Activity("S", 500.0)) for number in range(1, 10)]
    looks += [(9, Activity("R", 500.0 + 2 * number)) for number in range(100)]
    *reasons_before, last_reason = reasons(looks[: 9 + int(MOST_CPU / 2) + 1])
    assert {*reasons_before} == {None}
    assert last_reason is not None
    assert "has not turned for 120 s of processor time" in last_reason


def test_a_process_that_was_stopped_hangs() -> None:
    reason = reasons([(1, Activity("S", 1.0))] + [(1, Activity("T", 1.0))] * 3)[-1]
    assert reason is not None
    assert "SIGSTOP" in reason


def test_the_main_thread_counts_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(BEAT_VARIABLE, str(tmp_path / "beat"))
    assert read_beat(tmp_path / "beat") is None
    heartbeat = Heartbeat()
    assert read_beat(tmp_path / "beat") is None
    heartbeat.beat()
    heartbeat.beat()
    assert read_beat(tmp_path / "beat") == 2
    activity_before = read_activity(os.getpid())
    assert activity_before is not None
    thread = threading.Thread(target=lambda: sum(range(3_000_000)))
    thread.start()
    thread.join()
    activity_after = read_activity(os.getpid())
    assert activity_after is not None
    assert activity_after.cpu - activity_before.cpu < 0.05
    assert read_activity(2**22 + 1) is None
