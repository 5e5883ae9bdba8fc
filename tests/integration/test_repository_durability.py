"""A Repository whose process is killed while it is told things."""

from __future__ import annotations

from pathlib import Path

from somrs.protocol.messages.knowledge import History, ReadHistory, Updated
from tests.support.keeper import Keeper
from tests.support.killed_writer import run_until_killed

WRITER_PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.support.keeper import Keeper
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.knowledge import Updated, UpdateMap

keeper = Keeper(Path(sys.argv[1]))
while True:
    position = 100.0 + keeper.contents.version
    update = UpdateMap(changes=(ValueSet("Jar1", "PositionX", position), ValueSet("Jar2", "PositionX", position)))
    keeper.ask(update, Updated, identity=f"urn:uuid:{position}")
    keeper.journal.disk.write_and_wait(lambda db: None)
    print(keeper.contents.version, flush=True)
    if keeper.contents.version % 20 == 0:
        keeper.journal.snapshot(keeper.journaled)
"""


def test_nothing_that_was_acknowledged_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "repository.sqlite"
    acknowledged = 0
    for lines in (30, 7, 40):
        acknowledged += run_until_killed(WRITER_PROGRAM, path, lines)
        reopened = Keeper(path)
        contents = reopened.contents
        assert acknowledged <= contents.version <= acknowledged + 1
        acknowledged = contents.version
        assert contents.map.objects["Jar1"].values["PositionX"] == 99.0 + contents.version
        assert contents.map.objects["Jar2"].values["PositionX"] == 99.0 + contents.version
        history = reopened.ask(ReadHistory(object="Jar1", limit=1000), History)
        assert [event.version for event in history.events] == list(range(contents.version, 0, -1))
        assert contents.answered[f"urn:uuid:{99.0 + contents.version}"] == Updated(version=contents.version)
        reopened.close()
