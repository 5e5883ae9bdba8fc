"""Asking a person where a thing is: the question, answers that will not do, and the one that is taken."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from somrs.client.client import Addresses
from somrs.devices.person.device import Person
from somrs.devices.person.questions import Question, Questions
from somrs.errors import UsageError
from somrs.ontology.objects import Object, ObjectAdded
from somrs.repository.component import Repository
from somrs.repository.state import Contents
from somrs.service_manager.sdk.device import MapReader
from somrs.service_manager.sdk.orders import Order, Perform, Quote, Quoted, ServiceFailed, WorkDone
from somrs.service_manager.sdk.work import carry_out
from tests.support.command import somrs
from tests.support.lab import lab
from tests.support.robot_lab import run
from tests.support.virtual_devices import asking

ORDER = Order(participant="p", method="recognize", inputs={"Object": "Jar1"}, effect="Jar1.Unknown = FALSE")


class Desk:
    """A person's device, and the questions that the person sees."""

    def __init__(self, folder: Path) -> None:
        ontology, map = lab()
        known = Contents(ontology=ontology, map=map.changed([ObjectAdded(Object(name="Anna", type="Person"))]))
        self.ask = asking(Repository("http://here/repository", known), lambda: 0.0)
        self.folder = folder
        self.person = Person("Anna")
        self.person.map, self.person.data, self.person.glance = MapReader(self.ask), folder, 0.01
        self.seen = Questions(folder)

    async def do(self, work: Quote | Perform) -> object:
        return await carry_out(self.person, work, self.ask, lambda report: None)

    async def asked(self) -> Question:
        while not (found := self.seen.open()):
            await asyncio.sleep(0.01)
        return found[0]

    async def verdict(self, number: int) -> str:
        """What is wrong with the answer, or how the question ended."""
        while (question := self.seen.read(number)) is not None and not question.problem and question.ended is None:
            await asyncio.sleep(0.01)
        assert question is not None
        return question.problem or question.ended or ""

    async def command(self, *arguments: str) -> tuple[int, str]:
        """The `somrs` command: its exit code and all that it says."""
        said = await asyncio.to_thread(somrs, *arguments, "--data", self.folder)
        return said.returncode, said.stdout + said.stderr


@asynccontextmanager
async def desk(folder: Path) -> AsyncIterator[Desk]:
    at = Desk(folder)
    await at.person.open()
    try:
        yield at
    finally:
        await at.person.close()
        at.seen.close()


def test_an_answer_is_taken_once_it_says_what_is_so(tmp_path: Path) -> None:
    async def test() -> None:
        async with desk(tmp_path) as at:
            quoted = await at.do(Quote(ORDER))
            assert isinstance(quoted, Quoted)
            assert quoted.price == 20
            waiting = asyncio.create_task(at.do(Perform(ORDER)))
            question = await at.asked()
            assert "Where is Jar1" in question.text
            assert "Jar1 isOn Table1" in question.text
            at.seen.answer(question.number, "Jar1 isOn Table2 AND Jar1.PositionX = 8")
            assert await at.verdict(question.number) == "taken"
            done = await waiting
            assert isinstance(done, WorkDone)
            assert done.situation == "Jar1 isOn Table2 AND Jar1.PositionX = 8 AND Jar1.Unknown = FALSE"
            assert at.seen.open() == []
            with pytest.raises(UsageError, match="it is over: taken"):
                at.seen.answer(question.number, "Jar1 isOn Table1")

    run(test())


