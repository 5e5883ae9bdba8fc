"""What is known of the fleet: who came and went, how busy devices were, and how reliable services have been."""

from __future__ import annotations

import asyncio
import sqlite3
from contextlib import AsyncExitStack
from pathlib import Path
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.api.device_state import DeviceState
from somrs.api.fleet import DeviceView, Presence, rank_and_name
from somrs.api.reliability_stats import WINDOW, ReliabilityStats, Tally
from somrs.api.service import ApiService, open_api_service
from somrs.api.service_presence import ServicePresence
from somrs.client.client import Client
from somrs.client.task_history import TaskHistory
from somrs.ontology.services import ServiceType
from somrs.ontology.types import Value
from somrs.protocol.messages.directory import Offer, PresenceChange, Publish, Published, Retract, Retracted, ServicesJoined
from somrs.protocol.messages.envelope import message_id
from somrs.protocol.messages.frp import Outcome, State
from somrs.protocol.messages.records import ReadRecords, Records, TaskRecord
from somrs.protocol.messages.task_views import WorkView
from somrs.storage import archive
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, SmallSystem


def offer(service: str, price: float = 1.0) -> Offer:
    device, _, name = service.partition(".")
    kind = ServiceType(name=name, effect="?Provider isAt ?Place")
    attributes: dict[str, Value] = {"Price": price}
    return Offer(
        service=service, provider=device, provider_type="Robot", address="http://127.0.0.1:1/r", service_type=kind, attributes=attributes
    )


def test_arrivals_and_departures_are_known_to_an_api_that_was_not_there(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem) -> None:
        async with Client(system.addresses) as client:
            registry = system.addresses.registry
            published = Publish(provider="Visitor", offers=(offer("Visitor.Go"),), lease=60.0)
            async with open_api_service(system.addresses, system.data) as service:
                await client.ask(registry, published, Published)
                await client.ask(registry, Retract(provider="Visitor"), Retracted)
            async with open_api_service(system.addresses, system.data) as service:
                fleet = await service.fleet.devices()
                assert [(change.device, change.joined, change.reason) for change in fleet.log[:2]] == [
                    ("Visitor", False, "retracted"),
                    ("Visitor", True, ""),
                ]
                (visitor,) = (device for device in fleet.devices if device.name == "Visitor")
                assert (visitor.presence, visitor.departed_at, visitor.reason) == (Presence.DEPARTED, fleet.log[0].at, "retracted")
                with service.context.hub.subscribe("services") as news:
                    await client.ask(registry, published, Published)
                    while not isinstance((await news.next_news()).value, ServicesJoined):
                        pass
                fleet = await service.fleet.devices()
                assert (fleet.log[0].device, fleet.log[0].joined) == ("Visitor", True), "it is read again after news"
                (visitor,) = (device for device in fleet.devices if device.name == "Visitor")
                assert (visitor.presence, visitor.since) == (Presence.OFFERS, fleet.log[0].at)

    async def run() -> None:
        system = SmallSystem(tmp_path / "data", [])
        async with asyncio.timeout(HANG_TIME), AsyncExitStack() as stack:
            stack.push_async_callback(system.stop)
            await system.start()
            await scenario(system)

    asyncio.run(run())


def test_a_device_says_why_it_does_not_work_until_it_does(tmp_path: Path) -> None:
    porter = Porter("Robot1")

    async def run() -> None:
        system = SmallSystem(tmp_path / "data", [porter])
        async with asyncio.timeout(HANG_TIME), AsyncExitStack() as stack:
            stack.push_async_callback(system.stop)
            await system.start()
            service = await stack.enter_async_context(open_api_service(system.addresses, system.data))
            for problem, state in (("cannot drive: its stop is pressed", DeviceState.NOT_WORKING), (None, DeviceState.READY)):
                porter.report_problem("cannot be reached: it is switched off")
                porter.report_problem(problem)
                while (robot := await robot_of(service))[0] != (problem or ""):
                    await asyncio.sleep(0.01)
                assert robot[1:] == (state, state is DeviceState.READY)

    async def robot_of(service: ApiService) -> tuple[str, DeviceState, bool]:
        (robot,) = (device for device in (await service.fleet.devices()).devices if device.name == "Robot1")
        return robot.problem, robot.state, robot.working

    asyncio.run(run())


class CountingRegistry:
    """Counts how often its log was read."""

    def __init__(self) -> None:
        self.read_count = 0

    async def presence(self) -> tuple[PresenceChange, ...]:
        self.read_count += 1
        return (PresenceChange(at=float(self.read_count), device="B", services=("B.Go",), joined=True),)


def test_the_log_is_read_once_for_each_version_of_what_is_on_offer() -> None:
    async def run() -> None:
        presence, registry = ServicePresence(), CountingRegistry()
        client = cast("Client", registry)
        for version, read_count in ((-1, 1), (-1, 1), (7, 2), (7, 2), (9, 3)):
            await presence.read(client, version)
            assert registry.read_count == read_count
        assert (change := presence.last_arrival("B")) is not None
        assert change.at == 3.0
        assert presence.last_departure("B") is None

    asyncio.run(run())


