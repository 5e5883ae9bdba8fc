"""Editing the ontology and the map through the desk: the operations of the windows, and the same over HTTP."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path

import httpx
import pytest
from msgspec import structs

from somrs.api.affected import WordUserKind
from somrs.api.ontology import ImportOntology
from somrs.api.remote import LiveApi
from somrs.cli.editing import alter
from somrs.client.client import Client, Refused, client_name
from somrs.client.refusals import error_report
from somrs.errors import InputError, ModelError
from somrs.ontology.files.loading import load, load_text, upper
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import Map, ObjectRemoved, ValueSet
from somrs.ontology.types import ObjectType, RelationType
from somrs.ports import Reservation
from somrs.protocol.messages.clients import Submit
from somrs.protocol.messages.knowledge import Define, Definitions, RenameObject, UpdateMap
from somrs.protocol.messages.orders import Blank, Daily, OrderSaved, TemplateSaved
from somrs.protocol.messages.people import person_name
from tests.support.small_system import Porter, SmallSystem, running

VAT = ObjectType(name="Vat", parent="Support", attributes=("Label",))


def desk(tmp_path: Path, use: Callable[[LiveApi], Awaitable[None]], *porters: Porter) -> None:
    async def run() -> None:
        async with running(tmp_path / "data", *porters) as (_, desk):
            await use(desk)

    asyncio.run(run())


async def known(desk: LiveApi, version: int) -> None:
    """Wait until the desk heard of the version."""
    async with asyncio.timeout(120):
        while desk.context.version < version:
            await asyncio.sleep(0.01)


def test_a_type_is_made_considered_renamed_and_undone(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        made = await desk.ontology.change(Define(definitions=Definitions(types=(VAT,)), author="Anna"))
        await known(desk, made.version)
        seen = await desk.ontology.read()
        assert "Vat" in [type.name for type in seen.definitions.types]
        assert DefinitionKey(section=Section.TYPES, name="Device") in seen.required_words
        assert DefinitionKey(section=Section.TYPES, name="Vat") not in seen.required_words
        rename = Define(renamed=(Renaming(section=Section.TYPES, name="Vat", to="Tub"),), author="Ben")
        consequences = await desk.ontology.consider(rename)
        assert (consequences.broken, consequences.version) == ((), made.version)
        assert consequences.revision is not None
        assert [type.name for type in consequences.revision.after.types] == ["Tub"]
        renamed = await desk.ontology.change(rename)
        found = await desk.ontology.history()
        assert [(event.version, event.author) for event in found.events] == [(2, "Ben"), (1, "Anna")]
        undone = await desk.ontology.undo(renamed.version, author="Cleo")
        await known(desk, undone.version)
        assert desk.context.ontology.types["Vat"] == VAT
        assert [type.name for type in (await desk.ontology.read(renamed.version)).definitions.types][-1] == "Tub"
        assert (await desk.ontology.consider_undo(made.version)).broken == ()

    desk(tmp_path, use)


def test_consequences_name_the_services_on_offer_that_could_not_be_planned_with(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        async with asyncio.timeout(120):
            while not (await desk.fleet.services()).offers:
                await asyncio.sleep(0.05)
        is_on = desk.context.ontology.relations["isOn"]
        narrow = Definitions(relations=(structs.replace(is_on, joins=("Device", "Object")),))
        consequences = await desk.ontology.consider(Define(definitions=narrow))
        assert [offer.service for offer in consequences.offers] == ["Robot1.TransferObject"]
        assert "a Device is meant" in consequences.offers[0].problem
        harmless = await desk.ontology.consider(Define(definitions=Definitions(types=(VAT,))))
        assert harmless.offers == ()

    desk(tmp_path, use, Porter("Robot1"))


def test_consequences_name_the_tasks_orders_and_templates_whose_words_would_be_gone(tmp_path: Path) -> None:
    bring = TemplateSaved(
        task=Submit(effect="{Thing} isOn {Where}"), blanks=(Blank(name="Thing", type="Jar"), Blank(name="Where", type="Platform"))
    )
    daily = Daily(at="08:00")

    async def use(desk: LiveApi) -> None:
        task = (await desk.tasks.submit(Submit(effect="Jar002 isOn ?Place: Platform"))).task
        await desk.tasks.submit(Submit(effect="Tin001 isOn Cupboard002"))
        await desk.orders.save_template("Bring", bring)
        await desk.orders.save_template("Tidy", TemplateSaved(task=Submit(effect="Jar001 isOn Cupboard001")))
        values = {"Thing": "Jar001", "Where": "Platform001"}
        filled = await desk.orders.add_order(OrderSaved(name="Morning", when=daily, template="Bring", values=values))
        whole = await desk.orders.add_order(OrderSaved(name="Evening", when=daily, task=Submit(effect="Jar001 isOn ?P: Platform")))
        await desk.orders.add_order(OrderSaved(name="Night", when=daily, template="Tidy"))
        platform = DefinitionKey(section=Section.TYPES, name="Platform")
        rename = Define(renamed=(Renaming(section=Section.TYPES, name="Platform", to="Stand"),))
        found = (await desk.ontology.consider(rename)).affected
        users = {
            (WordUserKind.TASK, task),
            (WordUserKind.ORDER, filled.id),
            (WordUserKind.ORDER, whole.id),
            (WordUserKind.TEMPLATE, "Bring"),
        }
        assert {(one.user_kind, one.id) for one in found} == users
        assert {(one.word, one.new_name) for one in found} == {(platform, "Stand")}
        removal = (await desk.ontology.consider(Define(removed=(platform,)))).affected
        assert {(one.user_kind, one.id, one.new_name) for one in removal} == {(*user, "") for user in users}
        done = await desk.ontology.change(rename)
        await known(desk, done.version)
        with pytest.raises(InputError, match="Platform"):
            await desk.orders.save_order(whole.id, OrderSaved(name="Evening", when=daily, task=whole.task))
        renewed = Submit(effect="Jar001 isOn ?P: Stand")
        await desk.orders.save_order(whole.id, OrderSaved(name="Evening", when=daily, task=renewed))
        back = (await desk.ontology.consider_undo(done.version)).affected
        assert [(one.name, str(one.word), one.new_name) for one in back] == [("Evening", "type Stand", "Platform")]
        assert (await desk.ontology.consider(Define(definitions=Definitions(types=(VAT,))))).affected == ()

    desk(tmp_path, use, Porter("Robot1", seconds=60), Porter("Robot2", seconds=60))


def test_a_dry_run_on_the_command_line_names_them_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def use(system: SmallSystem, desk: LiveApi) -> None:
        await desk.orders.save_template("Bring", TemplateSaved(task=Submit(effect="Jar001 isOn ?P: Platform")))
        structs.replace(system.addresses, api=desk.client.url).write(system.data)
        change = Define(renamed=(Renaming(section=Section.TYPES, name="Platform", to="Stand"),))
        assert await alter(change, system.data, dry=True, json=False) == 0
        told = capsys.readouterr().out
        assert "template Bring: it uses type Platform, which would be called Stand" in told
        assert "tasks, orders and templates keep the words that they have" in told
        with Reservation("127.0.0.1", 1) as nobody:
            structs.replace(system.addresses, api=f"http://127.0.0.1:{nobody.ports[0]}/api").write(system.data)
            assert await alter(change, system.data, dry=True, json=False) == 0
        assert "without the tasks, orders and templates" in capsys.readouterr().err

    async def run() -> None:
        async with running(tmp_path / "data") as (system, desk):
            await use(system, desk)

    asyncio.run(run())


def test_what_is_refused_says_each_problem_where_it_is(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        with pytest.raises(Refused) as refused:
            await desk.ontology.change(Define(removed=(DefinitionKey(section=Section.TYPES, name="Jar"),)))
        told = error_report(refused.value)
        assert {(rule.section, rule.subject) for rule in told.broken} >= {("objects", "Jar001"), ("objects", "Jar002")}
        assert "Jar001" in told.problem
        with pytest.raises(Refused) as refused:
            await desk.map.change(UpdateMap(changes=(ValueSet("Jar001", "Weight", 99.0),)))
        assert [(rule.subject, rule.path) for rule in refused.value.broken] == [("Jar001", "Weight")]

    desk(tmp_path, use)


def test_who_gave_no_name_is_told_short_and_recorded_whole(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        made = await desk.ontology.change(Define(definitions=Definitions(types=(VAT,))))
        (event,) = (await desk.ontology.history()).events
        assert event.author == client_name()
        await known(desk, made.version)
        late = Define(removed=(DefinitionKey(section=Section.TYPES, name="Vat"),), author="Ben", expected_version=0)
        with pytest.raises(Refused) as refused:
            await desk.ontology.change(late)
        told = error_report(refused.value).problem
        assert f"{person_name(client_name())} changed it in version 1" in told
        assert "urn:" not in told

    desk(tmp_path, use)


FILE = """
without: [types Cup]
attributes:
  Content: {kind: text}
