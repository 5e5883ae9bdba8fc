"""What keeps a system running that was started: programs that end or hang are started again, and logs do not fill the disk."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from somrs.deployment.backup import serve_request
from somrs.deployment.incidents import add_incident
from somrs.deployment.programs import FIRST_PAUSE, MOST_PAUSE
from somrs.deployment.system import System
from somrs.errors import SomrsError
from somrs.limits import limits
from somrs.storage.log_files import empty_if_full

LOOK_PAUSE = 2.0
"""Seconds between two looks whether a program hangs."""
LOG_CHECK = 10.0
"""Seconds between two looks at the size of the logs."""

Report = Callable[[str], None]
"""Receives texts for people."""


async def keep_running(system: System, report: Report) -> None:
    """Start programs again when they end or hang, until cancelled; they continue from their journals."""

    def note(text: str) -> None:
        report(text)
        add_incident(system.data, text)

    looking = asyncio.create_task(_end_what_hangs(system, note))
    try:
        await _start_what_ended(system, note)
    finally:
        looking.cancel()


async def _end_what_hangs(system: System, report: Report) -> None:
    while True:
        await asyncio.sleep(LOOK_PAUSE)
        await serve_request(system.data, [*system.programs.values()])
        if system.certificates is not None:
            system.certificates.renew()
        for program in system.programs.values():
            if program.process.returncode is None and (reason := program.hang_text()) is not None:
                report(f"{program.name} hangs: {reason}; ending it, so that it is started again")
                program.process.kill()


async def _start_what_ended(system: System, report: Report) -> None:
    while True:
        ends = [asyncio.create_task(program.process.wait()) for program in system.programs.values()]
        try:
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for waiting in ends:
                waiting.cancel()
        # In the order of their first start: several may have ended at once, and devices need the Repository.
        for program in [program for program in system.programs.values() if program.process.returncode is not None]:
            report(f"{program.name} ended ({program.exit_text}; see {program.log}); starting it again")
            await asyncio.sleep(min(FIRST_PAUSE * 2**program.restarts, MOST_PAUSE))
            try:
                await system.restart(program.name)
            except SomrsError as error:
                report(str(error))
            else:
                report(f"{program.name} is back")


async def bound_logs(data: Path) -> None:
    """Keep the logs of the programs of a data folder from filling the disk, until cancelled."""
    most_bytes = limits().log_bytes
    while True:
        await asyncio.sleep(LOG_CHECK)
        for file in (data / "logs").glob("*.log"):
            empty_if_full(file, most_bytes)
