"""What messages are made of: their defaults and names on the wire, ids, leases, pages, people and blanks."""

from __future__ import annotations

import math
import uuid

import msgspec
import pytest
from msgspec import Struct, structs

from somrs.errors import UsageError
from somrs.ontology.services import Handler, Occasion, ServiceType
from somrs.ontology.types import AttributeType, FunctionType, Kind, ObjectType, RelationType
from somrs.protocol.messages import directory, events, frp, knowledge, orders, previews, records, submission, task_news, task_views, waits
from somrs.protocol.messages.bodies import Body
from somrs.protocol.messages.envelope import ANONYMOUS, Header, Message, message_id, normalised_id, reply
from somrs.protocol.messages.events import Event
from somrs.protocol.messages.knowledge import Definitions, by_kind
from somrs.protocol.messages.leases import LONGEST, SHORTEST, grant_lease
from somrs.protocol.messages.orders import Blank, Run, RunState, Template, blanks_to_variables, fill_blanks, fill_formula
from somrs.protocol.messages.paging import PAGE_ITEMS, fit_page, pages, size
from somrs.protocol.messages.people import client_address, person_name
from somrs.protocol.messages.submission import Submit

MODULES = (directory, events, frp, knowledge, orders, previews, records, submission, task_news, task_views, waits)


# Defaults and names


def structs_of(module: object) -> list[type[Struct]]:
    return [
        kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Struct) and kind.__module__ in str(module)
    ]


def test_what_is_left_out_of_a_message_is_false_or_empty_but_for_these() -> None:
    defaults = {
        f"{kind.__name__}.{field.name}": field.default
        for module in MODULES
        for kind in structs_of(module)
        for field in structs.fields(kind)
        if field.default is True or (isinstance(field.default, str) and field.default)
    }
    assert defaults == {
        "CancelTask.reason": "cancelled by the client",
        "ContractView.currency": "EUR",
        "StepView.currency": "EUR",
        "WorkView.currency": "EUR",
        "Quotation.currency": "EUR",
        "Previewed.currency": "EUR",
        "Terms.currency": "EUR",
        "BrokenRule.section": "objects",
        "Blank.type": "Object",
        "Failed.tried": True,
        "Stopped.tried": True,
        "Stranded.tried": True,
        "StandingOrder.enabled": True,
        "StandingOrder.skip": True,
        "OrderSaved.enabled": True,
        "OrderSaved.skip": True,
        **dict.fromkeys(("Submit.waits", "TaskView.waits", "TaskRecord.waits"), True),
        **dict.fromkeys(("Submit.policy", "Preview.policy", "TaskView.policy", "TaskRecord.policy"), "price"),
        **dict.fromkeys(("WorkView.goal",), "task"),
        **dict.fromkeys(("TaskEvent.kind",), "news"),
        **dict.fromkeys(("StepView.state",), "New"),
        **dict.fromkeys(("StepView.kind",), "physical"),
    }


def test_alternatives_are_told_apart_by_their_names() -> None:
    for union in (Body, Event, orders.Schedule):
        assert all(kind.__struct_config__.tag == kind.__name__ for kind in union.__args__)  # type: ignore[union-attr]
        msgspec.json.Decoder(union)
    assert records.TaskRecord.__struct_config__.tag == "TaskRecord"


def test_names_that_others_know() -> None:
    assert (directory.CAPACITY_ATTRIBUTE, ANONYMOUS) == ("AtOnce", "http://www.w3.org/2005/08/addressing/anonymous")
    assert records.PARTS == ("steps", "work", "contracts", "events", "messages")
    header = Header(sender="a", recipient="b", message_id="c")
    assert (header.version, header.reply_to, header.relates_to, header.transaction, header.participant) == (
        "1.0",
        ANONYMOUS,
        None,
        None,
        None,
    )


# Ids


@pytest.mark.parametrize("parts", [(), ("a",), ("a", 1, None, 2.5), ("ł", "日"), *((n,) for n in range(12))])
def test_the_id_of_a_message_is_the_uuid_of_its_parts(parts: tuple[object, ...]) -> None:
    space = uuid.UUID("6f1c9f0e-5a58-5b5e-9a36-50e4c0a0f5f1")
    assert message_id(*parts) == f"urn:uuid:{uuid.uuid5(space, '/'.join(map(str, parts)))}"


