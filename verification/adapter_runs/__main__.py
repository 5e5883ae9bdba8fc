"""Kills adapters, the other ends of their wires, and brokers, one or two at a time, while robots fetch, pick, carry, drop, charge, pass
doors and ride in a lift, and starts them again.

    python -m verification.adapter_runs [--runs 86] [--first 0] [--out out/adapter-runs]

No robot may drive on beyond what traffic granted while nobody is there who knows; the task has to be accomplished, or to say why not; the
map has to agree with the world in the end; and all robots have to work again. A run with a seed is drawn in the same way each time. The
last line is `N passed, N failed`.
"""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
from pathlib import Path

from rich.console import Console

from verification.adapter_runs.cases import CASES, draw
from verification.adapter_runs.run import Run
from verification.adapter_runs.site import adapters_of


def main() -> int:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    arguments.add_argument("--runs", type=int, default=len(CASES))
    arguments.add_argument("--first", type=int, default=0, help="the first seed; the others follow")
    arguments.add_argument("--out", type=Path, default=Path("out/adapter-runs"))
    options = arguments.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 240)
    passed = failed = skipped = accomplished = 0
    for seed in range(options.first, options.first + options.runs):
        kind, folder = draw(seed).case.kind, options.out / str(seed)
        shutil.rmtree(folder, ignore_errors=True)
        if adapters_of(kind) is None:
            console.print(f"[yellow]{seed}: {kind} does not run here: NOT TESTED[/]")
            skipped += 1
            continue
        run = Run(seed, folder)
        try:
            asyncio.run(run.play())
        except Exception as error:  # noqa: BLE001  # whatever ends a run is its problem, and not that of the others
            run.problems.append(f"{type(error).__name__}: {error}")
        passed, failed = passed + (not run.problems), failed + bool(run.problems)
        accomplished += run.is_accomplished
        verdict = "; ".join((run.ending, *run.problems))
        console.print(f"{seed}: {kind}: {run.text}: {verdict}", style="bold red" if run.problems else "", highlight=False)
        if not run.problems:
            shutil.rmtree(folder, ignore_errors=True)
    console.print(f"{accomplished} tasks were accomplished; of the others, it is said why not")
    print(f"{passed} passed, {failed} failed{f', {skipped} skipped' if skipped else ''}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
