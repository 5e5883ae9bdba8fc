"""Plays Scenario 1b many times, each time with other initial positions of robots and jar and another moment of failure.

    python -m verification.scenarios [--runs 20] [--first 1] [--arcos]

The last line is `N passed, N failed`. out/scenarios/<seed>/ has the files of each run, with the reason of a failure.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from somrs.demo.scenarios import play
from somrs.errors import SomrsError


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="number of runs")
    parser.add_argument("--first", type=int, default=1, help="the first seed; the others follow")
    parser.add_argument("--arcos", action="store_true", help="drive the robots by ARCOS, in real time: some three minutes a run")
    parser.add_argument("--out", type=Path, default=Path("out/scenarios"))
    options = parser.parse_args()
    passed = failed = 0
    bar = Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with bar:
        runs = bar.add_task("Scenario 1b", total=options.runs)
        for seed in range(options.first, options.first + options.runs):
            folder = options.out / str(seed)
            folder.mkdir(parents=True, exist_ok=True)
            log = options.out / f"{seed}.log"
            with log.open("w", encoding="utf-8") as file:
                good = _played(seed, folder, Console(file=file, width=160, highlight=False), arcos=options.arcos)
            passed, failed = passed + good, failed + (not good)
            bar.console.print(f"seed {seed}: {'passed' if good else f'FAILED, see {log}'}")
            bar.advance(runs)
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


def _played(seed: int, folder: Path, console: Console, *, arcos: bool) -> bool:
    try:
        return asyncio.run(play("1b", folder, seed, console, arcos=arcos)) == 0
    except SomrsError as error:
        console.print(f"{type(error).__name__}: {error}")
        return False


if __name__ == "__main__":
    sys.exit(main())