@pytest.mark.parametrize(
    ("text", "normalised"),
    [
        ("uuid:AB", "urn:uuid:ab"),
        (" URN:UUID:aB\n", "urn:uuid:ab"),
        ("urn:uuid:uuid:a", "urn:uuid:uuid:a"),
        (" Other:AB ", "Other:AB"),
        ("xuuid:AB", "xuuid:AB"),
    ],
)
def test_an_id_is_one_in_either_spelling(text: str, normalised: str) -> None:
    assert normalised_id(text) == normalised


def test_an_answer_goes_where_it_is_wanted_and_says_what_it_answers() -> None:
    request_header = Header(sender="a", recipient="b", message_id="m", relates_to="l", reply_to="c", transaction="t", participant="p")
    body = frp.Status(state=frp.State.NEW)
    answer = Header(
        sender="me",
        recipient="c",
        message_id=message_id("m", "reply", "Status"),
        relates_to="m",
        reply_to="me",
        transaction="t",
        participant="p",
    )
    assert reply(Message(header=request_header, body=frp.Query()), body, "me") == Message(header=answer, body=body)


# Leases and pages


@pytest.mark.parametrize(
    ("requested", "lease"), [(0.001, SHORTEST), (SHORTEST, SHORTEST), (1.5, 1.5), (LONGEST, LONGEST), (LONGEST + 1, LONGEST)]
)
def test_a_lease_is_as_long_as_was_asked_within_limits(requested: float, lease: float) -> None:
    assert grant_lease(requested) == lease


@pytest.mark.parametrize("requested", [0.0, -1.0, math.inf, math.nan])
def test_what_is_no_duration_is_no_lease(requested: float) -> None:
    with pytest.raises(UsageError, match=r"^a lease of \S+ s is not valid: request 1 to 3600 seconds$"):
        grant_lease(requested)


def test_the_size_of_a_value_is_that_of_its_json() -> None:
    assert [size(value) for value in ("ab", "ł", [1, 2], None)] == [4, 4, 5, 4]


@pytest.mark.parametrize(
    ("items", "limit", "max_bytes", "page"),
    [
        (["aa", "bb", "cc"], 9, 8, ["aa", "bb"]),
        (["aa", "bb", "cc"], 9, 7, ["aa"]),
        (["aa", "bb", "cc"], 9, 12, ["aa", "bb", "cc"]),
        (["aa", "bb", "cc"], 2, 99, ["aa", "bb"]),
        (["aa", "bb", "cc"], 0, 99, []),
        (["aaaa", "b"], 9, 1, ["aaaa"]),
        (["aaaa", ""], 9, 5, ["aaaa"]),
    ],
)
def test_a_page_has_what_fits_and_the_first_in_any_case(items: list[str], limit: int, max_bytes: int, page: list[str]) -> None:
    assert [*fit_page(items, limit, max_bytes)] == page


def test_a_page_has_so_many_items_and_bytes_if_nothing_else_is_said() -> None:
    assert len([*fit_page([0] * 300)]) == PAGE_ITEMS
    assert len([*fit_page(["a" * 9998] * 5)]) == 4


@pytest.mark.parametrize(
    ("items", "max_bytes", "expected_pages"),
    [
        ([], 8, []),
        (["aa", "bb", "cc"], 8, [["aa", "bb"], ["cc"]]),
        (["aa", "bb", "cc"], 7, [["aa"], ["bb"], ["cc"]]),
        (["aa", "bb", "cc"], 12, [["aa", "bb", "cc"]]),
        (["aaaa", "b", "c"], 5, [["aaaa"], ["b"], ["c"]]),
        (["b", "aaaa"], 1, [["b"], ["aaaa"]]),
    ],
)
def test_pages_have_all_items_and_each_as_many_as_fit(items: list[str], max_bytes: int, expected_pages: list[list[str]]) -> None:
    assert [*pages(items, max_bytes)] == expected_pages


