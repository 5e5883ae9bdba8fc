"""A Repository whose process is killed while it keeps what it is told."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from somrs.protocol.messages.knowledge import Updated
from somrs.storage.repository_store import RepositoryStore
from tests.support.lab import lab
from tests.support.paths import ROOT

RECORDER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.support.lab import REPOSITORY, records, request
from somrs.storage.repository_store import RepositoryStore
from somrs.ontology.objects import ValueSet
from somrs.kernel.component import Received
from somrs.protocol.messages.knowledge import UpdateMap
from somrs.repository.component import Repository

store = RepositoryStore.open(Path(sys.argv[1]))
repository = Repository(REPOSITORY, store.load())
while True:
    position = 100.0 + repository.contents.version
    update = UpdateMap(changes=(ValueSet("Jar1", "PositionX", position), ValueSet("Jar2", "PositionX", position)))
    for entry in records(repository.handle(Received(request(update, identity=f"urn:uuid:{position}")), 1.0)):
        store.record(entry)
    print(repository.contents.version, flush=True)
"""


def test_nothing_that_was_acknowledged_is_lost_when_the_process_is_killed(tmp_path: Path) -> None:
    store = RepositoryStore.open(tmp_path / "repository.sqlite")
    store.initialise(*lab())
    store.close()
    acknowledged = 0
    for lines in (30, 7, 55):
        child = subprocess.Popen([sys.executable, "-c", RECORDER, str(store.path), str(ROOT)], stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None
        try:
            for _ in range(lines):
                child.stdout.readline()
        finally:
            child.kill()
        rest = child.stdout.read().splitlines()
        child.stdout.close()
        child.wait()
        acknowledged += lines + len([line for line in rest if line])
        again = RepositoryStore.open(store.path)
        contents = again.load()
        assert contents is not None
        assert acknowledged <= contents.version <= acknowledged + 1
        acknowledged = contents.version
        assert contents.map.objects["Jar1"].values["PositionX"] == 99.0 + contents.version
        assert contents.map.objects["Jar2"].values["PositionX"] == 99.0 + contents.version
        assert [event.version for event in again.history("Jar1", 10_000)] == list(range(contents.version, 0, -1))
        assert contents.answered[f"urn:uuid:{99.0 + contents.version}"] == Updated(version=contents.version)
        again.close()
