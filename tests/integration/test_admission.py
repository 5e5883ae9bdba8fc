"""Components keep so many of a kind for others, and say so to one more. Those that they keep go on."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from somrs.client.client import Client
from somrs.protocol.messages import directory, frp, knowledge, orders, submission, task_news
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message
from somrs.runtime.wire import Wire
from tests.support.hang import HANG_TIME
from tests.support.small_system import SmallSystem, scheduler_at

GOAL = "Jar002 isOn Platform001"

Send = Callable[..., Awaitable[object]]


def run_scenario(data: Path, scenario: Callable[[SmallSystem, Send], Awaitable[None]]) -> None:
    async def run() -> None:
        wire, system = Wire(), SmallSystem(data, [])

        async def send(address: str, body: Body, sender: str = ANONYMOUS, id: str = "") -> object:
            header = Header(sender=sender, recipient=address, message_id=id or uuid.uuid4().urn)
            answer = await wire.post(Message(header=header, body=body))
            assert answer is not None
            return answer.body

        async with asyncio.timeout(HANG_TIME):
            await system.start()
            try:
                await scenario(system, send)
            finally:
                await system.stop()
                await wire.close()

    asyncio.run(run())


def expect_limit(answer: object, limit: str) -> None:
    assert isinstance(answer, frp.Fault)
    assert "is the limit; try again later" in answer.text
    assert f"SOMRS_LIMIT_{limit}" in answer.text


def test_subscribers_are_few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_SUBSCRIBERS", "5")

    async def scenario(system: SmallSystem, send: Send) -> None:
        async with scheduler_at(system):
            scheduler = system.addresses.scheduler
            assert scheduler is not None
            kinds: list[tuple[str, Body]] = [
                (system.addresses.repository, knowledge.SubscribeMap(lease=60)),
                (system.addresses.registry, directory.SubscribeServices(lease=60)),
                (scheduler, orders.SubscribeOrders(lease=60)),
            ]
            for address, body in kinds:
                answers = [await send(address, body, f"http://127.0.0.1:1/{number}") for number in range(10)]
                accepted = [number for number, answer in enumerate(answers) if not isinstance(answer, frp.Fault)]
                assert 0 < len(accepted) <= 5
                expect_limit(answers[-1], "SUBSCRIBERS")
                renewal = await send(address, body, f"http://127.0.0.1:1/{accepted[-1]}")
                assert not isinstance(renewal, frp.Fault), "who has subscribed may renew"

    run_scenario(tmp_path, scenario)


def test_devices_are_few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_DEVICES", "3")

    async def scenario(system: SmallSystem, send: Send) -> None:
        def publish(number: int) -> directory.Publish:
            service_type = next(definition for definition in ontology.services.values())
            offer = directory.Offer(
                service=f"R{number}.Work",
                provider=f"R{number}",
                provider_type="Robot",
                address="http://127.0.0.1:1/",
                service_type=service_type,
            )
            return directory.Publish(provider=f"R{number}", offers=(offer,), lease=60)

        async with Client(system.addresses) as client:
            ontology = await client.ontology()
        answers = [await send(system.addresses.registry, publish(number)) for number in range(5)]
        assert [isinstance(answer, directory.Published) for answer in answers] == [True, True, True, False, False]
        expect_limit(answers[-1], "DEVICES")
        assert isinstance(await send(system.addresses.registry, publish(1)), directory.Published)

    run_scenario(tmp_path, scenario)


def test_tasks_and_those_who_wait_for_them_are_few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOMRS_LIMIT_TASKS", "2")
    monkeypatch.setenv("SOMRS_LIMIT_SUBSCRIBERS", "2")

    async def scenario(system: SmallSystem, send: Send) -> None:
        address = system.addresses.task_manager
        while not system.manager.state.replica.ready:
            await asyncio.sleep(0.02)
        answers = [await send(address, submission.Submit(effect=GOAL), id=f"urn:uuid:{number}") for number in range(4)]
        assert [isinstance(answer, submission.Submitted) for answer in answers] == [True, True, False, False]
        expect_limit(answers[-1], "TASKS")
        assert await send(address, submission.Submit(effect=GOAL), id="urn:uuid:0") == answers[0], "the same request is the same task"
        watch = task_news.WatchTask(task=answers[0].task, after=10**9, wait=60)  # type: ignore[attr-defined]
        waiting = [asyncio.ensure_future(send(address, watch)) for _ in range(2)]
        while len(system.manager.state.subscriptions.watchers) < 2:
            await asyncio.sleep(0.02)
        expect_limit(await send(address, watch), "SUBSCRIBERS")
        for request in waiting:
            request.cancel()

    run_scenario(tmp_path, scenario)
