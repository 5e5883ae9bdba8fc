"""Asking a person where a thing is: the question, answers that will not do, and the one that is taken."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from somrs.client.addresses import Addresses
from somrs.devices.person import assignments
from somrs.devices.person.device import Person
from somrs.devices.person.questions import Question, Questions
from somrs.errors import UsageError
from somrs.ontology.objects import Object, ObjectAdded
from somrs.protocol.messages.knowledge import Updated, UpdateMap
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.map_reader import MapReader
from somrs.service_manager.sdk.orders import Order, Perform, Quote, Quoted, ServiceFailed, WorkDone
from somrs.service_manager.sdk.service_runner import carry_out
from tests.support.command import somrs
from tests.support.lab import lab
from tests.support.robot_lab import run
from tests.support.virtual_devices import make_ask

ORDER = Order(participant="p", method="recognize", inputs={"Object": "Jar1"}, effect="Jar1.Unknown = FALSE")


class PersonHarness:
    """A person's device, and the questions that the person sees."""

    def __init__(self, folder: Path) -> None:
        ontology, map = lab()
        contents = Contents(
            ontology=ontology,
            map=map.changed(
                [ObjectAdded(Object(name="Anna", type="Person", values={"PositionX": 1.0, "PositionY": 1.0, "PositionZ": 0.0}))]
            ),
        )
        self.ask = make_ask(Repository("http://here/repository", contents), lambda: 0.0)
        self.folder = folder
        self.person = Person("Anna")
        self.person.map, self.person.data, self.person.glance = MapReader(self.ask), folder, 0.01
        self.questions = Questions(folder)

    async def perform(self, request: Quote | Perform) -> object:
        return await carry_out(self.person, request, self.ask, lambda report: None)

    async def change(self, situation: str) -> None:
        """Change the map, and let the person's program read it."""
        assert isinstance(await self.ask(UpdateMap(situation=situation)), Updated)
        await self.person.refresh_offers()

    async def next_question(self) -> Question:
        while not (open_questions := self.questions.open()):
            await asyncio.sleep(0.01)
        return open_questions[0]

    async def verdict(self, number: int) -> str:
        """What is wrong with the answer, or how the question ended."""
        while (question := self.questions.read(number)) is not None and not question.problem and question.ended is None:
            await asyncio.sleep(0.01)
        assert question is not None
        return question.problem or question.ended or ""

    async def command(self, *arguments: str) -> tuple[int, str]:
        """The `somrs` command: its exit code and all that it says."""
        result = await asyncio.to_thread(somrs, *arguments, "--data", self.folder)
        return result.returncode, result.stdout + result.stderr


@asynccontextmanager
async def person_harness(folder: Path) -> AsyncIterator[PersonHarness]:
    harness = PersonHarness(folder)
    await harness.person.open()
    try:
        yield harness
    finally:
        await harness.person.close()
        harness.questions.close()


def test_an_answer_is_taken_once_it_says_what_is_so(tmp_path: Path) -> None:
    async def test() -> None:
        async with person_harness(tmp_path) as harness:
            quoted = await harness.perform(Quote(ORDER))
            assert isinstance(quoted, Quoted)
            assert quoted.price == 20
            waiting = asyncio.create_task(harness.perform(Perform(ORDER)))
            question = await harness.next_question()
            assert "Where is Jar1" in question.text
            assert "Jar1 isOn Table1" in question.text
            harness.questions.answer(question.number, "Jar1 isOn Table2 AND Jar1.PositionX = 8")
            assert await harness.verdict(question.number) == "taken"
            result = await waiting
            assert isinstance(result, WorkDone)
            assert result.situation == "Jar1 isOn Table2 AND Jar1.PositionX = 8 AND Jar1.Unknown = FALSE"
            assert harness.questions.open() == []
            with pytest.raises(UsageError, match="it is closed: taken"):
                harness.questions.answer(question.number, "Jar1 isOn Table1")

    run(test())


@pytest.mark.parametrize(
    ("answer", "expected_problem", "caret"),
    [
        ("Jar1 isOn", "expected", 9),
        ("Jar1 isOn Tabel2", "Tabel2", 10),
        ("Jar1 isOn ?Where", "?Where is unbound", 10),
        ("Jar1 isOn Table1 OR Jar1 isOn Table2", "OR does not say", 0),
        ("Jar1.PositionX > 3", "does not state a value", 15),
        ("Jar2 isOn Table1", "not mention Jar1", 0),
        ("Jar1.Colour = Red", "no attribute Colour", 5),
        ("Jar1.Unknown = TRUE", "--cannot-tell", 13),
    ],
)
def test_an_answer_that_will_not_do_is_shown_with_a_caret_and_asked_again(
    tmp_path: Path, answer: str, expected_problem: str, caret: int
) -> None:
    async def test() -> None:
        async with person_harness(tmp_path) as harness:
            waiting = asyncio.create_task(harness.perform(Perform(ORDER)))
            question = await harness.next_question()
            harness.questions.answer(question.number, answer)
            problem = await harness.verdict(question.number)
            assert expected_problem in problem
            assert f"  {answer}\n  {' ' * caret}^" in problem, problem
            assert [open_question.number for open_question in harness.questions.open()] == [question.number]
            harness.questions.answer(question.number, "Jar1 isHeldBy Robot1")
            result = await waiting
            assert isinstance(result, WorkDone)
            assert result.situation == "Jar1 isHeldBy Robot1 AND Jar1.Unknown = FALSE"

    run(test())


