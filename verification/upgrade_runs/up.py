"""Runs a whole system without windows until it is told to end: `python -m verification.upgrade_runs.up SITE DATA [WORLD]`.

WORLD is where the world is, which outlives the systems in it.

Each release has this program, so that whatever it takes to start its own system is written here, and the runs need to know nothing else.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from somrs.deployment.programs import until_stopped
from somrs.deployment.system import System

SPEED = "2"
"""Simulated seconds per second: of the parcels' tasks, each takes some seconds then."""


async def main(site: Path, data: Path, world: str | None = None) -> None:
    async with System([site], data, speed=SPEED, world_address=world) as system:
        print(f"up: {system.addresses.task_manager}", flush=True)
        await until_stopped()


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:]))
