"""Records the files of a release that is killed with running tasks, as test data for all later versions.

    python -m verification.upgrade_runs.record [--out tests/data/journals]

Run it once for each release, after `release` names it. It makes a folder of the release's version with the packed files: as they were at
the kill, and in `snapshots` as they are after hours of operation. `open.json` has the running tasks by their goals. At the kill, one task
has ended and one is being compensated.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import gzip
import json
import sqlite3
import tempfile
from pathlib import Path

from somrs.cli.import_commands import problem_of
from somrs.client.addresses import Addresses
from somrs.client.client import Client
from somrs.ontology.files.site import dump_site
from somrs.protocol.messages.frp import State
from somrs.protocol.messages.goal_kinds import GoalKind
from somrs.protocol.messages.submission import Submit
from somrs.protocol.messages.task_views import Phase, WorkView
from verification.upgrade_runs.release import ROOT, build_release, release_name
from verification.upgrade_runs.run import Tree

FIRST_GOAL, UNDONE_GOAL, LATER_GOAL = "letter lies harbour", "letter lies market", "crate lies mill"


async def record(folder: Path) -> None:
    """Run the release, have it execute tasks, kill it, and store its files."""
    with tempfile.TemporaryDirectory() as temporary:
        data, site = Path(temporary) / "data", Path(temporary) / "parcels.yaml"
        imported = problem_of([ROOT / "examples" / "parcels" / f"{name}.pddl" for name in ("domain", "problem")])
        site.write_text(dump_site(imported.ontology, imported.map, imported.name), encoding="utf-8")
        system = Tree(build_release(ROOT / "out" / "releases"), site, data, Path(temporary) / "log")
        await system.start()
        try:
            open_tasks = await _tasks(data)
            await system.kill()
            _pack(data, folder)
            await system.write_snapshots()
            _pack(data, folder / "snapshots")
        finally:
            await system.end()
    (folder / "open.json").write_text(json.dumps(open_tasks, indent=1) + "\n", encoding="utf-8")


async def _tasks(data: Path) -> dict[str, str]:
    """Submit tasks until one has ended, one is being compensated and one is planned; return the latter two by id."""
    async with Client(Addresses.read(data)) as client:
        finished_task = await client.submit(Submit(effect=FIRST_GOAL))
        while (await client.read_task(finished_task)).view.phase is not Phase.ENDED:
            await asyncio.sleep(0.05)
        undone_task = await client.submit(Submit(effect=UNDONE_GOAL))
        while not any(work.state is State.COMPLETED for work in (await client.read_task(undone_task)).view.work):
            await asyncio.sleep(0.02)
        later_task = await client.submit(Submit(effect=LATER_GOAL))
        await client.cancel(undone_task, "it is not wanted any more")
        while not any(_undoes(work) for work in (await client.read_task(undone_task)).view.work):
            await asyncio.sleep(0.02)
        return {undone_task: UNDONE_GOAL, later_task: LATER_GOAL}


def _undoes(work: WorkView) -> bool:
    """Whether the work undoes other work, or is being undone."""
    return work.goal is GoalKind.UNDO or work.state is State.COMPENSATING


def _pack(data: Path, folder: Path) -> None:
    """Pack all databases of the data folder."""
    for file in sorted(data.rglob("*.sqlite")):
        target = folder / file.relative_to(data)
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as temporary, contextlib.closing(sqlite3.connect(file)) as db:
            whole = Path(temporary) / file.name
            db.execute("VACUUM INTO ?", (str(whole),))
            target.with_suffix(".sqlite.gz").write_bytes(gzip.compress(whole.read_bytes(), mtime=0))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "tests" / "data" / "journals")
    folder = parser.parse_args().out / release_name()[0]
    asyncio.run(record(folder))
    print(f"{folder}: {', '.join(sorted(str(file.relative_to(folder)) for file in folder.rglob('*') if file.is_file()))}")


if __name__ == "__main__":
    main()
