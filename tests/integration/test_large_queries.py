"""Queries that take much work: the Repository goes on meanwhile, and refuses what is too much."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import QueryMap, ReadMap, Rows
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.runtime.host import Host
from somrs.storage import large_queries
from somrs.storage.repository_store import repository_journal
from tests.support.lab import ask_on_connection, lab

RING = " AND ".join(f"?A{number}.PositionX > ?A{(number + 1) % 9}.PositionX" for number in range(9))
CLIQUE = " AND ".join(f"?A{first}.PositionX < ?A{second}.PositionX" for second in range(12) for first in range(second))


async def ask_while(queries: list[str], folder: Path) -> tuple[list[Body], int]:
    """The answers to the queries, and the number of other requests that were answered before the first of these."""
    ontology, map = lab()
    jars = [Object(name=f"A{number}", type="Jar", values={"PositionX": float(number % 11)}) for number in range(31)]
    contents = Contents(ontology=ontology, map=Map([*map.objects.values(), *jars], map.facts()))
    journal = repository_journal(folder / "repository.sqlite")
    async with Host() as host:
        node = host.add_journaled("/repository", lambda address: Repository(address, contents), journal, carry_out=journal.carry_out)
        waiting = [asyncio.create_task(host.request(ask_on_connection(QueryMap(formula=query), node.address), 600)) for query in queries]
        reads = 0
        while not any(task.done() for task in waiting):
            await host.request(ask_on_connection(ReadMap(), node.address))
            await asyncio.sleep(0)
            reads += 1
        answers = [answer.body for answer in await asyncio.gather(*waiting)]
    journal.close()
    return answers, reads


def test_others_are_answered_while_a_query_takes_long(tmp_path: Path) -> None:
    answers, reads = asyncio.run(ask_while([RING, CLIQUE], tmp_path))
    ring, clique = answers
    assert isinstance(ring, Rows)
    assert ring.rows == ()
    assert isinstance(clique, Fault)
    assert clique.code == "Sender"
    assert "steps" in clique.text
    assert "name objects or types" in clique.text
    assert reads > 5


def test_few_queries_wait_for_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large_queries, "MOST_WAITING", 1)
    answers, _ = asyncio.run(ask_while([RING, CLIQUE], tmp_path))
    ring, clique = answers
    assert isinstance(ring, Rows)
    assert isinstance(clique, Fault)
    assert clique.code == "Receiver"
    assert "ask again later" in clique.text
