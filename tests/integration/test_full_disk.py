"""A disk that is full: what only reads goes on, the rest is refused, and everything goes on when there is room again."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from somrs.errors import RemoteError
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.knowledge import MapPage, ReadMap, Updated, UpdateMap
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.host import Host
from somrs.runtime.wire import Unanswered, Wire
from somrs.storage.repository_store import repository_journal
from tests.support.hang import HANG_TIME
from tests.support.lab import ask_on_connection, lab

SIZE = 6_000_000


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "none", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root can make a small disk")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """Fill the disk with a file."""
    filler = folder / "filler"
    with filler.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            return filler


@pytest.mark.parametrize("outages", [1, 2])
def test_a_repository_goes_on_by_itself_when_there_is_room(small_disk: Path, outages: int) -> None:
    async def run() -> None:
        ontology, map = lab()
        contents = Contents(ontology=ontology, map=map)
        journal = repository_journal(small_disk / "repository.sqlite")
        wire = Wire()
        async with Host() as host:
            node = host.add_journaled(
                "/repository",
                lambda address: Repository(address, contents),
                journal,
                carry_out=journal.carry_out,
                recovers=True,
            )

            async def ask(body: ReadMap | UpdateMap) -> object:
                answer = await wire.post(ask_on_connection(body, node.address))
                assert answer is not None
                return answer.body

            def update(weight: float) -> UpdateMap:
                return UpdateMap(changes=(ValueSet("Jar1", "Weight", weight),))

            stored_weight = 0.5
            await ask(update(stored_weight))
            for _ in range(outages):
                filler = fill(small_disk)
                for number in range(1000):  # there may be room in the file itself
                    try:
                        assert isinstance(await ask(update(stored_weight + 0.001)), Updated)
                        stored_weight += 0.001
                    except Unanswered:
                        break
                    assert number < 900
                page: object = None
                while page is None:
                    try:
                        page = await ask(ReadMap())
                    except Unanswered:
                        await asyncio.sleep(0.05)
                assert isinstance(page, MapPage)
                weights = [object.values.get("Weight") for object in page.objects if object.name == "Jar1"]
                assert weights == [stored_weight], "only what is stored is shown"
                with pytest.raises(RemoteError, match="could not store"):
                    await ask(update(0.9))
                filler.unlink()
                while True:
                    try:
                        answer = await ask(update(stored_weight + 0.1))
                    except Unanswered:
                        await asyncio.sleep(0.05)
                    else:
                        break
                assert isinstance(answer, Updated)
                assert answer.version == page.version + 1
                stored_weight += 0.1
        await wire.close()
        journal.close()
        reopened = repository_journal(small_disk / "repository.sqlite")
        journaled, _ = reopened.begin("http://127.0.0.1:1/repository", lambda address: Repository(address, contents))
        assert journaled.component.state.map.objects["Jar1"].values["Weight"] == stored_weight
        reopened.close()

    async def limited() -> None:
        async with asyncio.timeout(HANG_TIME):
            await run()

    asyncio.run(limited())
