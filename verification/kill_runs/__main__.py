"""Kills processes of a running system, each time at another message of the protocol, and counts the recoveries.

    python -m verification.kill_runs [--runs 270] [--first 0] [--seed 17] [--systems 2] [--out out/kill-runs]

The last line is `N passed, N failed`. A failed run leaves its logs in out/kill-runs/<seed>/; `--seed` repeats it.
"""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
from collections import deque
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from somrs.errors import SomrsError
from verification.kill_runs.draw import CELLS, MAX_ATTEMPTS, draw_case
from verification.kill_runs.report import result_line, summary
from verification.kill_runs.run import Result, Run
from verification.kill_runs.running_system import RunningSystem

ROUNDS = 3
"""The default number of runs for each message and each victim."""
STARTS = 3
"""The number of attempts to start a system."""


class Series:
    """Runs for many seeds, in several systems at the same time. A system is used again as long as its runs do not fail."""

    def __init__(self, seeds: list[int], out_folder: Path, bar: Progress, *, is_on_bus: bool = False, is_planned: bool = False) -> None:
        self._is_on_bus, self._is_planned = is_on_bus, is_planned
        self.results: list[Result] = []
        self._seeds, self._out_folder, self._bar = deque(seeds), out_folder, bar
        self._progress_task = bar.add_task("kill runs", total=len(seeds))
        self._systems = 0

    async def play(self, systems: int) -> list[Result]:
        await asyncio.gather(*(self._work() for _ in range(systems)))
        return self.results

    async def _work(self) -> None:
        """Play the seeds that are left, in a new system after each failed run."""
        troubles = 0
        while self._seeds:
            self._systems += 1
            data = self._out_folder / f"system-{self._systems}"
            try:
                async with RunningSystem(data, is_on_bus=self._is_on_bus, is_planned=self._is_planned) as running_system:
                    troubles = 0
                    while self._seeds and await self._seed(running_system, self._seeds.popleft()):
                        pass
            except SomrsError as error:
                troubles += 1
                self._bar.console.print(f"[bold red]a system did not start[/]: {error}")
                if troubles == STARTS:
                    raise
            else:
                shutil.rmtree(data, ignore_errors=True)

    async def _seed(self, running_system: RunningSystem, seed: int) -> bool:
        """Play the run of a seed, and repeat it if the kill comes too late. Return whether the system can be used again."""
        for attempt in range(MAX_ATTEMPTS):
            run = Run(running_system, draw_case(seed, attempt, is_on_bus=self._is_on_bus))
            result = await run.play()
            if result.missed and attempt == MAX_ATTEMPTS - 1:
                result.problems.append(f"the kill came too late {MAX_ATTEMPTS} times: {result.missed}")
                result.missed = ""
            self.results.append(result)
            self._save_result(result)
            self._bar.console.print(
                result_line(result), style="" if result.recovered else "yellow" if result.missed else "bold red", highlight=False
            )
            if result.problems or result.lost:
                await self._save_logs(running_system, run, result)
                self._bar.advance(self._progress_task)
                return False
            if not result.missed:
                break
        self._bar.advance(self._progress_task)
        return True

    def _save_result(self, result: Result) -> None:
        with (self._out_folder / "runs.jsonl").open("ab") as file:
            file.write(msgspec.json.encode(result) + b"\n")

    async def _save_logs(self, running_system: RunningSystem, run: Run, result: Result) -> None:
        """Save the logs, the messages, the task and the simulated world of a failed run."""
        folder = self._out_folder / str(result.seed)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "result.json").write_bytes(msgspec.json.format(msgspec.json.encode(result)))
        (folder / "task.jsonl").write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in run.lines))
        if run.view is not None:
            (folder / "task.json").write_bytes(msgspec.json.format(msgspec.json.encode(run.view)))
        await running_system.save_world(folder)
        running_system.save_logs(folder)


def main() -> int:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    arguments.add_argument(
        "--runs", type=int, default=ROUNDS * len(CELLS), help=f"number of runs; {len(CELLS)} cover every message and victim once"
    )
    arguments.add_argument("--first", type=int, default=0, help="the first seed; the others follow")
    arguments.add_argument("--seed", type=int, help="play only the run of this seed")
    arguments.add_argument("--systems", type=int, default=2, help="number of systems that run at the same time")
    arguments.add_argument("--out", type=Path, default=Path("out/kill-runs"))
    arguments.add_argument("--bus", action="store_true", help="kill whole hosts of a system on a bus of three servers, for good")
    arguments.add_argument("--planned", action="store_true", help="with --bus: ask the host's programs to end, in place of killing them")
    options = arguments.parse_args()
    seeds = [options.seed] if options.seed is not None else [*range(options.first, options.first + options.runs)]
    shutil.rmtree(options.out, ignore_errors=True)
    options.out.mkdir(parents=True)
    console = Console(width=None if sys.stdout.isatty() else 200)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        series = Series(seeds, options.out, bar, is_on_bus=options.bus, is_planned=options.planned)
        results = asyncio.run(series.play(min(options.systems, len(seeds))))
    summary(results, console, is_planned=options.planned)
    passed = len({result.seed for result in results if result.recovered})
    print(f"{passed} passed, {len(seeds) - passed} failed")
    return 0 if passed == len(seeds) else 1


if __name__ == "__main__":
    sys.exit(main())