def test_who_does_not_answer_or_cannot_tell_leaves_it_unknown(tmp_path: Path) -> None:
    async def test() -> None:
        async with person_harness(tmp_path) as harness:
            await harness.change("Anna.AnswerTime = 0.1")
            with pytest.raises(ServiceFailed, match="there was no answer within") as failed:
                await harness.perform(Perform(ORDER))
            assert failed.value.situation is None
            assert harness.questions.open() == []
            await harness.change("Anna.AnswerTime = 60")
            waiting = asyncio.create_task(harness.perform(Perform(ORDER)))
            harness.questions.answer((await harness.next_question()).number, "")
            with pytest.raises(ServiceFailed, match="cannot tell where Jar1 is"):
                await waiting

    run(test())


def test_a_question_that_nobody_needs_answered_any_more_is_taken_back(tmp_path: Path) -> None:
    async def test() -> None:
        async with person_harness(tmp_path) as harness:
            waiting = asyncio.create_task(harness.perform(Perform(ORDER)))
            first = await harness.next_question()
            waiting.cancel()
            await asyncio.gather(waiting, return_exceptions=True)
            with pytest.raises(UsageError, match="the answer is no longer needed"):
                harness.questions.answer(first.number, "Jar1 isOn Table1")
            earlier_number = harness.questions.ask("Anna", "Jar1", "Where?", 60)
            await harness.person.open()
            assert harness.questions.open() == [], "what an earlier run asked, nobody waits for"
            second_run = asyncio.create_task(harness.perform(Perform(ORDER)))
            assert (await harness.next_question()).number > earlier_number > first.number
            second_run.cancel()
            await asyncio.gather(second_run, return_exceptions=True)

    run(test())


def test_the_commands_list_and_answer(tmp_path: Path) -> None:
    async def test() -> None:
        async with person_harness(tmp_path) as harness:
            assert (await harness.command("questions"))[1] == "no open questions\n"
            waiting = asyncio.create_task(harness.perform(Perform(ORDER)))
            number = str((await harness.next_question()).number)
            code, output = await harness.command("questions")
            assert code == 0
            assert "Where is Jar1" in output
            code, output = await harness.command("answer", number, "Jar1 isOn Tabel2")
            assert code == 2
            assert "^" in output
            assert "still open" in output
            assert (await harness.command("answer", number))[0] == 2
            assert await harness.command("answer", number, "Jar1 isOn Table2") == (0, "answer accepted\n")
            assert isinstance(await waiting, WorkDone)
            code, output = await harness.command("answer", number, "Jar1 isOn Table2")
            assert (code, "it is closed" in output) == (2, True)

    run(test())


@pytest.mark.parametrize(
    ("runs", "arguments", "code", "expected_text"),
    [
        (False, ["questions"], 2, "no system runs here"),
        (False, ["answer", "1", "A isOn B"], 2, "no system runs here"),
        (True, ["questions"], 0, "no open questions"),
        (True, ["answer", "1", "A isOn B"], 2, "there is no such question"),
    ],
)
def test_where_nobody_was_asked_the_commands_say_so(
    runs: bool, arguments: list[str], code: int, expected_text: str, tmp_path: Path
) -> None:
    if runs:
        Addresses(repository="http://here/repository", registry="http://here/registry", task_manager="http://here/manager").write(tmp_path)
    result = somrs(*arguments, "--data", tmp_path)
    assert result.returncode == code
    assert expected_text in result.stdout + result.stderr


def test_a_person_who_cannot_be_given_steps_leaves_no_file_open(tmp_path: Path) -> None:
    async def test() -> None:
        (tmp_path / assignments.FILE).mkdir()
        person = Person("Anna")
        person.data = tmp_path
        with pytest.raises(UsageError, match="the assignments cannot be kept here"):
            await person.open()
        assert (tmp_path / "questions.sqlite-wal").exists()
        await person.close()
        assert not (tmp_path / "questions.sqlite-wal").exists(), "which goes with the last connection"

    run(test())