types:
  Vat: {parent: Support, attributes: [Content]}
  Can: {parent: Graspable, defaults: {Shape: {Form: Cylinder, Radius: 0.05, Height: 0.2}}}
"""


def test_a_file_is_taken_over_and_its_consequences_shown_before(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        dry = await desk.ontology.import_yaml(ImportOntology(text=FILE), dry=True)
        assert dry.version is None
        assert dry.consequences.revision is not None
        assert [type.name for type in dry.consequences.revision.before.types] == ["Can", "Cup"]
        assert [type.name for type in dry.consequences.revision.after.types] == ["Can", "Vat"]
        assert desk.context.version == 0
        done = await desk.ontology.import_yaml(ImportOntology(text=FILE, author="Anna"))
        assert done.version == 1
        await known(desk, 1)
        assert "Cup" not in desk.context.ontology.types
        assert desk.context.ontology.types["Can"].defaults["Shape.Height"] == 0.2
        assert (await desk.ontology.history()).events[0].author == "Anna"

    desk(tmp_path, use)


def test_mistakes_in_a_file_have_their_lines(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        text = "types:\n  Vat: {parent: Suport}\n  Tub: {parent: Vat, colour: 3}\nwithout: [types Device]\n"
        with pytest.raises(ModelError) as wrong:
            await desk.ontology.import_yaml(ImportOntology(text=text, file="vats.yaml"))
        mistakes = {(one.file, one.line, one.subject) for one in error_report(wrong.value).mistakes}
        assert mistakes >= {("vats.yaml", 2, "Vat"), ("vats.yaml", 3, "Tub"), ("vats.yaml", 4, "Device")}

    desk(tmp_path, use)


def test_what_is_exported_is_read_back(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        near = RelationType(name="isNear", joins=("Object", "Object"), symmetric=True)
        await desk.ontology.change(
            Define(
                definitions=Definitions(types=(VAT, structs.replace(upper().types["Jar"], doc="Ours")), relations=(near,)),
                removed=(DefinitionKey(section=Section.TYPES, name="Cup"),),
                renamed=(Renaming(section=Section.TYPES, name="Bottle", to="Flask"),),
            )
        )
        await known(desk, 1)
        ontology = desk.context.ontology
        for whole in (False, True):
            document = await desk.ontology.export_yaml(whole=whole)
            read = load_text(document.content.decode()).ontology
            assert {type(one): one for one in read} == {type(one): one for one in ontology} or set(map(str, read)) == set(
                map(str, ontology)
            )
        site = tmp_path / "site.yaml"
        site.write_bytes((await desk.map.export()).content)
        again = load([site])
        assert set(map(str, again.ontology)) == set(map(str, ontology))
        assert again.map == desk.context.map

    desk(tmp_path, use)


def test_the_map_is_changed_renamed_undone_and_looked_back_on(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        first = await desk.map.read()
        considered = await desk.map.consider(UpdateMap(changes=(ValueSet("Jar001", "Weight", 99.0),)))
        assert [(rule.subject, rule.path) for rule in considered.broken] == [("Jar001", "Weight")]
        await desk.map.change(UpdateMap(situation="Jar001 isOn Platform001", author="Anna"))
        renamed = await desk.map.rename(RenameObject(name="Jar001", to="Krug", author="Ben"))
        await known(desk, renamed.version)
        assert "Krug" in desk.context.map.objects
        before = await desk.map.read(version=0)
        assert before.version == 0
        assert Map(before.objects, before.facts) == Map(first.objects, first.facts)
        assert [event.version for event in (await desk.map.history("Krug")).events] == [2, 1]
        events = await desk.map.events(limit=1)
        assert (events.events[0].author, events.more) == ("Ben", True)
        assert [event.all_changes for event in (await desk.map.events(brief=True)).events][-1] == 2
        with pytest.raises(Refused, match="Jar001 changed in version 2: undo that first"):
            await desk.map.undo(1)
        await desk.map.undo(2)
        undone = await desk.map.undo(1)
        await known(desk, undone.version)
        now = await desk.map.read()
        assert Map(now.objects, now.facts) == Map(first.objects, first.facts)

    desk(tmp_path, use)


def test_the_map_of_the_past_is_the_same_however_it_is_found(tmp_path: Path) -> None:
    async def use(system: SmallSystem, desk: LiveApi) -> None:
        await desk.map.change(UpdateMap(situation="Jar001 isOn Platform001"))
        await desk.ontology.change(Define(renamed=(Renaming(section=Section.TYPES, name="Jar", to="Pot"),)))
        await desk.map.rename(RenameObject(name="Platform001", to="Stage001"))
        await desk.map.change(UpdateMap(changes=(ObjectRemoved("Tin001"), ValueSet("Jar001", "Weight", 0.5))))
        last = await desk.map.undo(3)
        await known(desk, last.version)
        async with Client(system.addresses) as client:
            for version in range(last.version + 1):
                seen = await desk.map.read(version=version)
                assert seen.version == version
                assert Map(seen.objects, seen.facts) == await client.map(version)

    async def run() -> None:
        async with running(tmp_path / "data") as (system, desk):
            await use(system, desk)

    asyncio.run(run())


def test_many_events_come_from_as_many_pages_as_it_takes(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        for number in range(450):
            await desk.map.change(UpdateMap(changes=(ValueSet("Jar001", "Weight", 1 + number / 1000),), author=f"Robot{number % 3}"))
        events = await desk.map.events(limit=400)
        assert [event.version for event in events.events] == list(range(450, 50, -1))
        assert events.more
        later = await desk.map.events(after=10, limit=430)
        assert [event.version for event in later.events] == list(range(11, 441))
        assert [event.version for event in (await desk.map.events(before=3)).events] == [2, 1]

    desk(tmp_path, use)


def test_all_of_it_is_done_over_http_too(tmp_path: Path) -> None:
    async def use(desk: LiveApi) -> None:
        async with httpx.AsyncClient(base_url=desk.client.url) as client:
            await over_http(client)

    async def over_http(client: httpx.AsyncClient) -> None:
        body = {"renamed": [{"section": "types", "name": "Bottle", "to": "Flask"}], "author": "Anna"}
        consequences = (await client.post("/ontology/consider", json=body)).json()
        assert consequences["revision"]["after"]["types"][0]["name"] == "Flask"
        wrong = await client.post("/ontology/changes", json={"removed": [{"section": "types", "name": "Jar"}]})
        assert wrong.status_code == 409
        assert wrong.json()["broken"][0]["section"] == "objects"
        mistaken = await client.post("/ontology/import.yaml", json={"text": "types:\n  A: {parent: B}\n"})
        assert (mistaken.status_code, mistaken.json()["mistakes"][0]["line"]) == (400, 2)
        assert (await client.get("/map", params={"version": 99})).status_code == 409
        assert (await client.get("/ontology/export.yaml", params={"whole": True})).text.startswith("ontology:")
        described = (await client.get("/openapi.json")).json()
        assert {"/ontology/undo/{version}", "/map/events", "/map/renames"} <= described["paths"].keys()
        assert "Named" in json.dumps(described)
        assert (await client.get("/map/events")).json()["events"] == []

    desk(tmp_path, use)
