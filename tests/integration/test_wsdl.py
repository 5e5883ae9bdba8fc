"""The schemas and descriptions against real users of them: two validators, and a client of another make, compiled from what is served."""

from __future__ import annotations

import asyncio
import re
import uuid
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import xmlschema
import zeep
import zeep.exceptions
from hypothesis import given
from lxml import etree
from msgspec import Struct

from somrs.client.addresses import Addresses
from somrs.deployment.device import DeviceRunner
from somrs.kernel.component import Effect, Input, Received
from somrs.planner_service.engines import plan_in_process
from somrs.protocol.messages import frp
from somrs.protocol.messages.bodies import REQUESTS
from somrs.protocol.messages.envelope import Message
from somrs.protocol.soap import soap, wsdl
from somrs.protocol.soap.soap import ENV, WSA
from somrs.registry.component import Registry
from somrs.repository.component import Repository
from somrs.runtime.host import Host
from somrs.runtime.http import Server
from somrs.runtime.node import Report
from somrs.service_manager.sdk.device import Device, Situation, Task, service
from somrs.task_manager.manager import TaskManager
from tests.support.bodies import KINDS, messages
from tests.support.examples import examples
from tests.support.hang import HANG_TIME
from tests.support.lab import contents
from tests.support.paths import ROOT

DOCS = [ROOT / "docs" / "reference" / name for name in ("wire.md", "traffic.md")]
SCHEMAS = {
    soap.FRP: "frp",
    soap.DIRECTORY: "directory",
    soap.KNOWLEDGE: "knowledge",
    soap.CLIENTS: "clients",
    soap.ORDERS: "orders",
    soap.TRAFFIC: "traffic",
}


def schema_text(namespace: str) -> bytes:
    document = wsdl.schema(SCHEMAS[namespace])
    assert document is not None
    return document


@cache
def validators(namespace: str) -> tuple[xmlschema.XMLSchema10, etree.XMLSchema]:
    document = schema_text(namespace)
    return xmlschema.XMLSchema10(document.partition(b"?>")[2].decode()), etree.XMLSchema(etree.fromstring(document))


def body_of(document: bytes) -> etree._Element:
    """The element of the body; that of the answer in a Fault that refuses."""
    body = etree.fromstring(document, etree.XMLParser(remove_blank_text=True)).find(f"{{{ENV}}}Body")
    assert body is not None
    detail = body.find(f"{{{ENV}}}Fault/{{{ENV}}}Detail")
    return detail[0] if detail is not None else body[0]


def obeys(element: etree._Element) -> bool:
    first, second = validators(etree.QName(element).namespace or "")
    verdicts = first.is_valid(etree.tostring(element, encoding="unicode")), second.validate(element)
    assert verdicts[0] == verdicts[1], etree.tostring(element)
    return verdicts[1]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind is not frp.Fault], ids=lambda kind: kind.__name__)
def test_every_body_obeys_its_schema(kind: type[Struct]) -> None:
    @examples(6)
    @given(messages(kind))
    def valid(message: Message) -> None:
        element = body_of(soap.encode(message))
        first, second = validators(etree.QName(element).namespace or "")
        first.validate(etree.tostring(element, encoding="unicode"))
        second.assertValid(element)

    valid()


ARRANGE = (
    f'<m:Arrange xmlns:m="{soap.FRP}"><m:Transaction>t</m:Transaction><m:Participant>p</m:Participant><m:ServiceType>S</m:ServiceType>'
    '<m:Inputs><m:Entry name="a">b</m:Entry></m:Inputs><m:Effect>e</m:Effect><m:ReplyBy>1.5</m:ReplyBy></m:Arrange>'
)


