"""A person who does steps of plans: what is offered, the replies, and what the Task Manager hears of them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from somrs.client.people import put_reply
from somrs.devices.person.assignments import CODE_LENGTH, Assignment, Assignments, Reply, ReplyKind
from somrs.devices.person.device import Person
from somrs.devices.person.offers import read_offers
from somrs.devices.person.wording import sentence
from somrs.entish.parse import parse
from somrs.errors import UsageError
from somrs.ontology.objects import Object, ObjectAdded
from somrs.protocol.messages.knowledge import Updated, UpdateMap
from somrs.protocol.messages.observations import Observation
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Halt, Order, Perform, Quote, Quoted, Refusal, ServiceFailed, Undo, WorkDone
from somrs.service_manager.sdk.service_runner import carry_out
from tests.support.command import somrs
from tests.support.lab import lab
from tests.support.robot_lab import run
from tests.support.virtual_devices import make_ask

CARRY = Order(
    participant="p",
    method="do_TransferObject",
    inputs={"Object": "Jar1", "Destination": "Table2"},
    effect="?Object isOn ?Destination",
    transaction="t1",
)
WEIGH = Order(participant="p", method="do_Weigh", inputs={"Object": "Jar1"}, effect="?Object.Weight = ?Weight", transaction="t2")


class Worker:
    """A person's device, and the assignments that the person sees."""

    def __init__(self, folder: Path, offers: str) -> None:
        ontology, map = lab()
        anna = Object(name="Anna", type="Person", values={"Offers": offers, "PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.0})
        contents = Contents(ontology=ontology, map=map.changed([ObjectAdded(anna)]))
        self.ask = make_ask(Repository("http://here/repository", contents), lambda: 0.0)
        self.folder, self.reported = folder, [""]
        self.person = Person("Anna")
        self.person.map, self.person.data, self.person.glance = MapReader(self.ask), folder, 0.01
        self.person.observer = lambda situation, observation: self.reported.append(situation or "")
        self.notes: list[object] = []
        self.begun: list[asyncio.Task[object]] = []

    async def change(self, situation: str) -> None:
        assert isinstance(await self.ask(UpdateMap(situation=situation)), Updated)

    async def carry_out(self, work: Quote | Perform | Undo | Halt) -> object:
        return await carry_out(self.person, work, self.ask, self.notes.append)

    def begin(self, work: Perform | Undo | Halt) -> asyncio.Task[object]:
        self.begun.append(asyncio.create_task(self.carry_out(work)))
        return self.begun[-1]

    async def close(self) -> None:
        """End as a program does: the work first, and then the person's device."""
        for work in self.begun:
            work.cancel()
        await asyncio.gather(*self.begun, return_exceptions=True)
        await self.person.close()

    async def next_assignment(self) -> Assignment:
        while not (open_assignments := self.person.assignments.open("Anna")):
            await asyncio.sleep(0.01)
        return open_assignments[0]

    async def reply(self, reply: Reply) -> None:
        await asyncio.to_thread(put_reply, (await self.next_assignment()).number, reply, self.folder)

    async def command(self, *arguments: str) -> tuple[int, str]:
        result = await asyncio.to_thread(somrs, *arguments, "--data", self.folder)
        return result.returncode, result.stdout + result.stderr


@asynccontextmanager
async def worker(folder: Path, offers: str = "TransferObject, Weigh") -> AsyncIterator[Worker]:
    harness = Worker(folder, offers)
    await harness.person.open()
    try:
        yield harness
    finally:
        await harness.close()


def test_a_person_offers_what_the_map_says(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path, "TransferObject,OpenDoor  TransferObject") as harness:
            types = [capability.type_name for capability in harness.person.profile().capabilities]
            assert types == ["RecognizeSituation", "TransferObject", "OpenDoor"]
        async with worker(tmp_path, "") as harness:
            assert [capability.type_name for capability in harness.person.profile().capabilities] == ["RecognizeSituation"]

    run(test())


def test_prices_and_durations_are_those_that_the_map_states_now(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path, "TransferObject (4 EUR, 2 min), Weigh") as harness:

            async def terms(order: Order) -> tuple[float, float]:
                quoted = await harness.carry_out(Quote(order))
                assert isinstance(quoted, Quoted)
                return quoted.price, quoted.duration

            assert (await terms(CARRY), await terms(WEIGH)) == ((4, 120), (20, 600))
            await harness.change("Anna.Price = 7 AND Anna.StepTime = 3 min")
            assert (await terms(CARRY), await terms(WEIGH)) == ((4, 120), (7, 180))
            await harness.change('Anna.Offers = "TransferObject (1 min), Weigh (1 EUR)"')
            assert (await terms(CARRY), await terms(WEIGH)) == ((7, 60), (1, 180))

    run(test())


def test_a_person_offers_at_once_what_the_map_says_while_the_program_runs(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path, "TransferObject") as harness:
            changed = asyncio.Event()
            harness.person.publisher, harness.person.review = changed.set, 0.01
            await harness.change('Anna.Offers = "Weigh"')
            await changed.wait()
            assert [capability.type_name for capability in harness.person.profile().capabilities] == ["RecognizeSituation", "Weigh"]
            working = harness.begin(Perform(CARRY))
            await harness.reply(Reply(kind=ReplyKind.DONE))
            assert await working == WorkDone(situation="Jar1 isOn Table2"), "contracts stay"

    run(test())


@pytest.mark.parametrize(
    ("offers", "types", "problem"),
    [
        ("TransferObject(4 EUR,2 min),Weigh", ["TransferObject", "Weigh"], None),
        ("TransferObject, Weigh (4 kg)", ["TransferObject"], "'4 kg' of Weigh is neither a price nor a duration"),
        ("TransferObject, Weigh (5)", ["TransferObject"], "'5' of Weigh is neither a price nor a duration"),
        ("TransferObject, 3 jars", ["TransferObject"], "'3 jars' does not begin with the name of a service type"),
        ("TransferObject, Weigh (4 EUR", ["TransferObject", "Weigh"], "'(4 EUR' does not begin with the name"),
    ],
)
def test_what_is_wrong_in_the_offers_is_said_and_the_rest_counts(offers: str, types: list[str], problem: str | None) -> None:
    read = read_offers(Object(name="Anna", type="Person", values={"Offers": offers}))
    assert [step.service_type for step in read.steps] == types
    assert (problem is None) == (read.problems == ())
    assert problem is None or problem in read.problems[0]


def test_who_does_not_answer_in_time_counts_as_not_available(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            await harness.change("Anna.AnswerTime = 0.05")
            await harness.person.refresh_offers()
            with pytest.raises(ServiceFailed, match="Anna did not answer within") as missed:
                await harness.carry_out(Perform(CARRY))
            assert not missed.value.tried
            assert harness.reported[-1] == "Anna.Working = FALSE"
            request = harness.person.assignments.missed("Anna")
            assert request is not None
            assert request.work.effect == "Jar1 isOn Table2"
            await harness.change("Anna.AnswerTime = 60 AND Anna.Working = TRUE")
            await harness.person.refresh_offers()
            assert isinstance(await harness.carry_out(Quote(CARRY)), Quoted), "it was no refusal for good"
            working = harness.begin(Perform(CARRY))
            await harness.reply(Reply(kind=ReplyKind.DONE))
            await working
            assert harness.person.assignments.missed("Anna") is None

    run(test())


def test_the_work_is_described_in_words(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            harness.begin(Perform(CARRY))
            work = (await harness.next_assignment()).work
            assert work.aim == "Jar1 (jar) is on Table2 (red table)"
            assert work.present == "Jar1 (jar) is on Table1 (table)"
            assert [(outcome.text, outcome.situation) for outcome in work.outcomes] == [
                ("Nothing has changed: Jar1 (jar) is on Table1 (table)", "Jar1 isOn Table1"),
                ("It is done: Jar1 (jar) is on Table2 (red table)", "Jar1 isOn Table2"),
                ("I have it with me: Jar1 (jar) is held by Anna (person)", "Jar1 isHeldBy Anna"),
            ]

    run(test())


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        ("Jar1 isOn Table1 AND NOT Jar1 isOn Table2", "Jar1 is on Table1, and Jar1 is not on Table2"),
        ("Door1.Open = TRUE", "Door1 is open"),
        ("Door1.Open = FALSE", "Door1 is not open"),
        ("Jar1.Weight = 1.5 kg", "the weight of Jar1 is 1.5 kg"),
        ("Jar1.Weight = ?Weight", "the weight of Jar1"),
        ("Jar1.Unknown = FALSE", "where Jar1 is"),
        ("?Thing isOn Table1", "what is on Table1"),
        ("Jar1.Shape.Height >= 3 m", "the shape height of Jar1 is at least 3 m"),
        ("?Thing: Jar isOn Table1", "something (jar) is on Table1"),
        ("Jar1 isOn Table1 OR Jar1 isOn Table2", "Jar1 isOn Table1 OR Jar1 isOn Table2"),
    ],
)
def test_formulas_in_words(formula: str, text: str) -> None:
    assert sentence(parse(formula), {}) == text


def test_who_is_stopped_at_work_says_what_is_so_then(tmp_path: Path) -> None:
    async def stop(harness: Worker, reply: Reply) -> object:
        working = harness.begin(Perform(CARRY))
        await harness.reply(Reply(kind=ReplyKind.ACCEPT))
        working.cancel()
        await asyncio.wait({working})
        halting = harness.begin(Halt(CARRY))
        assert (await harness.next_assignment()).work.stops
        with pytest.raises(UsageError, match="asks what is so now"):
            await harness.reply(Reply(kind=ReplyKind.DECLINE))
        with pytest.raises(UsageError, match="Tabel1"):
            await harness.reply(Reply(kind=ReplyKind.COULD_NOT, situation="Jar1 isOn Tabel1"))
        await harness.reply(reply)
        return await halting

    async def test() -> None:
        async with worker(tmp_path) as harness:
            left = Reply(kind=ReplyKind.COULD_NOT, situation="Jar1 isHeldBy Anna")
            assert await stop(harness, left) == WorkDone(situation="Jar1 isHeldBy Anna")
            assert await stop(harness, Reply(kind=ReplyKind.DONE)) == WorkDone(situation="Jar1 isOn Table2")
            assert await stop(harness, Reply(kind=ReplyKind.COULD_NOT)) == WorkDone(situation=None)
            assert harness.person.assignments.open() == []

    run(test())


def test_who_is_stopped_before_accepting_has_changed_nothing_and_is_not_asked(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            working = harness.begin(Perform(CARRY))
            await harness.next_assignment()
            working.cancel()
            await asyncio.wait({working})
            assert await harness.carry_out(Halt(CARRY)) == WorkDone(situation="Jar1 isOn Table1")

    run(test())


def test_a_step_is_accepted_and_done(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            quoted = await harness.carry_out(Quote(CARRY))
            assert isinstance(quoted, Quoted)
            assert (quoted.price, quoted.duration) == (20, 600)
            working = harness.begin(Perform(CARRY))
            assignment = await harness.next_assignment()
            assert assignment.work.effect == "Jar1 isOn Table2"
            assert assignment.work.objects == ("Jar1", "Table2")
            await harness.reply(Reply(kind=ReplyKind.ACCEPT))
            assert (await harness.next_assignment()).accepted is not None
            with pytest.raises(UsageError, match="is accepted already"):
                await harness.reply(Reply(kind=ReplyKind.DECLINE))
            await harness.reply(Reply(kind=ReplyKind.DONE))
            assert await working == WorkDone(situation="Jar1 isOn Table2")
            assert harness.person.assignments.open() == []

    run(test())


def test_a_person_who_declines_has_begun_nothing_and_is_not_asked_for_the_same_again(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            working = harness.begin(Perform(CARRY))
            await harness.reply(Reply(kind=ReplyKind.DECLINE, reason="too heavy for me"))
            with pytest.raises(ServiceFailed, match="Anna declined: too heavy for me") as declined:
                await working
            assert not declined.value.tried
            with pytest.raises(Refusal, match="has declined this step"):
                await harness.carry_out(Quote(CARRY))
            other_task = Order(
                participant="p", method=CARRY.method, inputs=CARRY.inputs, effect=CARRY.effect, transaction="another transaction"
            )
            assert isinstance(await harness.carry_out(Quote(other_task)), Quoted)

    run(test())


def test_not_now_makes_the_person_unavailable_until_they_say_otherwise(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            working = harness.begin(Perform(CARRY))
            await harness.reply(Reply(kind=ReplyKind.NOT_NOW))
            with pytest.raises(ServiceFailed, match="has no time now") as postponed:
                await working
            assert not postponed.value.tried
            assert harness.reported[-1] == "Anna.Working = FALSE"
            assert isinstance(await harness.ask(UpdateMap(situation="Anna.Working = FALSE")), Updated)
            with pytest.raises(Refusal, match="Anna is not available now") as refused:
                await harness.carry_out(Quote(CARRY))
            assert refused.value.not_now
            assert isinstance(await harness.ask(UpdateMap(situation="Anna.Working = TRUE")), Updated)
            assert isinstance(await harness.carry_out(Quote(CARRY)), Quoted)

    run(test())


def test_work_that_could_not_be_done_says_what_is_left(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            working = harness.begin(Perform(CARRY))
            await harness.reply(Reply(kind=ReplyKind.ACCEPT))
            with pytest.raises(UsageError, match="Tabel1") as mistake:
                await harness.reply(Reply(kind=ReplyKind.COULD_NOT, reason="the jar broke", situation="Jar1 isOn Tabel1"))
            assert "the assignment is still open" in str(mistake.value)
            await harness.reply(Reply(kind=ReplyKind.COULD_NOT, reason="the way is blocked", situation="Jar1 isOn Table1"))
            with pytest.raises(ServiceFailed, match="could not do it: the way is blocked") as failed:
                await working
            assert failed.value.situation == "Jar1 isOn Table1"
            assert failed.value.tried

    run(test())


def test_values_that_the_work_finds_out_are_asked_for(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            working = harness.begin(Perform(WEIGH))
            assert (await harness.next_assignment()).work.open_variables == ("Weight",)
            for values, problem in (({}, "the value of .Weight is missing"), ({"Weight": "?Much"}, "is not a value")):
                with pytest.raises(UsageError, match=problem):
                    await harness.reply(Reply(kind=ReplyKind.DONE, values=values))
            await harness.reply(Reply(kind=ReplyKind.DONE, values={"Weight": "1.5 kg"}))
            done = await working
            assert isinstance(done, WorkDone)
            assert done.situation == "Jar1.Weight = 1.5 kg"

    run(test())


LOOK = Order(participant="p", method="do_LookAt", inputs={"Place": "Table2"}, effect="?Thing isOn ?Place", transaction="t3")
SEEN = "Jar1 isOn Table2 AND ?seen0: Jar isOn Table2 AND ?seen0.Color = Red"
AT = "?seen0.PositionX = 7.62 m AND ?seen0.PositionY = 7.62 m AND ?seen0.PositionZ = 0.7 m"
FIND = Order(participant="p", method="do_FindJar", inputs={"Object": "Jar1"}, effect="?Object.Unknown = FALSE", transaction="t4")


@pytest.mark.parametrize(
    ("reply", "done"),
    [
        (
            Reply(kind=ReplyKind.DONE, situation=SEEN, searched=("Table2",)),
            WorkDone(
                situation=f"{SEEN} AND {AT} AND Jar1.Unknown = FALSE AND ?seen0.Unknown = FALSE",
                observation=Observation(searched=("Table2",)),
            ),
        ),
        (
            Reply(kind=ReplyKind.DONE, searched=("Table2",)),
            WorkDone(situation="Anna.Working = TRUE", observation=Observation(searched=("Table2",))),
        ),
    ],
)
def test_a_person_who_looks_reports_things_like_a_camera(tmp_path: Path, reply: Reply, done: WorkDone) -> None:
    async def test() -> None:
        async with worker(tmp_path, "LookAt") as harness:
            working = harness.begin(Perform(LOOK))
            for problem, unsuitable in (
                ("has no type", Reply(kind=ReplyKind.DONE, situation="?It isOn Table2")),
                ("there is no object Tabel2", Reply(kind=ReplyKind.DONE, searched=("Tabel2",))),
                ("does not state a fact", Reply(kind=ReplyKind.DONE, situation="FORALL ?It: Jar (?It isOn Table2)")),
            ):
                with pytest.raises(UsageError, match=problem):
                    await harness.reply(unsuitable)
            await harness.reply(reply)
            assert await working == done

    run(test())


def test_who_is_to_find_a_thing_has_to_say_where_it_is(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path, "FindJar") as harness:
            working = harness.begin(Perform(FIND))
            with pytest.raises(UsageError, match="where Jar1 is, and how it is, is missing"):
                await harness.reply(Reply(kind=ReplyKind.DONE))
            await harness.reply(Reply(kind=ReplyKind.DONE, situation="Jar1 isOn Table2"))
            assert await working == WorkDone(situation="Jar1 isOn Table2 AND Jar1.Unknown = FALSE")

    run(test())


def test_undoing_is_an_assignment_too(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            undoing = harness.begin(Undo(CARRY, "Jar1 isOn Table1"))
            assignment = await harness.next_assignment()
            assert assignment.work.undoes
            assert assignment.work.effect == "Jar1 isOn Table1"
            await harness.reply(Reply(kind=ReplyKind.DONE))
            assert await undoing == WorkDone(situation="Jar1 isOn Table1")

    run(test())


def test_an_assignment_that_nobody_needs_any_more_is_closed(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            working = harness.begin(Perform(CARRY))
            number = (await harness.next_assignment()).number
            working.cancel()
            await asyncio.wait({working})
            with pytest.raises(UsageError, match="it is closed: it is no longer needed"):
                put_reply(number, Reply(kind=ReplyKind.DONE), tmp_path)

    run(test())


def test_the_command_line_lists_and_replies(tmp_path: Path) -> None:
    async def test() -> None:
        async with worker(tmp_path) as harness:
            working = harness.begin(Perform(CARRY))
            number = str((await harness.next_assignment()).number)
            code, output = await harness.command("people", "--json")
            assert code == 0
            listing = json.loads(output)
            assert [*listing["codes"]] == ["Anna"]
            assert listing["assignments"][0]["work"]["effect"] == "Jar1 isOn Table2"
            code, output = await harness.command("people")
            assert f"/person/{listing['codes']['Anna']}" in output
            assert "TransferObject: Jar1 isOn Table2" in output
            assert (await harness.command("reply", number, "perhaps"))[0] == 2
            assert await harness.command("reply", number, "accept") == (0, "reply accepted\n")
            code, output = await harness.command("reply", number, "could-not", "--because", "blocked", "--situation", "Jar1 isOn")
            assert code == 2
            assert "^" in output
            assert (await harness.command("reply", number, "done"))[0] == 0
            assert isinstance(await working, WorkDone)
            code, output = await harness.command("reply", number, "done")
            assert code == 2
            assert "it is closed: done" in output

    run(test())


def test_codes_stay_and_differ(tmp_path: Path) -> None:
    store = Assignments(tmp_path)
    codes = {store.code_of(name) for name in ("Anna", "Berta", "Carla")}
    assert len(codes) == 3
    assert all(len(code) == CODE_LENGTH and code.isalnum() for code in codes)
    assert {store.code_of(name) for name in ("Anna", "Berta", "Carla")} == codes
    store.close()
