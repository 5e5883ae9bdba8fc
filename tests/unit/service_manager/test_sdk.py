"""What authors of devices write with: amounts and terms, what a class says of its device, and how its coroutines are run."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from somrs.entish.formula import Formula, Name, Number, Text, Truth
from somrs.entish.parse import parse
from somrs.errors import DeviceError, FormulaError, InputError, RemoteError
from somrs.kernel.component import ErrorAnswer
from somrs.ontology.objects import Object
from somrs.ontology.services import ServiceType
from somrs.ontology.types import AttributeType, Kind, ObjectType, Value
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.frp import Fault
from somrs.protocol.messages.knowledge import Definitions, MapPage, QueryMap, ReadMap, Row, Rows
from somrs.protocol.messages.observations import Observation
from somrs.service_manager.sdk.device import Device, Result, Service, Situation, Task, service
from somrs.service_manager.sdk.map_reader import MapReader, predecessor_name
from somrs.service_manager.sdk.orders import (
    Advance,
    Capability,
    Failure,
    Halt,
    Order,
    Perform,
    Profile,
    Quote,
    Quoted,
    Refusal,
    Refused,
    ServiceFailed,
    Undo,
    Work,
    WorkDone,
    answer_of,
)
from somrs.service_manager.sdk.service_runner import carry_out
from somrs.service_manager.sdk.values import as_term, fill_in, money, python_value, seconds, term

# Amounts and terms


@pytest.mark.parametrize(
    ("amount", "price"),
    [
        (4, (4.0, "EUR")),
        (0.5, (0.5, "EUR")),
        ("4", (4.0, "EUR")),
        (" 4.5 PLN ", (4.5, "PLN")),
        (".5EUR", (0.5, "EUR")),
        ("3.", (3.0, "EUR")),
    ],
)
def test_what_it_costs(amount: float | str, price: tuple[float, str]) -> None:
    parsed_price = money(amount)
    assert (parsed_price, type(parsed_price[0])) == (price, float)


@pytest.mark.parametrize(
    ("amount", "duration"), [(30, 30.0), ("30", 30.0), ("30 s", 30.0), ("2 min", 120.0), ("1.5h", 5400.0), ("250 ms", 0.25)]
)
def test_how_long_it_takes(amount: float | str, duration: float) -> None:
    assert seconds(amount) == duration


@pytest.mark.parametrize(
    ("read", "amount", "text"),
    [
        (money, "much", "'much' is not a price: write a number, or for example 4 EUR"),
        (money, True, "True is not a price: write a number, or for example 4 EUR"),
        (money, "-1 EUR", "'-1 EUR' is not a price: write a number, or for example 4 EUR"),
        (money, None, "None is not a price: write a number, or for example 4 EUR"),
        (seconds, "soon", "'soon' is not a duration: write a number, or for example 30 s, 2 min or 1 h"),
        (seconds, "3 days", "'3 days' is not a duration: write it as ms, s, min, h"),
    ],
)
def test_what_is_no_amount(read: Callable[[Any], object], amount: object, text: str) -> None:
    with pytest.raises(DeviceError) as error:
        read(amount)
    assert str(error.value) == text


@pytest.mark.parametrize(
    ("text", "value"), [("2", 2.0), ('"a b"', "a b"), ("TRUE", True), ("FALSE", False), ("Jar1", "Jar1"), ("2 m", "2 m"), ("?A.B", "?A.B")]
)
def test_a_term_as_python_has_it(text: str, value: Value) -> None:
    parsed_value = python_value(text)
    assert (parsed_value, type(parsed_value)) == (value, type(value))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (True, Truth(True)),
        (2, Number(2.0)),
        (0.5, Number(0.5)),
        ("Jar1", Name("Jar1")),
        ("Jar-1_a", Name("Jar-1_a")),
        ("a b", Text("a b")),
        ("1a", Text("1a")),
        ("a-", Text("a-")),
        ("", Text("")),
        *((word, Text(word)) for word in ("AND", "OR", "NOT", "FORALL", "EXISTS", "TRUE", "FALSE")),
    ],
)
def test_a_python_value_as_a_term(value: Value, expected: object) -> None:
    assert as_term(value) == expected


def test_a_term_is_read() -> None:
    assert (term("2"), term("Jar1")) == (Number(2.0), Name("Jar1"))
    with pytest.raises(FormulaError):
        term("a b")


def test_a_formula_with_everything_in_its_place() -> None:
    formula = "?Object isOn ?Provider AND ?Object.Weight = ?Weight AND ?Object isIn ?Where"
    assert fill_in(formula, "Robot1", {"Object": "Jar1"}) == parse("Jar1 isOn Robot1 AND Jar1.Weight = ?Weight AND Jar1 isIn ?Where")
    filled = fill_in(formula, "Robot1", {"Object": "Jar1"}, {"Weight": 2, "Where": "Room1"})
    assert filled == parse("Jar1 isOn Robot1 AND Jar1.Weight = 2 AND Jar1 isIn Room1")
    assert fill_in("?Provider isIn A", "Robot1", {"Provider": "Robot2"}) == parse("Robot1 isIn A")


# The map


def make_reader(answer: Body, questions: list[Body]) -> MapReader:
    """A reader of a map whose Repository gives this answer."""

    async def ask(body: Body) -> Body:
        questions.append(body)
        return answer

    return MapReader(ask)


JAR, KEG = Object(name="Jar1", type="Jar"), Object(name="Keg1", type="Keg")


@pytest.mark.parametrize(("objects", "expected_object"), [((JAR, KEG), JAR), ((KEG,), None), ((), None)])
def test_an_object_of_the_map(objects: tuple[Object, ...], expected_object: Object | None) -> None:
    questions: list[Body] = []
    reader = make_reader(MapPage(objects=objects, facts=(), version=1, more=False), questions)
    assert asyncio.run(reader.object("Jar1")) == expected_object
    assert questions == [ReadMap(after="Jar0\ufffd")]
    assert predecessor_name("A") == "@\ufffd"


def test_what_holds_on_the_map() -> None:
    questions: list[Body] = []
    rows = (Row(bindings={"A": "Jar1", "B": "2"}), Row(bindings={"A": "Jar2", "B": "TRUE"}))
    reader = make_reader(Rows(rows=rows, version=1), questions)
    assert asyncio.run(reader.query("?A.X = ?B")) == [{"A": "Jar1", "B": 2.0}, {"A": "Jar2", "B": True}]
    assert asyncio.run(reader.query(parse("?A.X = ?B"), limit=7)) == [{"A": "Jar1", "B": 2.0}, {"A": "Jar2", "B": True}]
    assert asyncio.run(reader.holds("?A.X = ?B")) is True
    assert asyncio.run(make_reader(Rows(rows=(), version=1), []).holds("?A.X = ?B")) is False
    assert questions == [QueryMap(formula="?A.X = ?B", limit=limit) for limit in (1000, 7, 1)]


@given(count=st.integers(0, 30), page=st.integers(1, 7), limit=st.none() | st.integers(0, 40), changes=st.sets(st.integers(0, 60)))
def test_solutions_of_several_pages_come_together(count: int, page: int, limit: int | None, changes: set[int]) -> None:
    """The map changes before some of the requests: then its solutions have other names."""
    version, requests = 0, 0

    async def ask(body: Body) -> Body:
        nonlocal version, requests
        assert isinstance(body, QueryMap)
        version, requests = version + (requests in changes), requests + 1
        solutions = [Row(bindings={"A": f"Jar{number}v{version}"}) for number in range(count)][body.skip :]
        chosen = solutions[: min(page, body.limit)]
        return Rows(rows=tuple(chosen), version=version, more=len(chosen) < len(solutions))

    rows = asyncio.run(MapReader(ask).rows("?A: Jar = ?A", limit))
    names = [row.bindings["A"].partition("v")[0] for row in rows.rows]
    assert names == [f"Jar{number}" for number in range(count)][:limit]
    if not changes:
        assert rows.more == (limit is not None and limit < count)
    if len(changes) <= 8:
        assert len({row.bindings["A"].partition("v")[2] for row in rows.rows}) <= 1, "they are of one version"


@pytest.mark.parametrize(
    ("question", "answer", "text"),
    [
        (lambda reader: reader.object("Jar1"), Fault(code="Sender", text="no"), "no"),
        (lambda reader: reader.query("?A isOn ?B"), Fault(code="Sender", text="no"), "no"),
        (lambda reader: reader.object("Jar1"), Rows(rows=(), version=1), "the Repository answered ReadMap with Rows"),
        (
            lambda reader: reader.query("?A isOn ?B"),
            MapPage(objects=(), facts=(), version=1, more=False),
            "the Repository answered QueryMap with MapPage",
        ),
    ],
)
def test_a_repository_that_gives_no_answer(question: Callable[[MapReader], Awaitable[object]], answer: Body, text: str) -> None:
    async def ask_question() -> object:
        return await question(make_reader(answer, []))

    with pytest.raises(RemoteError) as error:
        asyncio.run(ask_question())
    assert str(error.value) == text


# A class of devices


WASH = ServiceType(name="Wash", effect="?Object isClean ?Provider")
WASHER = ObjectType(name="Washer", parent="Device")
CLEAN = AttributeType(name="Clean", kind=Kind.TRUTH)


class Washer(Device):
    """A device with each kind of service."""

    type = WASHER
    types = (CLEAN, WASHER)
    values = {"PositionX": 1.0}
    situation = "Washer1 isIn Room1"
    attributes = {"Range": 5.0}
    capacity = 2

    def cost(self, task: Task) -> str:
        return f"{len(task.inputs)} PLN"

    async def how_long(self, task: Task) -> str:
        return "2 min"

    async def able(self, task: Task) -> None:
        if task.inputs.get("Object") == "Cat1":
            raise Refusal("no cats")

    @service(WASH, price="4 EUR", duration="30 s", able=able)
    async def wash(self, task: Task) -> Situation:
        match task.inputs.get("Object"):
            case "Jar1":
                return None
            case "Jar2":
                return "Jar2   isOn Table1"
            case "Jar3":
                return parse("Jar3 isOn Table1")
            case "Jar4":
                raise ServiceFailed("it broke", "Jar4 isIn Bin1")
        return 7  # type: ignore[return-value]  # a mistake of the author

    @wash.stopping
    async def release_object(self, task: Task) -> Situation:
        return f"{task.inputs['Object']}  isOn Floor1"

    @wash.compensation
    async def soil(self, task: Task, situation: Formula) -> Situation:
        return "Jar1 isOn Table2" if task.inputs["Object"] == "Jar1" else None

    @service("Weigh", price=cost, duration=how_long)
    async def weigh(self, task: Task) -> Result:
        return Result(outputs={"Weight": 2} if task.inputs else {})


class Quick(Washer):
    """Overrides a service and leaves one out."""

    weigh = None

    @service("Rinse", duration=1)
    async def rinse(self, task: Task) -> Situation:
        return None


def test_what_is_known_of_a_device() -> None:
    assert Washer("Washer1").profile() == Profile(
        name="Washer1",
        type="Washer",
        capabilities=(
            Capability(type=WASH, method="wash", attributes={"Range": 5.0, "Price": 4.0, "Duration": 30.0}, stoppable=True, undoable=True),
            Capability(type="Weigh", method="weigh", attributes={"Range": 5.0}),
        ),
        definitions=Definitions(attributes=(CLEAN,), types=(WASHER,), services=(WASH,)),
        values={"PositionX": 1.0},
        situation="Washer1 isIn Room1",
        capacity=2,
        heartbeat=5.0,
        valid_for=120.0,
        lease=30.0,
    )
    assert Washer("Washer1").profile().service(Capability(type=WASH, method="wash")) == "Washer1.Wash"


def test_services_are_inherited_and_may_be_replaced() -> None:
    assert [*Washer("W").services()] == ["wash", "weigh"]
    services = Quick("Q").services()
    assert [*services] == ["wash", "rinse"]
    assert services["rinse"].capability({}) == Capability(type="Rinse", method="rinse", attributes={"Price": 0.0, "Duration": 1.0})
    assert isinstance(Washer.wash, Service)
    assert Washer.wash is services["wash"]


def test_a_service_goes_by_the_name_that_its_class_gives_it() -> None:
    async def work(device: Device, task: Task) -> Situation:
        return None

    polish_service = service("Polish", duration=1)(work)
    assert polish_service.name == "work"
    device = bare(type="Washer", polish=polish_service)
    assert [capability.method for capability in device.profile().capabilities] == ["polish"]
    assert polish_service.name == "polish"


def test_what_a_device_has_if_its_class_does_not_say_otherwise() -> None:
    device = bare(type="Washer", wash=service("Wash", duration=1)(Washer.weigh.performs))
    plain = Profile(
        name="M", type="Washer", capabilities=(Capability(type="Wash", method="wash", attributes={"Price": 0.0, "Duration": 1.0}),)
    )
    assert device.profile() == plain
    assert (device.data, device.simulator) == (Path(".somrs"), None)


def bare(**members: object) -> Device:
    device: Device = type("Made", (Device,), members)("M")
    return device


@pytest.mark.parametrize(
    ("device", "text"),
    [
        (bare(), "Made has no object type: set the class attribute `type`, such as 'MobileRobot'"),
        (bare(type=5), "Made has no object type: set the class attribute `type`, such as 'MobileRobot'"),
        (bare(type="Washer"), "Made has no services: decorate an `async def` method with @service(...), and keep its name"),
        (
            bare(type="Washer", open=Washer.wash),
            "Made.open is a service, but every device has an attribute open: rename the service",
        ),
        (
            bare(type="Washer", types=(AttributeType(name="A", kind="wrong"),), wash=Washer.wash),  # type: ignore[arg-type]  # the mistake
            "Made brings AttributeType A, which is not valid: Invalid enum value 'wrong' - at `$.kind`",
        ),
    ],
)
def test_why_a_class_cannot_be_run(device: Device, text: str) -> None:
    with pytest.raises(DeviceError) as error:
        device.profile()
    assert str(error.value) == text


def test_what_is_no_service() -> None:
    def wash(self: Device, task: Task) -> None: ...

    with pytest.raises(DeviceError, match=r"wash has to be `async def`: a service takes time, and can be stopped$"):
        service("Wash", duration=1)(wash)  # type: ignore[arg-type]  # the mistake
    for wrong in ({"price": "much", "duration": 1}, {"duration": "long"}):
        with pytest.raises(DeviceError, match=r"is not a (price|duration)"):
            service("Wash", **wrong)(Washer.wash.performs)


def test_what_a_device_observes_is_entish() -> None:
    observations: list[tuple[str | None, Observation]] = []
    device = Washer("Washer1", simulator="http://h/simulator")
    device.observed("Jar1 isOn Table1")
    device.observer = lambda situation, observation: observations.append((situation, observation))
    device.observed("Jar1   isOn Table1")
    device.observed(parse("Jar2 isOn Table1"))
    with pytest.raises(FormulaError):
        device.observed("Jar1 isOn")
    device.observed("?Seen: Jar isOn Table1", as_of=5.0, gone=["Jar3"], searched=["Table1"])
    device.observed(gone=["Jar4"])
    assert observations == [
        ("Jar1 isOn Table1", Observation()),
        ("Jar2 isOn Table1", Observation()),
        ("?Seen: Jar isOn Table1", Observation(as_of=5.0, gone=("Jar3",), searched=("Table1",))),
        (None, Observation(gone=("Jar4",))),
    ]
    assert (device.name, device.simulator, Washer("W").simulator) == ("Washer1", "http://h/simulator", None)


# Work


def order(method: str = "wash", thing: str | None = "Jar1", effect: str = "?Object isClean ?Provider") -> Order:
    return Order(participant="p", method=method, inputs={"Object": thing} if thing else {}, effect=effect)


def perform_work(work: Work, device: Device | None = None) -> object:
    async def ask_nobody(body: Body) -> Body:
        raise AssertionError(body)

    return asyncio.run(carry_out(device or Washer("Washer1"), work, ask_nobody, lambda report: None))


@pytest.mark.parametrize(
    ("work", "answer"),
    [
        (Quote(order()), Quoted(price=4.0, currency="EUR", duration=30.0)),
        (Quote(order("weigh")), Quoted(price=1.0, currency="PLN", duration=120.0)),
        (Perform(order()), WorkDone(situation="Jar1 isClean Washer1")),
        (Perform(order(thing="Jar2")), WorkDone(situation="Jar2 isOn Table1")),
        (Perform(order(thing="Jar3")), WorkDone(situation="Jar3 isOn Table1")),
        (Perform(order("weigh", effect="?Object.Weight = ?Weight")), WorkDone(situation="Jar1.Weight = 2", outputs={"Weight": 2})),
        (Halt(order()), WorkDone(situation="Jar1 isOn Floor1")),
        (Halt(order("weigh")), WorkDone()),
        (Undo(order(), "Jar1 isOn Table1"), WorkDone(situation="Jar1 isOn Table2")),
        (Undo(order(thing="Jar2"), "Jar2 isOn Table1"), WorkDone(situation="Jar2 isOn Table1")),
    ],
)
def test_what_work_comes_to(work: Work, answer: object) -> None:
    assert perform_work(work) == answer


@pytest.mark.parametrize(
    ("work", "answer"),
    [
        (Quote(order(thing="Cat1")), Refused("no cats")),
        (Perform(order(thing="Jar4")), Failure("it broke", "Jar4 isIn Bin1")),
        (Undo(order("weigh"), "Jar1 isOn Table1"), Failure("Washer1 cannot undo weigh")),
        (
            Perform(order(thing="Jar5")),
            ErrorAnswer("wash has to return a situation in Entish, a Result or None, and returned 7"),
        ),
        (
            Perform(order("weigh", None, effect="?Object isOn ?Other")),
            ErrorAnswer("weigh has to return the situation, because its effect leaves ?Object, ?Other open: ?Object isOn ?Other"),
        ),
        (Halt(order(thing=None)), ErrorAnswer("KeyError: 'Object'")),
    ],
)
def test_what_goes_wrong_at_work_is_an_answer(work: Work, answer: object, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(Exception) as error:  # whatever an author raises
        perform_work(work)
    assert answer_of(error.value) == answer
    assert [record.levelname for record in caplog.records] == (["ERROR"] if isinstance(answer, ErrorAnswer) else [])


def test_exceptions_as_answers() -> None:
    assert answer_of(InputError("no")) == ErrorAnswer("no")
    assert answer_of(ValueError("no")) == ErrorAnswer("ValueError: no")
    assert str(ServiceFailed("it broke", "A isOn B")) == "it broke"
    assert str(Refusal("no cats")) == "no cats"


def test_a_task_says_what_was_asked_and_how_far_it_is() -> None:
    reports: list[object] = []
    arranged = Order(
        participant="p",
        method="wash",
        inputs={"Object": "Jar1", "Times": "2"},
        effect="?Object isClean ?Provider",
        precondition="?Object isIn A",
    )
    task = Task("Washer1", arranged, None, reports.append)  # type: ignore[arg-type]  # nothing is asked
    assert (dict(task.inputs), task.effect) == ({"Object": "Jar1", "Times": 2.0}, parse("Jar1 isClean Washer1"))
    assert (task.order, task.precondition) == (arranged, parse("Jar1 isIn A"))
    assert Task("W", order(), None, reports.append).precondition is None  # type: ignore[arg-type]  # nothing is asked
    for fraction in (-0.5, 0.25, 1.5):
        asyncio.run(task.progress(fraction))
    asyncio.run(task.progress(0.5, parse("Jar1 isOn B"), note="half way"))
    assert reports == [
        Advance(fraction=0.0),
        Advance(fraction=0.25),
        Advance(fraction=1.0),
        Advance(fraction=0.5, situation="Jar1 isOn B", note="half way"),
    ]