@pytest.mark.parametrize(
    ("old", "new", "valid"),
    [
        ("", "", True),
        ("<m:Transaction>t</m:Transaction>", "", False),
        ("<m:Effect>e</m:Effect>", "", False),
        ("<m:Effect>e", "<m:Strange/><m:Effect>e", False),
        (">1.5<", ">soon<", False),
        (' name="a"', "", False),
        ("<m:Effect>e</m:Effect><m:ReplyBy>1.5</m:ReplyBy>", "<m:ReplyBy>1.5</m:ReplyBy><m:Effect>e</m:Effect>", False),
    ],
)
def test_the_schema_refuses_what_is_wrong(old: str, new: str, valid: bool) -> None:
    assert obeys(etree.fromstring(ARRANGE.replace(old, new, 1))) is valid


def test_there_is_no_other_schema_or_component() -> None:
    assert wsdl.schema("nothing") is None
    assert wsdl.description("/nothing", "http://x/nothing") is None


def test_every_request_is_offered_by_one_component() -> None:
    offered = [kind for _, kinds in wsdl.COMPONENTS.values() for kind in kinds if kind in REQUESTS]
    assert sorted(kind.__name__ for kind in offered) == sorted(kind.__name__ for kind in REQUESTS)


# A client of another make


class Carrier(Device):
    """Carries things at once."""

    type = "PioneerP3DX"

    @service("TransferObject", price="1 EUR", duration="1 s")
    async def transfer(self, task: Task) -> Situation:
        return None


