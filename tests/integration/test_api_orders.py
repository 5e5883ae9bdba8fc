"""Templates and standing orders through the public API: days pass at once, tasks are real."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from datetime import datetime
from pathlib import Path

import pytest

from somrs.api.remote import LiveApi
from somrs.client.client import Client
from somrs.client.refusals import Changed, NotFound
from somrs.errors import FormulaError, InputError, UsageError
from somrs.ontology.services import Handler, Occasion
from somrs.protocol.messages.frp import Outcome
from somrs.protocol.messages.orders import Blank, Daily, Every, Filled, Once, OrderSaved, Run, RunState, StandingOrder, TemplateSaved
from somrs.protocol.messages.submission import Policy, Submit
from somrs.scheduling.execution import message_for
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, SmallSystem, Time, live_api_at, running

MONDAY = datetime(2026, 11, 23, 6, 0).timestamp()
HOUR, DAY = 3600.0, 86_400.0

BRING_TEMPLATE = TemplateSaved(
    task=Submit(effect="{Thing} isOn {Place}", policy=Policy.TIME, priority=2),
    blanks=(Blank(name="Thing", type="Jar", label="What"), Blank(name="Place", type="Platform", default="Platform001")),
    by="Ada",
)


Scenario = Callable[[SmallSystem, LiveApi, Time], Awaitable[None]]


def run_scenario(data: Path, scenario: Scenario, *porters: Porter) -> None:
    async def run() -> None:
        clock = Time(MONDAY)
        async with asyncio.timeout(HANG_TIME), running(data, *porters, clock=clock) as (system, api):
            await scenario(system, api, clock)

    asyncio.run(run())


async def runs(api: LiveApi, order: StandingOrder) -> tuple[Run, ...]:
    return (await api.orders.runs(order.id)).runs


async def begun(api: LiveApi, order: StandingOrder, count: int) -> None:
    """Wait until it has so many runs."""
    while len(await runs(api, order)) < count:
        await asyncio.sleep(0.02)


async def settled(api: LiveApi, order: StandingOrder, count: int = 1) -> tuple[Run, ...]:
    """Its runs, once there are so many, and none is under way."""
    while len(order_runs := await runs(api, order)) < count or any(run.open for run in order_runs):
        await asyncio.sleep(0.02)
    return order_runs


def task_request(jar: str = "Jar002", place: str = "Platform001") -> Submit:
    return Submit(effect=f"{jar} isOn {place}")


# Templates


def test_a_template_is_saved_filled_in_and_used(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        saved = await api.orders.save_template("Bring it", BRING_TEMPLATE)
        assert (saved.version, saved.changed_by, saved.changed_at) == (1, "Ada", MONDAY)
        assert (await api.orders.templates()).templates == (saved,)
        filled = await api.orders.fill_template("Bring it", Filled(values={"Thing": "Jar001"}))
        assert filled == Submit(effect="Jar001 isOn Platform001", policy=Policy.TIME, priority=2)
        task = (await api.orders.use_template("Bring it", Filled(values={"Thing": "Jar001"}, by="Bob"))).task
        task_details = await api.tasks.read(task)
        assert (task_details.view.effect, task_details.view.priority, task_details.view.client) == (
            "Jar001 isOn Platform001",
            2,
            "urn:so-mrs:client:Bob",
        )

    run_scenario(tmp_path, scenario, Porter("Robot1"))


@pytest.mark.parametrize(
    ("values", "wrong"),
    [
        ({}, r"fill in What \(Jar\)"),
        ({"Thing": "Jar009"}, "there is no Jar009 on the map; did you mean Jar00"),
        ({"Thing": "Robot1"}, "Robot1 is a PioneerP3DX, not a Jar"),
        ({"Thing": "Jar001", "Plaice": "x"}, "has no blank Plaice; did you mean Place"),
    ],
)
def test_what_does_not_fit_in_a_blank_is_told(values: dict[str, str], wrong: str, tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        await api.orders.save_template("Bring", BRING_TEMPLATE)
        with pytest.raises(UsageError, match=wrong):
            await api.orders.use_template("Bring", Filled(values=values))

    run_scenario(tmp_path, scenario)


def _saved(effect: str, *blanks: Blank, **options: object) -> TemplateSaved:
    return TemplateSaved(task=Submit(effect=effect, **options), blanks=blanks)  # type: ignore[arg-type]  # keyword arguments of Submit


@pytest.mark.parametrize(
    ("saved", "wrong"),
    [
        (_saved("{Thing} isOn Platform001"), "{Thing} is in a formula, but there is no blank with this name"),
        (_saved("Jar001 isOn Platform001", Blank(name="Thing")), "the blank Thing is in no formula"),
        (_saved("{Thing} isOn Platform001", Blank(name="Thing", type="Jarr")), "there is no type Jarr; did you mean Jar"),
        (_saved("{A thing} isOn Platform001"), "a blank is a name in braces"),
        (_saved("{T} isOn Platform001", Blank(name="T"), Blank(name="T")), "two blanks have the same name"),
        (_saved("{T} isOn Platform001", Blank(name="T", type="Jar", default="Robot1")), "Robot1 is a PioneerP3DX"),
        (_saved("Jar001 isOn Platform001", deadline=-1), "task.deadline is -1.0; give a number"),
        (_saved("Jar001 isOn"), "(?s)."),
    ],
)
def test_a_template_that_could_never_be_a_task_is_not_saved(saved: TemplateSaved, wrong: str, tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        with pytest.raises((UsageError, FormulaError), match=f"(?s){wrong}"):
            await api.orders.save_template("Bring", saved)
        assert (await api.orders.templates()).templates == ()

    run_scenario(tmp_path, scenario)


@pytest.mark.parametrize(
    ("effect", "wrong_part"),
    [
        ("{Thing} isOnn {Place}", "isOnn"),
        ("{Thing} isOn {Place} AND {Thing} isOn Platfrom001", "Platfrom001"),
        ("{Thing} isOn {Place} AND {Thing} isOn", ""),
        ("{Thing} isOn {Place} AND {Place}.Weight < 5 s", ""),
    ],
)
def test_a_mistake_in_a_template_is_told_where_it_was_written(effect: str, wrong_part: str, tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        saved = _saved(effect, Blank(name="Thing", type="Jar"), Blank(name="Place", type="Platform"))
        with pytest.raises(FormulaError) as refused:
            await api.orders.save_template("Bring", saved)
        assert refused.value.text == effect
        assert refused.value.position <= len(effect)
        if wrong_part:
            assert effect[refused.value.position :].startswith(wrong_part)

    run_scenario(tmp_path, scenario)


def test_numbers_texts_and_truths_are_filled_in_as_they_are_written_in_formulas(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        handler = Handler(on=Occasion.FAILURE, effect="{Thing}.PositionX = {X}")
        task = Submit(
            effect="{Thing}.PositionX = {X} AND Robot1.Working = {Works}", precondition="{Thing} isOn Cupboard001", handlers=(handler,)
        )
        blanks = (Blank(name="Thing", type="Jar"), Blank(name="X", type="number"), Blank(name="Works", type="truth"))
        await api.orders.save_template("Move", TemplateSaved(task=task, blanks=blanks))
        filled = await api.orders.fill_template("Move", Filled(values={"Thing": "Jar002", "X": "-1.5 m", "Works": "true"}))
        assert filled.effect == "Jar002.PositionX = -1.5 m AND Robot1.Working = TRUE"
        assert filled.precondition == "Jar002 isOn Cupboard001"
        assert filled.handlers[0].effect == "Jar002.PositionX = -1.5 m"
        for values in ({"X": "far"}, {"X": "1 OR 1"}, {"Works": "maybe"}):
            with pytest.raises(UsageError, match=r"is not a number|is neither TRUE nor FALSE"):
                await api.orders.fill_template("Move", Filled(values={"Thing": "Jar002", "X": "1", "Works": "TRUE"} | values))

    run_scenario(tmp_path, scenario)


def test_two_people_who_save_the_same_template_lose_nothing(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        def saved(expected: int, author: str) -> TemplateSaved:
            return TemplateSaved(task=task_request(), by=author, expected_version=expected)

        await api.orders.save_template("Bring", saved(0, "Ada"))
        with pytest.raises(Changed, match="the template Bring is there already"):
            await api.orders.save_template("Bring", saved(0, "Bob"))
        outcomes = await asyncio.gather(
            *(api.orders.save_template("Bring", saved(1, author)) for author in ("Ada", "Bob", "Cleo")), return_exceptions=True
        )
        (won,) = [outcome for outcome in outcomes if not isinstance(outcome, BaseException)]
        lost = [str(outcome) for outcome in outcomes if isinstance(outcome, Changed)]
        assert len(lost) == 2
        assert all(f"was changed by {won.changed_by} meanwhile" in text for text in lost)
        assert await api.orders.template("Bring") == won
        for refused in (
            api.orders.rename_template("Bring", "Take", expected_version=1),
            api.orders.remove_template("Bring", expected_version=1),
        ):
            with pytest.raises(Changed, match="meanwhile"):
                await refused
        await api.orders.remove_template("Bring", expected_version=2)
        with pytest.raises(Changed, match="was removed meanwhile"):
            await api.orders.save_template("Bring", saved(2, "Ada"))

    run_scenario(tmp_path, scenario)


def test_a_template_is_renamed_with_the_orders_that_use_it_and_not_removed_under_them(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        await api.orders.save_template("Bring", BRING_TEMPLATE)
        await api.orders.save_template("Other", BRING_TEMPLATE)
        order = await api.orders.add_order(OrderSaved(name="Daily", when=Daily(at="08:00"), template="Bring", values={"Thing": "Jar001"}))
        with pytest.raises(Changed, match="there is a template Other already"):
            await api.orders.rename_template("Bring", "Other")
        await api.orders.rename_template("Bring", "Fetch")
        assert (await api.orders.order(order.id)).template == "Fetch"
        with pytest.raises(Changed, match="is used by the order Daily"):
            await api.orders.remove_template("Fetch")
        await api.orders.remove_order(order.id)
        await api.orders.remove_template("Fetch")
        with pytest.raises(NotFound, match="there is no template Fetch"):
            await api.orders.template("Fetch")
        for name in ("", "a/b", "x" * 81, "a\nb\x00"):
            with pytest.raises(InputError, match="is not a name"):
                await api.orders.save_template(name, BRING_TEMPLATE)

    run_scenario(tmp_path, scenario)


# Orders


def test_an_order_is_stated_when_it_is_due_and_what_came_of_it_is_told(tmp_path: Path) -> None:
    porter = Porter("Robot1")

    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        order = await api.orders.add_order(OrderSaved(name="Morning", when=Daily(at="07:00", days=(0, 2)), task=task_request(), by="Ada"))
        assert order.next == MONDAY + HOUR
        await clock.pass_by(HOUR - 1)
        assert await runs(api, order) == ()
        with api.context.hub.subscribe("orders") as listening:
            await listening.wait_until_followed()
            await clock.pass_by(2)
            (run,) = await settled(api, order)
            assert (await asyncio.wait_for(listening.next_news(), HANG_TIME)).topic == "orders"
        assert (run.state, run.outcome, run.due) == (RunState.SUBMITTED, Outcome.ACCOMPLISHED, MONDAY + HOUR)
        assert run.ended_at is not None
        assert porter.delivered == ["Jar002"]
        task_details = await api.tasks.read(run.task or "")
        assert task_details.view.client == "urn:so-mrs:client:order%20Morning"
        now = await api.orders.order(order.id)
        assert now.last == run
        assert now.next == MONDAY + 2 * DAY + HOUR
        assert now.version == 1

    run_scenario(tmp_path, scenario, porter)


def test_three_days_of_orders(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        often_order = await api.orders.add_order(OrderSaved(name="Often", when=Every(minutes=12 * 60), task=task_request(), skip=False))
        once_order = await api.orders.add_order(OrderSaved(name="Once", when=Once(at=MONDAY + 30 * HOUR), task=task_request("Jar001")))
        daily = await api.orders.add_order(OrderSaved(name="Daily", when=Daily(at="05:00", days=(1, 2)), task=task_request("Tin001")))
        for _ in range(3 * 24):
            await clock.pass_by(HOUR)
            for order in (often_order, once_order, daily):
                await settled(api, order, 0)  # a task is not to last for days
        await clock.pass_by(1)
        assert [run.due for run in await settled(api, often_order, 6)] == [MONDAY + n * 12 * HOUR for n in range(6, 0, -1)]
        assert [run.due for run in await settled(api, once_order)] == [MONDAY + 30 * HOUR]
        assert [f"{datetime.fromtimestamp(run.due):%a}" for run in await settled(api, daily, 2)] == ["Wed", "Tue"]
        for order in (often_order, once_order, daily):
            assert {run.outcome for run in await runs(api, order)} == {Outcome.ACCOMPLISHED}
        assert (await api.orders.order(once_order.id)).next is None
        tasks = [run.task for order in (often_order, once_order, daily) for run in await runs(api, order)]
        assert len({*tasks}) == 9

    run_scenario(tmp_path, scenario, Porter("Robot1", seconds=0.02))


def test_while_the_task_before_runs_the_next_time_is_skipped_or_not_as_one_likes(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        skips = await api.orders.add_order(OrderSaved(name="Skips", when=Every(minutes=10), task=task_request("Jar001")))
        insists = await api.orders.add_order(OrderSaved(name="Insists", when=Every(minutes=10), task=task_request("Jar002"), skip=False))
        for number in (1, 2):
            await clock.pass_by(601)
            for order in (skips, insists):
                await begun(api, order, number)
                while any(run.state is RunState.SUBMITTING for run in await runs(api, order)):
                    await asyncio.sleep(0.02)
        assert [run.state for run in await runs(api, skips)] == [RunState.SKIPPED, RunState.SUBMITTED]
        assert [run.state for run in await runs(api, insists)] == [RunState.SUBMITTED, RunState.SUBMITTED]
        (skipped, first) = await runs(api, skips)
        assert first.task is not None
        assert first.task in skipped.note
        await settled(api, skips)
        await clock.pass_by(600)
        assert (await settled(api, skips, 3))[0].state is RunState.SUBMITTED

    run_scenario(tmp_path, scenario, Porter("Robot1", seconds=1.5), Porter("Robot2", seconds=1.5))


def test_a_paused_order_rests_and_makes_nothing_up(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        order = await api.orders.add_order(OrderSaved(name="Often", when=Every(minutes=60), task=task_request()))
        paused = await api.orders.pause_order(order.id, by="Bob")
        assert (paused.enabled, paused.next, paused.changed_by) == (False, None, "Bob")
        await clock.pass_by(5 * HOUR + 1)
        resumed = await api.orders.resume_order(order.id)
        assert resumed.next == MONDAY + 6 * HOUR
        await clock.pass_by(30)
        assert await runs(api, order) == ()
        await clock.pass_by(HOUR)
        assert [run.due for run in await settled(api, order)] == [MONDAY + 6 * HOUR]

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_times_that_were_missed_are_told_and_not_made_up_for(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        order = await api.orders.add_order(OrderSaved(name="Often", when=Every(minutes=60), task=task_request()))
        await clock.jump(5 * HOUR + 10)
        late, missed = await settled(api, order, 2)
        assert (late.state, late.due) == (RunState.SUBMITTED, MONDAY + 5 * HOUR), "ten seconds are no reason to leave it out"
        assert (missed.state, missed.times, missed.due) == (RunState.MISSED, 4, MONDAY + 4 * HOUR)
        await clock.jump(HOUR + 120)
        (missed, *_) = await settled(api, order, 3)
        assert (missed.state, missed.times, missed.due, missed.task) == (RunState.MISSED, 1, MONDAY + 6 * HOUR, None)
        assert len(await runs(api, order)) == 3

    run_scenario(tmp_path, scenario, Porter("Robot1"))


def test_an_order_whose_task_is_none_any_more_is_refused_with_the_reason(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        await api.orders.save_template("Bring", BRING_TEMPLATE)
        daily_order = OrderSaved(name="Daily", when=Daily(at="08:00"), template="Bring", values={"Thing": "Jar001"})
        order = await api.orders.add_order(daily_order)
        await api.orders.save_template("Bring", _saved("{What} isOn Platform001", Blank(name="What", type="Jar")))
        await clock.pass_by(3 * HOUR)
        (run,) = await settled(api, order)
        assert (run.state, run.task) == (RunState.REFUSED, None)
        assert "has no blank Thing" in run.note

    run_scenario(tmp_path, scenario, Porter("Robot1"))


@pytest.mark.parametrize(
    ("saved", "wrong"),
    [
        (OrderSaved(name="X", when=Daily(at="08:00")), "either a task of its own, or a template"),
        (OrderSaved(name="X", when=Daily(at="08:00"), task=task_request(), template="Bring"), "either a task of its own, or a template"),
        (OrderSaved(name="X", when=Daily(at="08:00"), template="Nothing"), "there is no template Nothing"),
        (OrderSaved(name="X", when=Daily(at="08:00"), task=task_request("Jarr2")), "Jarr2"),
        (OrderSaved(name="X", when=Daily(at="25:00"), task=task_request()), "is not a time of day"),
        (OrderSaved(name="X", when=Once(at=5.0), task=task_request()), "that time is in the past"),
        (OrderSaved(name=" ", when=Daily(at="08:00"), task=task_request()), "is not a name"),
    ],
)
def test_an_order_that_could_not_be_stated_is_not_taken(saved: OrderSaved, wrong: str, tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        with pytest.raises(InputError, match=wrong):
            await api.orders.add_order(saved)
        assert (await api.orders.orders()).orders == ()

    run_scenario(tmp_path, scenario)


def test_orders_are_changed_by_whoever_knows_them_as_they_are(tmp_path: Path) -> None:
    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        order = await api.orders.add_order(OrderSaved(name="Often", when=Every(minutes=60), task=task_request()))
        new = OrderSaved(name="Rarely", when=Every(minutes=6000), task=task_request(), expected_version=1, by="Ada")
        changed = await api.orders.save_order(order.id, new)
        assert (changed.name, changed.version, changed.next) == ("Rarely", 2, MONDAY + 6000 * 60)
        with pytest.raises(Changed, match="was changed by Ada meanwhile"):
            await api.orders.save_order(order.id, new)
        with pytest.raises(Changed):
            await api.orders.remove_order(order.id, expected_version=1)
        await api.orders.remove_order(order.id, expected_version=2)
        with pytest.raises(NotFound):
            await api.orders.order(order.id)

    run_scenario(tmp_path, scenario)


# When parts of the system are away


def test_a_task_manager_that_is_away_for_a_moment_gets_the_task_once(tmp_path: Path) -> None:
    porter = Porter("Robot1")

    async def scenario(system: SmallSystem, api: LiveApi, clock: Time) -> None:
        order = await api.orders.add_order(OrderSaved(name="Often", when=Every(minutes=60), task=task_request()))
        await system.stop_manager()
        await clock.pass_by(HOUR + 1)
        await begun(api, order, 1)
        assert [run.state for run in await runs(api, order)] == [RunState.SUBMITTING]
        await system.start_manager()
        (run,) = await settled(api, order)
        assert (run.state, run.outcome) == (RunState.SUBMITTED, Outcome.ACCOMPLISHED)
        assert porter.delivered == ["Jar002"]

    run_scenario(tmp_path, scenario, porter)


def test_orders_survive_a_restart_of_the_windows_and_each_time_is_stated_once(tmp_path: Path) -> None:
    """The API ends while a task runs; while it is unknown whether the Task Manager has accepted another task; and for a day."""
    porter = Porter("Robot1", seconds=1.0)

    async def scenario(system: SmallSystem, clock: Time) -> None:
        def open_api() -> AbstractAsyncContextManager[LiveApi]:
            return live_api_at(system, clock)

        async with open_api() as first:
            await first.orders.save_template("Bring", BRING_TEMPLATE)
            daily = OrderSaved(name="Daily", when=Daily(at="08:00"), template="Bring", values={"Thing": "Jar001"})
            order = await first.orders.add_order(daily)
            await clock.pass_by(2 * HOUR + 1)
            while (await runs(first, order))[0].state is not RunState.SUBMITTED:
                await asyncio.sleep(0.02)
            with pytest.raises(UsageError, match="is in use"):
                async with open_api():
                    pass  # the file has one owner at a time
        async with open_api() as second:
            assert (await second.orders.order(order.id)).template == "Bring"
            (run,) = await settled(second, order)
            assert run.outcome is Outcome.ACCOMPLISHED

            await system.stop_manager()
            await clock.pass_by(DAY)
            await begun(second, order, 2)
            assert (await runs(second, order))[0].state is RunState.SUBMITTING
        await system.start_manager()
        async with Client(system.addresses) as client:  # the message came through, and its answer did not
            task_id = await client.submit(task_request("Jar001"), id=message_for(order.id, MONDAY + DAY + 2 * HOUR))
        async with open_api() as third:
            await clock.jump(2)  # its message was too late to be sent again, and what became of it is asked
            run, _ = await settled(third, order, 2)
            assert (run.task, run.state) == (task_id, RunState.SUBMITTED)

            await system.stop_manager()
            await clock.pass_by(DAY)
            await begun(third, order, 3)
            assert (await runs(third, order))[0].state is RunState.SUBMITTING
        clock.add(120)
        await system.start_manager()
        async with open_api() as fourth:
            await clock.jump(2)
            run, *_ = await settled(fourth, order, 3)
            assert (run.state, run.task) == (RunState.MISSED, None)
            assert "has not accepted the task" in run.note
        clock.add(3 * DAY)
        async with open_api() as fifth:
            run, *_ = await settled(fifth, order, 4)
            assert (run.state, run.times) == (RunState.MISSED, 3)
            assert (await fifth.orders.order(order.id)).next == MONDAY + 6 * DAY + 2 * HOUR
        assert len(porter.delivered) == 1, "the second task found that it was so already"
        assert len(system.manager.state.tasks) == 2

    async def run() -> None:
        system, clock = SmallSystem(tmp_path, [porter]), Time(MONDAY)
        async with asyncio.timeout(HANG_TIME):
            await system.start()
            try:
                await scenario(system, clock)
            finally:
                await system.stop()

    asyncio.run(run())