@pytest.mark.parametrize(
    ("answer", "told", "caret"),
    [
        ("Jar1 isOn", "expected", 9),
        ("Jar1 isOn Tabel2", "Tabel2", 10),
        ("Jar1 isOn ?Where", "?Where is open", 10),
        ("Jar1 isOn Table1 OR Jar1 isOn Table2", "OR does not say", 0),
        ("Jar1.PositionX > 3", "does not say how it is", 15),
        ("Jar2 isOn Table1", "nothing of Jar1", 0),
        ("Jar1.Colour = Red", "no attribute Colour", 5),
        ("Jar1.Unknown = TRUE", "--cannot-tell", 13),
    ],
)
def test_an_answer_that_will_not_do_is_shown_with_a_caret_and_asked_again(tmp_path: Path, answer: str, told: str, caret: int) -> None:
    async def test() -> None:
        async with desk(tmp_path) as at:
            waiting = asyncio.create_task(at.do(Perform(ORDER)))
            question = await at.asked()
            at.seen.answer(question.number, answer)
            problem = await at.verdict(question.number)
            assert told in problem
            assert f"  {answer}\n  {' ' * caret}^" in problem, problem
            assert [one.number for one in at.seen.open()] == [question.number]
            at.seen.answer(question.number, "Jar1 isHeldBy Robot1")
            done = await waiting
            assert isinstance(done, WorkDone)
            assert done.situation == "Jar1 isHeldBy Robot1 AND Jar1.Unknown = FALSE"

    run(test())


def test_who_does_not_answer_or_cannot_tell_leaves_it_unknown(tmp_path: Path) -> None:
    async def test() -> None:
        async with desk(tmp_path) as at:
            at.person.patience = 0.1
            with pytest.raises(ServiceFailed, match="did not answer within") as failed:
                await at.do(Perform(ORDER))
            assert failed.value.situation is None
            assert at.seen.open() == []
            at.person.patience = 60
            waiting = asyncio.create_task(at.do(Perform(ORDER)))
            at.seen.answer((await at.asked()).number, "")
            with pytest.raises(ServiceFailed, match="cannot tell where Jar1 is"):
                await waiting

    run(test())


def test_a_question_that_nobody_needs_answered_any_more_is_taken_back(tmp_path: Path) -> None:
    async def test() -> None:
        async with desk(tmp_path) as at:
            waiting = asyncio.create_task(at.do(Perform(ORDER)))
            first = await at.asked()
            waiting.cancel()
            await asyncio.gather(waiting, return_exceptions=True)
            with pytest.raises(UsageError, match="nobody needs the answer"):
                at.seen.answer(first.number, "Jar1 isOn Table1")
            left = at.seen.ask("Anna", "Jar1", "Where?", 60)
            await at.person.open()
            assert at.seen.open() == [], "what an earlier run asked, nobody waits for"
            again = asyncio.create_task(at.do(Perform(ORDER)))
            assert (await at.asked()).number > left > first.number
            again.cancel()
            await asyncio.gather(again, return_exceptions=True)

    run(test())


def test_the_commands_list_and_answer(tmp_path: Path) -> None:
    async def test() -> None:
        async with desk(tmp_path) as at:
            assert (await at.command("questions"))[1] == "nobody asks anything\n"
            waiting = asyncio.create_task(at.do(Perform(ORDER)))
            number = str((await at.asked()).number)
            code, said = await at.command("questions")
            assert code == 0
            assert "Where is Jar1" in said
            code, said = await at.command("answer", number, "Jar1 isOn Tabel2")
            assert code == 2
            assert "^" in said
            assert "still open" in said
            assert (await at.command("answer", number))[0] == 2
            assert await at.command("answer", number, "Jar1 isOn Table2") == (0, "thank you\n")
            assert isinstance(await waiting, WorkDone)
            code, said = await at.command("answer", number, "Jar1 isOn Table2")
            assert (code, "it is over" in said) == (2, True)

    run(test())


@pytest.mark.parametrize(
    ("runs", "arguments", "code", "told"),
    [
        (False, ["questions"], 2, "no system runs here"),
        (False, ["answer", "1", "A isOn B"], 2, "no system runs here"),
        (True, ["questions"], 0, "nobody asks anything"),
        (True, ["answer", "1", "A isOn B"], 2, "there is no such question"),
    ],
)
def test_where_nobody_was_asked_the_commands_say_so(runs: bool, arguments: list[str], code: int, told: str, tmp_path: Path) -> None:
    if runs:
        Addresses(repository="http://here/repository", registry="http://here/registry", task_manager="http://here/manager").write(tmp_path)
    said = somrs(*arguments, "--data", tmp_path)
    assert said.returncode == code
    assert told in said.stdout + said.stderr
