"""The copy of the map that devices of a process share: never older than the Repository's when it is asked."""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable

from somrs.deployment.device import request
from somrs.deployment.shared_map import SharedMap
from somrs.ontology.objects import ValueSet
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import MapPage, QueryMap, ReadMap, Rows, Updated, UpdateMap
from somrs.repository.component import Repository
from somrs.runtime.host import Host
from tests.support.hang import HANG_TIME
from tests.support.lab import contents

PRICE = QueryMap(formula="Robot1.Price = ?Price")


class Lab:
    """A Repository, and a copy of its map at a host of its own. `requests`: those that the Repository got, by kind."""

    def __init__(self, core: Host, host: Host) -> None:
        self._core, self.requests = core, Counter[str]()
        self.repository = core.add("/repository", lambda address: Repository(address, contents())).address

        async def count(body: Body) -> Body:
            self.requests[type(body).__name__] += 1
            return await request(host, body, self.repository)

        self.ask: Callable[[Body], Awaitable[Body]] = count
        self.shared = SharedMap(host, "/maps/Robot001", self.repository, count)

    async def read(self) -> None:
        """Wait until the copy is there."""
        async with asyncio.timeout(HANG_TIME):
            while not self.requests["ReadMap"]:  # it answers itself as soon as it can, and asks for the version alone
                await self.shared.answer(PRICE)
                await asyncio.sleep(0.01)
        self.requests.clear()

    async def set_price(self, price: int) -> None:
        answer = await self.ask(UpdateMap(changes=(ValueSet("Robot1", "Price", price),)))
        assert isinstance(answer, Updated), answer

    async def price(self) -> str:
        rows = await self.shared.answer(PRICE)
        assert isinstance(rows, Rows), rows
        return rows.rows[0].bindings["Price"]


@contextlib.asynccontextmanager
async def running() -> AsyncIterator[Lab]:
    core, host = Host(), Host()
    await core.start()
    await host.start()
    try:
        lab = Lab(core, host)
        await lab.read()
        yield lab
    finally:
        await host.stop()
        await core.stop()


def test_what_was_changed_before_the_question_is_in_the_answer() -> None:
    async def scenario() -> None:
        async with running() as lab:
            for price in range(100):
                await lab.set_price(price)
                assert float((await lab.price()).split()[0]) == price
            assert lab.requests["QueryMap"] == 0

    asyncio.run(scenario())


def test_many_questions_at_once_ask_the_repository_for_its_version_once_or_twice() -> None:
    async def scenario() -> None:
        async with running() as lab:
            await lab.set_price(7)
            answers = await asyncio.gather(*(lab.price() for _ in range(200)))
            assert len({*answers}) == 1
            assert lab.requests["ReadMap"] <= 2
            first = asyncio.create_task(lab.price())
            await asyncio.sleep(0)
            await lab.set_price(8)
            later = await lab.price()
            assert float(later.split()[0]) == 8, "an answer that was on its way may be older"
            await first

    asyncio.run(scenario())


def test_answers_are_those_of_the_repository() -> None:
    questions: list[QueryMap | ReadMap] = [
        PRICE,
        QueryMap(formula="?It: PhysicalObject = ?It", limit=2),
        QueryMap(formula="Robot1.Price = ?Price", situation="Robot1.Price = 3"),
        QueryMap(formula="Robot1.Nothing = ?Price"),
        QueryMap(formula="Robot1.", situation="what"),
        ReadMap(),
        ReadMap(after="Robot"),
    ]

    async def scenario() -> None:
        async with running() as lab:
            await lab.set_price(5)
            for question in questions:
                own, asked = await lab.shared.answer(question), await request(lab._core, question, lab.repository)
                assert own == asked, question
                assert isinstance(own, Rows | MapPage | Fault)

    asyncio.run(scenario())