# What was done


def work(service: str, start_time: float, ended: float | None, state: State, result: State | None = None) -> WorkView:
    return WorkView(step="s", service=service, service_type="Go", inputs={}, began=start_time, ended=ended, state=state, result=result)


def record(number: int, ended_at: float, *works: WorkView) -> TaskRecord:
    return TaskRecord(
        task=message_id("task", number),
        client="urn:c",
        effect="A isOn B",
        submitted_at=0.0,
        ended_at=ended_at,
        outcome=Outcome.ACCOMPLISHED,
        work=works,
    )


class CountingArchive:
    """An archive that counts what it is asked."""

    def __init__(self) -> None:
        self.db = sqlite3.connect(":memory:")
        self.db.executescript(archive.TABLES)
        self.read = 0

    def add_records(self, *records: TaskRecord) -> None:
        for task_record in records:
            archive.store_record(task_record, self.db)

    async def ask(self, request: ReadRecords) -> Records:
        page = archive.find_records(request, self.db)
        self.read += len(page.records)
        return page

    def teach(self, stats: ReliabilityStats) -> None:
        asyncio.run(stats.learn(TaskHistory(self.ask)))


def test_robots_are_listed_before_other_devices_and_lifts_and_doors_last() -> None:
    lineages = {"Door1": ("AutomaticDoor", "Door"), "Lift1": ("Lift",), "Scale1": ("Scale", "Device"), "Walker": ("Vehicle", "MobileRobot")}
    devices = [
        DeviceView(name=name, type=lineage[0], lineage=lineage, presence=Presence.OFFERS, state=DeviceState.READY)
        for name, lineage in lineages.items()
    ]
    assert [device.name for device in sorted(devices, key=rank_and_name)] == ["Walker", "Scale1", "Door1", "Lift1"]


def test_reliability_is_what_was_completed_of_what_was_begun_whatever_was_undone_later() -> None:
    task_archive, stats = CountingArchive(), ReliabilityStats()
    task_archive.add_records(
        record(1, 10.0, work("A.Go", 0, 5, State.COMPENSATED, State.COMPLETED), work("A.Go", 5, 6, State.COMPENSATED, State.FAILED)),
        record(2, 20.0, work("A.Go", 12, 15, State.COMPLETED, State.COMPLETED), work("B.Go", 12, 13, State.UNREACHABLE, State.UNREACHABLE)),
        record(3, 30.0, work("A.Go", 22, 25, State.STOPPED, State.STOPPED)),
    )
    task_archive.teach(stats)
    assert stats.tally("A.Go") == Tally(started=4, completed=2, failed=1, stopped=1)
    assert stats.tally("A.Go").in_words() == "2 of 3 done, 1 stopped"
    assert stats.tally("B.Go") == Tally(started=1, failed=1)
    assert stats.tally("C.Go").in_words() == "nothing done yet"
    assert Tally(started=9, completed=8, failed=1).in_words() == "8 of 9 done (89 %)"


def test_nothing_is_learned_twice_even_when_tasks_end_at_the_same_moment() -> None:
    task_archive, stats = CountingArchive(), ReliabilityStats()
    task_archive.add_records(*(record(number, float(number // 2), work("A.Go", 0, 1, State.COMPLETED)) for number in range(100)))
    task_archive.teach(stats)
    first = task_archive.read
    task_archive.add_records(record(100, 49.0, work("A.Go", 0, 1, State.FAILED)), record(101, 50.0, work("A.Go", 0, 1, State.COMPLETED)))
    task_archive.teach(stats)
    task_archive.teach(stats)
    assert stats.tally("A.Go") == Tally(started=102, completed=101, failed=1)
    assert task_archive.read - first < 10, "what is known is not read again"


@given(st.lists(st.tuples(st.integers(0, 700), st.integers(0, 200)), max_size=8))
def test_utilisation_is_the_share_of_seconds_in_which_anything_was_done(spans: list[tuple[int, int]]) -> None:
    now = 900
    works = [work("A.Go", float(start), float(start + lasts), State.COMPLETED) for start, lasts in spans]
    task_archive, stats = CountingArchive(), ReliabilityStats()
    task_archive.add_records(record(1, 900.0, *works))
    task_archive.teach(stats)
    busy = {second for start, lasts in spans for second in range(start, start + lasts) if now - WINDOW <= second < now}
    assert stats.utilisations((), float(now)).get("A", 0.0) == pytest.approx(len(busy) / WINDOW)


def test_what_is_under_way_counts_until_now() -> None:
    works = [work("A.Go", 880.0, None, State.EXECUTING), work("B.Look", 100.0, 250.0, State.COMPLETED)]
    assert ReliabilityStats().utilisations(works, 1000.0) == {"A": pytest.approx(120 / WINDOW)}
