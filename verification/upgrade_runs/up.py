"""Runs a whole system without a GUI until it receives a signal: `python -m verification.upgrade_runs.up SITE DATA [WORLD]`.

WORLD is the address of a world that outlives the system.

Each release has this program, so that the runs do not depend on how a release starts its system.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from somrs.deployment.programs import until_stopped
from somrs.deployment.system import System

SPEED = "2"
"""Simulated seconds per second. At this speed each task of the parcels site takes some seconds."""


async def main(site: Path, data: Path, world: str | None = None) -> None:
    async with System([site], data, speed=SPEED, world_address=world) as system:
        print(f"up: {system.addresses.task_manager}", flush=True)
        await until_stopped()


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:]))
