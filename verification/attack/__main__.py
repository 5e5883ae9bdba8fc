"""Attacks a running system, and counts the promises that it keeps.

    python -m verification.attack [--fuzz 20000] [--seed 1] [--only NAME] [--out out/attack]

The last line is `N passed, N failed`. `--seed` repeats the drawn messages of a run.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import shutil
import sys
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

from rich.console import Console

from somrs.errors import SomrsError
from verification.attack import addresses, adversity, browsers, documents, floods, strangers
from verification.attack.bus_fuzz import BusFuzz
from verification.attack.bus_target import BusTarget, attacked_bus
from verification.attack.fuzz import Fuzz
from verification.attack.target import Defect, Skipped, Target, attacked_system

ATTACKS: tuple[Callable[[Target], Awaitable[None]], ...] = (
    browsers.other_sites_change_nothing,
    browsers.forms_change_nothing,
    browsers.pages_stay_in_their_frames,
    browsers.paths_lead_nowhere,
    strangers.strangers_see_nothing,
    strangers.viewers_change_nothing,
    strangers.no_file_tells_a_secret,
    documents.xml_is_small,
    documents.json_is_flat,
    documents.formulas_are_read_or_refused,
    documents.requests_have_one_reading,
    addresses.nobody_else_is_sent_anything,
    addresses.requests_for_others_are_refused,
    addresses.numbers_have_ranges,
    floods.large_headers_are_not_kept,
    floods.large_bodies_are_refused,
    floods.endless_bodies_end,
    floods.slow_requests_end,
    floods.websockets_take_no_nonsense,
    floods.topics_are_bounded,
    floods.websockets_are_bounded,
    floods.connections_that_send_nothing_keep_nobody_out,
    floods.the_simulator_takes_no_nonsense,
    addresses.subscribers_are_bounded,
    adversity.stopped_programs_are_replaced,
)

ADVERSITIES: tuple[Callable[[Path], Awaitable[None]], ...] = (
    adversity.a_full_disk_stops_nobody_for_good,
    adversity.a_disk_that_cannot_be_written_stops_nobody_for_good,
    adversity.a_time_of_day_that_jumps_ends_nothing,
    adversity.damaged_files_are_noticed,
)
"""What needs a system of its own, in a folder."""

BATCH = 100
"""Drawn messages between two looks at the system."""


class Series:
    """The attacks of a run whose names contain `only`, and what became of them."""

    def __init__(self, console: Console, only: str) -> None:
        self._console, self._only = console, only
        self.passed = self.failed = 0

    def includes(self, name: str) -> bool:
        return self._only in name

    async def attempt(self, name: str, attack: Callable[[], Awaitable[None]], target: Target | BusTarget | None = None) -> None:
        """Carry out an attack, and look whether the target is well afterwards."""
        if not self.includes(name):
            return
        try:
            await attack()
            if target is not None:
                await target.check()
        except Skipped as reason:
            self._console.print(f"[bold yellow]SKIPPED[/] {name}: {reason}")
        except (Defect, SomrsError, OSError) as error:
            self.failed += 1
            self._console.print(f"[bold red]failed[/] {name}: ", end="")
            self._console.print(str(error) or type(error).__name__, markup=False)
        else:
            self.passed += 1
            self._console.print(f"passed {name}")


async def attack(out_folder: Path, count: int, seed: int, only: str) -> Series:
    """Start a system, and attack it."""
    console = Console(highlight=False, soft_wrap=True)
    shutil.rmtree(out_folder, ignore_errors=True)
    series = Series(console, only)
    async with attacked_system(out_folder / "data") as target:
        await target.check()
        for attempt in ATTACKS:
            await series.attempt(_name(attempt), partial(attempt, target), target)
        for first in range(0, count // 2, BATCH):
            name = f"drawn messages {first} to {first + BATCH - 1} of seed {seed}"
            await series.attempt(name, partial(_draw, Fuzz(target, seed + first)), target)
    for certificates, kind in ((True, "with certificates"), (False, "without certificates")):
        await _attack_bus(series, out_folder / f"bus {kind}", certificates, count // 4, seed)
    for adverse in ADVERSITIES:
        await series.attempt(_name(adverse), partial(adverse, out_folder / adverse.__name__))
    return series


async def _attack_bus(series: Series, folder: Path, certificates: bool, count: int, seed: int) -> None:
    """Attack a system on a bus with drawn messages."""
    kind = folder.name
    names = {first: f"drawn messages {first} to {first + BATCH - 1} of seed {seed} on a {kind}" for first in range(0, count, BATCH)}
    if not any(map(series.includes, names.values())):
        return
    async with attacked_bus(folder, certificates=certificates) as target:
        await target.check()
        for first, name in names.items():
            await series.attempt(name, partial(_draw_on_bus, BusFuzz(target, seed + first)), target)
        print(f"memory of the system on a {kind}, in MB: {target.memory()}")


async def _draw_on_bus(fuzz: BusFuzz) -> None:
    for _ in range(BATCH):
        await fuzz.draw()


def _name(attempt: Callable[..., object]) -> str:
    return attempt.__name__.replace("_", " ")


async def _draw(fuzz: Fuzz) -> None:
    for _ in range(BATCH // 2):
        await fuzz.message()
        await fuzz.request()


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m verification.attack")
    parser.add_argument(
        "--fuzz", type=int, default=20000, help="the number of drawn messages: half over HTTP, a quarter on each kind of bus"
    )
    parser.add_argument("--seed", type=int, default=random.randrange(10**6), help="what is drawn")
    parser.add_argument("--only", default="", help="only the attacks whose names contain this")
    parser.add_argument("--out", type=Path, default=Path("out/attack"))
    arguments = parser.parse_args()
    series = asyncio.run(attack(arguments.out, arguments.fuzz, arguments.seed, arguments.only))
    print(f"{series.passed} passed, {series.failed} failed")
    sys.exit(1 if series.failed else 0)


if __name__ == "__main__":
    main()
