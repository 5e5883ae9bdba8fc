"""Measures `somrs --help` beside bare Python and the imports that a command needs, in turns."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time

RUNS = 15
COMMANDS = {
    "python, doing nothing": [sys.executable, "-c", "pass"],
    "somrs --help": [sys.executable, "-m", "somrs.cli.main", "--help"],
    "importing a component and its node": [sys.executable, "-c", "import somrs.runtime.node, somrs.task_manager.manager"],
}


def main() -> None:
    times: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(RUNS):
        for name, command in COMMANDS.items():
            start = time.perf_counter()
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            times[name].append(time.perf_counter() - start)
    floor = statistics.median(times["python, doing nothing"])
    for name, durations in times.items():
        median = statistics.median(durations)
        print(f"{name:36} median {median * 1000:6.0f} ms, worst {max(durations) * 1000:6.0f} ms, {median / floor:4.1f} times bare Python")


if __name__ == "__main__":
    main()