# People


@pytest.mark.parametrize(
    ("recorded", "name"),
    [
        ("Anna", "Anna"),
        ("urn:so-mrs:client:Anna%20B@home", "Anna B@home"),
        ("urn:so-mrs:client:urn%3Aso-mrs%3Aclient%3AAnna", "Anna"),
        ("urn:so-mrs:client:http%3A//h%3A7000/x", "x"),
        ("http://h:7000/task-manager", "task-manager"),
        ("https://h/devices/Robot1/", "Robot1"),
        ("http://h/Robot%201", "Robot 1"),
        ("http://h:7000", "7000"),
        ("urn:a:b", "b"),
        ("mailto:a/b", "mailto:a/b"),
        ("", "somebody"),
        ("http://h//", "h"),
        ("urn:so-mrs:client:", "somebody"),
    ],
)
def test_who_it_was_without_what_addresses_have_around_a_name(recorded: str, name: str) -> None:
    assert person_name(recorded) == name


def test_one_who_asks_and_has_no_address_has_a_name_all_the_same() -> None:
    assert client_address("Anna B@home/x") == "urn:so-mrs:client:Anna%20B@home%2Fx"
    assert person_name(client_address("Anna B@home")) == "Anna B@home"


# Definitions


def test_definitions_are_sorted_by_what_they_define() -> None:
    attribute, relation = AttributeType(name="A", kind=Kind.TEXT), RelationType(name="isOn", joins=("Thing", "Thing"))
    function, service = FunctionType(name="f", parameters=("Thing",)), ServiceType(name="S", effect="?A isOn ?B")
    kind = ObjectType(name="Thing", parent=None)
    definitions = by_kind(iter((service, kind, function, relation, attribute)))
    assert definitions == Definitions(
        attributes=(attribute,), relations=(relation,), functions=(function,), types=(kind,), services=(service,)
    )
    assert [*definitions.all_definitions()] == [attribute, relation, function, kind, service]


# Orders


@pytest.mark.parametrize(
    ("formula", "text"),
    [("{A} isOn { B }", "Jar1 isOn Table 2"), ("{C} isOn {A}{A}", "{C} isOn Jar1Jar1"), ("{} {{A}}", "{} {Jar1}"), ("A", "A")],
)
def test_what_is_written_in_the_blanks_of_a_formula(formula: str, text: str) -> None:
    assert fill_formula(formula, {"A": "Jar1", "B": "Table 2"}) == text


def test_blanks_are_filled_in_all_formulas_of_a_task() -> None:
    def handlers(thing: str) -> tuple[Handler, ...]:
        conditional = Handler(on=Occasion.FAILURE, effect=f"{thing} isOn B", when=f"{thing}.Broken = TRUE")
        return conditional, Handler(on=Occasion.FAILURE, effect=f"{thing} isIn B")

    task = Submit(effect="{A} isOn {B}", precondition="{A} isIn C", handlers=handlers("{A}"), priority=3)
    filled = Submit(effect="Jar1 isOn {B}", precondition="Jar1 isIn C", handlers=handlers("Jar1"), priority=3)
    assert fill_blanks(task, {"A": "Jar1"}) == filled
    assert fill_blanks(Submit(effect="{A}"), {"A": "x"}) == Submit(effect="x")
    template = Template(name="t", task=Submit(effect="{A} isOn {B} {C}"), blanks=(Blank(name="A"), Blank(name="B")))
    assert blanks_to_variables(template) == Submit(effect="?A isOn ?B {C}")


@pytest.mark.parametrize(
    ("state", "ended_at", "is_open"),
    [
        (RunState.SUBMITTING, None, True),
        (RunState.SUBMITTED, None, True),
        (RunState.SUBMITTED, 0.0, False),
        (RunState.SKIPPED, None, False),
        (RunState.MISSED, None, False),
        (RunState.REFUSED, None, False),
    ],
)
def test_a_run_is_open_until_its_task_is_over(state: RunState, ended_at: float | None, is_open: bool) -> None:
    assert Run(due=0.0, state=state, at=0.0, ended_at=ended_at).open is is_open