class Foreigner:
    """An address at which the client of another make takes what is sent to it."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.inbox: asyncio.Queue[Message] = asyncio.Queue()

    def handle(self, event: Input, now: float) -> list[Effect]:
        if isinstance(event, Received):
            self.inbox.put_nowait(event.message)
        return []


def compiled(address: str) -> Any:
    """A client for the component at the address. It adds its WsAddressingPlugin by itself, because the description wants it."""
    return zeep.Client(f"{address}?wsdl", transport=zeep.Transport(timeout=HANG_TIME, operation_timeout=HANG_TIME))  # type: ignore[no-untyped-call]


def endpoint(name: str, address: str) -> etree._Element:
    header = etree.Element(f"{{{WSA}}}{name}")
    etree.SubElement(header, f"{{{WSA}}}Address").text = address
    return header


def system(work: Callable[[Addresses, str, Foreigner], None], data: Path) -> list[Message]:
    """Do the work, in a thread, beside a running Repository, Registry, Task Manager and device. What came to the foreigner."""

    async def run() -> list[Message]:
        host = Host()
        await host.start()
        repository = host.add("/repository", lambda address: Repository(address, contents()))
        registry = host.add("/registry", lambda address: Registry(address, repository=repository.address))

        async def plan(task: object, report: Report) -> object:
            return await asyncio.to_thread(plan_in_process, task)

        manager = host.add(
            "/task-manager",
            lambda address: TaskManager(address, repository=repository.address, registry=registry.address),
            carry_out=plan,
        )
        foreigner = Foreigner(f"{host.url}/foreigner")
        host.add("/foreigner", lambda address: foreigner)
        addresses = Addresses(repository=repository.address, registry=registry.address, task_manager=manager.address)
        runner = DeviceRunner(Carrier("Robot1"), addresses, data)
        try:
            device = await runner.start()
            await asyncio.to_thread(work, addresses, device, foreigner)
        finally:
            await runner.stop()
            await host.stop()
        return [foreigner.inbox.get_nowait() for _ in range(foreigner.inbox.qsize())]

    return asyncio.run(run())


def test_a_foreign_client_asks_and_changes_the_repository(tmp_path: Path) -> None:
    def work(addresses: Addresses, device: str, foreigner: Foreigner) -> None:
        repository = compiled(addresses.repository).service
        rows = repository.QueryMap(Formula="?Jar: Jar isOn Table1", Limit=10)
        assert sorted(row.Bindings.Entry[0]._value_1 for row in rows.Rows) == ["Jar1", "Jar2"]
        color = {"ValueSet": {"Object": "Jar1", "Path": "Color", "Value": {"_value_1": "Green", "kind": "text"}}}
        updated = repository.UpdateMap(Changes=[color], Situation="Jar1 isOn Table2")
        assert (updated.Version, updated.Reception) == (rows.Version + 1, None)
        seen = "?Seen: Jar isOn Table1 AND ?Seen.Color = Blue AND ?Seen.PositionX = 1.2 AND ?Seen.PositionY = 1.1 AND ?Seen.PositionZ = 0.7"
        sighted = repository.UpdateMap(Situation=seen, Observation={"AsOf": 1000.0, "Searched": ["Table1"]})
        assert [(entry.name, entry._value_1) for entry in sighted.Reception.Names.Entry] == [("Seen", "Jar2")]
        assert repository.QueryMap(Formula="Jar1 isOn Table2 AND Jar1.Color = Green").Rows != []
        with pytest.raises(zeep.exceptions.Fault, match="Table77") as refused:
            repository.UpdateMap(Situation="Jar1 isOn Table77")
        assert refused.value.detail[0].tag == f"{{{soap.KNOWLEDGE}}}Rejected"
        with pytest.raises(zeep.exceptions.Fault, match="Jar9"):
            repository.ReadHistory(Object="Jar9")
        assert repository.ReadMap().Objects[0].Name == "Building1"
        renamed = {"Renamed": [{"Section": "types", "Name": "Jar", "To": "Pot"}]}
        considered = repository.Consider(Change={"Define": renamed})
        assert [change.ObjectAdded.Object.Name for change in considered.Changes] == ["Jar1", "Jar2"]
        assert repository.Define(**renamed) == sighted.Version + 1
        with pytest.raises(zeep.exceptions.Fault, match="there is no type Jar"):
            repository.Define(Removed=[{"Section": "types", "Name": "Jar"}])
        assert repository.QueryMap(Formula="?Pot: Pot isOn Table1").Rows[0].Bindings.Entry[0]._value_1 == "Jar2"

    system(work, tmp_path)


def test_a_foreign_client_offers_and_discovers_services(tmp_path: Path) -> None:
    offer = {
        "Service": "Drone1.Look",
        "Provider": "Drone1",
        "ProviderType": "Device",
        "Address": "http://127.0.0.1:9/devices/Drone1",
        "ServiceType": {
            "Name": "Look",
            "Effect": "?Object isOn ?Place",
            "Inputs": [{"Name": "Object", "Type": "Object"}],
            "Kind": "cognitive",
        },
        "Attributes": {"Entry": [{"name": "Price", "kind": "number", "_value_1": "2.5"}]},
    }

    def work(addresses: Addresses, device: str, foreigner: Foreigner) -> None:
        registry = compiled(addresses.registry).service
        reply = registry.Discover(ServiceType="TransferObject")
        assert [(discovered_offer.Service, discovered_offer.Address) for discovered_offer in reply.Offers] == [
            ("Robot1.TransferObject", device)
        ]
        assert registry.Publish(Provider="Drone1", Offers=[offer], Lease=60).RenewWithin > 0
        (mine,) = registry.Discover(Provider="Drone1").Offers
        assert (mine.ServiceType.Kind, mine.Attributes.Entry[0].kind, mine.Attributes.Entry[0]._value_1) == ("cognitive", "number", "2.5")
        assert registry.Retract(Provider="Drone1") == ["Drone1.Look"]
        with pytest.raises(zeep.exceptions.Fault, match="nothing is registered for Drone1"):
            registry.Renew(Provider="Drone1", Lease=60)

    system(work, tmp_path)


def test_a_foreign_client_has_a_task_done(tmp_path: Path) -> None:
    def work(addresses: Addresses, device: str, foreigner: Foreigner) -> None:
        manager = compiled(addresses.task_manager).service
        with pytest.raises(zeep.exceptions.Fault, match="Jar77") as refused:
            manager.Submit(Effect="Jar77 isOn Table2")
        assert refused.value.detail[0].tag == f"{{{soap.CLIENTS}}}TaskRejected"
        task = manager.Submit(Effect="Jar1 isOn Table2", Policy="price")
        news = manager.WatchTask(Task=task, Wait=10)
        while news.View.Phase != "ended":
            news = manager.WatchTask(Task=task, After=news.Events[-1].Number if news.Events else 0, Wait=5)
        assert news.View.Outcome == "accomplished", news
        assert [listed_task.Task for listed_task in manager.ReadTasks().Tasks] == [task]
        assert compiled(addresses.repository).service.QueryMap(Formula="Jar1 isOn Table2").Rows != []

    system(work, tmp_path)


def test_a_foreign_task_manager_arranges_with_a_service(tmp_path: Path) -> None:
    transaction, participant = uuid.uuid4().urn, "Robot1.TransferObject#s1"
    session = {"Transaction": transaction, "Participant": participant, "Version": "1.0"}

    def work(addresses: Addresses, device: str, foreigner: Foreigner) -> None:
        robot = compiled(device).service
        headers = [endpoint("From", foreigner.address), endpoint("ReplyTo", foreigner.address)]
        inputs = {"Entry": [{"name": "Object", "_value_1": "Jar1"}, {"name": "Destination", "_value_1": "Table2"}]}
        effect = "Jar1 isOn Table2"
        arranged = robot.Arrange(**session, ServiceType="TransferObject", Inputs=inputs, Effect=effect, _soapheaders=headers)
        assert arranged is None
        state = "Arranging"
        while state == "Arranging":
            state = robot.Query(**session).State
        assert state == "Offered"
        robot.Cancel(**session, Reason="only asking", _soapheaders=headers)
        assert robot.Query(**session).State == "Ended"

    (terms,) = [message for message in system(work, tmp_path) if isinstance(message.body, frp.Terms)]
    assert isinstance(terms.body, frp.Terms)
    assert (terms.header.transaction, terms.header.participant) == (transaction, participant)
    assert (terms.body.effect, terms.body.price, terms.body.duration) == ("Jar1 isOn Table2", 1.0, 1.0)


def test_every_description_compiles() -> None:
    """What is served has the operations that it should have, and for each what it is answered and refused with."""

    async def ignore_message(message: Message) -> None:
        return None

    def operations(address: str, component_name: str) -> dict[str, tuple[bool, list[str]]]:
        binding = compiled(address).wsdl.bindings[f"{{{wsdl.TARGETS}:{component_name}}}{component_name}Binding"]
        return {name: (operation.output is not None, [*operation.faults]) for name, operation in binding.all().items()}

    async def run() -> None:
        server = Server("127.0.0.1", 0, {f"/{first}/Some1": ignore_message for first in wsdl.COMPONENTS})
        await server.start()
        for first, (component_name, kinds) in wsdl.COMPONENTS.items():
            answers = {kind: answers for kind, answers in REQUESTS.items() if kind in kinds}
            expected: dict[str, tuple[bool, list[str]]] = {kind.__name__: (False, []) for kind in kinds} | {
                kind.__name__: (True, [refusal.__name__ for refusal in refusals]) for kind, (_, *refusals) in answers.items()
            }
            assert await asyncio.to_thread(operations, f"{server.url}/{first}/Some1", component_name) == expected
        await server.stop()

    asyncio.run(run())


# The documentation


def documented() -> list[str]:
    return [example for page in DOCS for example in re.findall(r"```xml\n(<env:Envelope.*?)```", page.read_text(), re.DOTALL)]


def test_the_examples_are_what_is_on_the_wire() -> None:
    documents = documented()
    assert len(documents) >= 8
    for example in documents:
        message = soap.decode(example.encode())
        ours = etree.canonicalize(soap.encode(message).decode(), strip_text=True)
        assert etree.canonicalize(example, strip_text=True) == ours
        if not isinstance(message.body, frp.Fault):
            assert obeys(body_of(example.encode()))
