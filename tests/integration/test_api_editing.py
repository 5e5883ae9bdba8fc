"""Editing the ontology and the map through the API: the operations of the windows, and the same over HTTP."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path

import httpx
import pytest
from msgspec import structs

from somrs.api.definition_uses import DefinitionUserKind
from somrs.api.ontology import ImportOntology
from somrs.api.remote import LiveApi
from somrs.cli.edit_commands import alter
from somrs.client.client import Client, Refused, client_name
from somrs.client.refusals import error_report
from somrs.errors import InputError, ModelError
from somrs.ontology.files.loading import load, load_text, upper
from somrs.ontology.map import Map
from somrs.ontology.naming import DefinitionKey, Renaming, Section
from somrs.ontology.objects import ObjectRemoved, ValueSet
from somrs.ontology.types import ObjectType, RelationType
from somrs.ports import Reservation
from somrs.protocol.messages.knowledge import Define, Definitions, MergeObject, RenameObject, UpdateMap
from somrs.protocol.messages.observations import Discovery, Observation
from somrs.protocol.messages.orders import Blank, Daily, OrderSaved, TemplateSaved
from somrs.protocol.messages.people import person_name
from somrs.protocol.messages.submission import Submit
from tests.support.hang import HANG_TIME
from tests.support.small_system import Porter, SmallSystem, running

VAT = ObjectType(name="Vat", parent="Support", attributes=("Label",))


def run_with_api(tmp_path: Path, use: Callable[[LiveApi], Awaitable[None]], *porters: Porter) -> None:
    async def run() -> None:
        async with running(tmp_path / "data", *porters) as (_, api):
            await use(api)

    asyncio.run(run())


async def wait_for_version(api: LiveApi, version: int) -> None:
    """Wait until the API has heard of the version."""
    async with asyncio.timeout(HANG_TIME):
        while api.context.version < version:
            await asyncio.sleep(0.01)


def test_a_type_is_made_considered_renamed_and_undone(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        creation = await api.ontology.change(Define(definitions=Definitions(types=(VAT,)), author="Anna"))
        await wait_for_version(api, creation.version)
        ontology_state = await api.ontology.read()
        assert "Vat" in [type.name for type in ontology_state.definitions.types]
        assert DefinitionKey(section=Section.TYPES, name="Device") in ontology_state.required_definition_keys
        assert DefinitionKey(section=Section.TYPES, name="Vat") not in ontology_state.required_definition_keys
        rename = Define(renamed=(Renaming(section=Section.TYPES, name="Vat", to="Tub"),), author="Ben")
        consequences = await api.ontology.consider(rename)
        assert (consequences.broken, consequences.version) == ((), creation.version)
        assert consequences.revision is not None
        assert [type.name for type in consequences.revision.after.types] == ["Tub"]
        renamed = await api.ontology.change(rename)
        history = await api.ontology.history()
        assert [(event.version, event.author) for event in history.events] == [(2, "Ben"), (1, "Anna")]
        undone = await api.ontology.undo(renamed.version, author="Cleo")
        await wait_for_version(api, undone.version)
        assert api.context.ontology.types["Vat"] == VAT
        assert [type.name for type in (await api.ontology.read(renamed.version)).definitions.types][-1] == "Tub"
        assert (await api.ontology.consider_undo(creation.version)).broken == ()

    run_with_api(tmp_path, use)


def test_consequences_name_the_services_on_offer_that_could_not_be_planned_with(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        async with asyncio.timeout(HANG_TIME):
            while not (await api.fleet.services()).offers:
                await asyncio.sleep(0.05)
        support_relation = api.context.ontology.relations["isOn"]
        narrow = Definitions(relations=(structs.replace(support_relation, joins=("Device", "Object")),))
        consequences = await api.ontology.consider(Define(definitions=narrow))
        assert [offer.service for offer in consequences.offers] == ["Robot1.TransferObject"]
        assert "a Device is meant" in consequences.offers[0].problem
        harmless = await api.ontology.consider(Define(definitions=Definitions(types=(VAT,))))
        assert harmless.offers == ()

    run_with_api(tmp_path, use, Porter("Robot1"))


def test_consequences_name_the_tasks_orders_and_templates_whose_words_would_be_gone(tmp_path: Path) -> None:
    bring_template = TemplateSaved(
        task=Submit(effect="{Thing} isOn {Where}"), blanks=(Blank(name="Thing", type="Jar"), Blank(name="Where", type="Platform"))
    )
    daily = Daily(at="08:00")

    async def use(api: LiveApi) -> None:
        task = (await api.tasks.submit(Submit(effect="Jar002 isOn ?Place: Platform"))).task
        await api.tasks.submit(Submit(effect="Tin001 isOn Cupboard002"))
        await api.orders.save_template("Bring", bring_template)
        await api.orders.save_template("Tidy", TemplateSaved(task=Submit(effect="Jar001 isOn Cupboard001")))
        values = {"Thing": "Jar001", "Where": "Platform001"}
        filled = await api.orders.add_order(OrderSaved(name="Morning", when=daily, template="Bring", values=values))
        whole = await api.orders.add_order(OrderSaved(name="Evening", when=daily, task=Submit(effect="Jar001 isOn ?P: Platform")))
        await api.orders.add_order(OrderSaved(name="Night", when=daily, template="Tidy"))
        platform = DefinitionKey(section=Section.TYPES, name="Platform")
        rename = Define(renamed=(Renaming(section=Section.TYPES, name="Platform", to="Stand"),))
        affected = (await api.ontology.consider(rename)).affected
        users = {
            (DefinitionUserKind.TASK, task),
            (DefinitionUserKind.ORDER, filled.id),
            (DefinitionUserKind.ORDER, whole.id),
            (DefinitionUserKind.TEMPLATE, "Bring"),
        }
        assert {(entry.user_kind, entry.id) for entry in affected} == users
        assert {(entry.definition, entry.new_name) for entry in affected} == {(platform, "Stand")}
        removal = (await api.ontology.consider(Define(removed=(platform,)))).affected
        assert {(entry.user_kind, entry.id, entry.new_name) for entry in removal} == {(*user, "") for user in users}
        result = await api.ontology.change(rename)
        await wait_for_version(api, result.version)
        with pytest.raises(InputError, match="Platform"):
            await api.orders.save_order(whole.id, OrderSaved(name="Evening", when=daily, task=whole.task))
        renewed = Submit(effect="Jar001 isOn ?P: Stand")
        await api.orders.save_order(whole.id, OrderSaved(name="Evening", when=daily, task=renewed))
        affected_by_undo = (await api.ontology.consider_undo(result.version)).affected
        assert [(entry.name, str(entry.definition), entry.new_name) for entry in affected_by_undo] == [
            ("Evening", "type Stand", "Platform")
        ]
        assert (await api.ontology.consider(Define(definitions=Definitions(types=(VAT,))))).affected == ()

    run_with_api(tmp_path, use, Porter("Robot1", seconds=60), Porter("Robot2", seconds=60))


def test_a_dry_run_on_the_command_line_names_them_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def use(system: SmallSystem, api: LiveApi) -> None:
        await api.orders.save_template("Bring", TemplateSaved(task=Submit(effect="Jar001 isOn ?P: Platform")))
        structs.replace(system.addresses, api=api.client.url).write(system.data)
        change = Define(renamed=(Renaming(section=Section.TYPES, name="Platform", to="Stand"),))
        assert await alter(change, system.data, dry=True, json=False) == 0
        output = capsys.readouterr().out
        assert "template Bring: it uses type Platform, which would be called Stand" in output
        assert "tasks, orders and templates are not changed" in output
        with Reservation("127.0.0.1", 1) as reservation:
            structs.replace(system.addresses, api=f"http://127.0.0.1:{reservation.ports[0]}/api").write(system.data)
            assert await alter(change, system.data, dry=True, json=False) == 0
        assert "affected tasks, orders and templates are not shown" in capsys.readouterr().err

    async def run() -> None:
        async with running(tmp_path / "data") as (system, api):
            await use(system, api)

    asyncio.run(run())


def test_what_is_refused_says_each_problem_where_it_is(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        with pytest.raises(Refused) as refused:
            await api.ontology.change(Define(removed=(DefinitionKey(section=Section.TYPES, name="Jar"),)))
        refusal = error_report(refused.value)
        assert {(rule.section, rule.subject) for rule in refusal.broken} >= {("objects", "Jar001"), ("objects", "Jar002")}
        assert "Jar001" in refusal.problem
        with pytest.raises(Refused) as refused:
            await api.map.change(UpdateMap(changes=(ValueSet("Jar001", "Weight", 99.0),)))
        assert [(rule.subject, rule.path) for rule in refused.value.broken] == [("Jar001", "Weight")]

    run_with_api(tmp_path, use)


def test_who_gave_no_name_is_told_short_and_recorded_whole(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        creation = await api.ontology.change(Define(definitions=Definitions(types=(VAT,))))
        (event,) = (await api.ontology.history()).events
        assert event.author == client_name()
        await wait_for_version(api, creation.version)
        late = Define(removed=(DefinitionKey(section=Section.TYPES, name="Vat"),), author="Ben", expected_version=0)
        with pytest.raises(Refused) as refused:
            await api.ontology.change(late)
        problem = error_report(refused.value).problem
        assert f"{person_name(client_name())} changed it in version 1" in problem
        assert "urn:" not in problem

    run_with_api(tmp_path, use)


FILE = """
without: [types Cup]
attributes:
  Content: {kind: text}
types:
  Vat: {parent: Support, attributes: [Content]}
  Can: {parent: Graspable, defaults: {Shape: {Form: Cylinder, Radius: 0.05, Height: 0.2}}}
"""


def test_a_file_is_taken_over_and_its_consequences_shown_before(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        dry = await api.ontology.import_yaml(ImportOntology(text=FILE), dry=True)
        assert dry.version is None
        assert dry.consequences.revision is not None
        assert [type.name for type in dry.consequences.revision.before.types] == ["Can", "Cup"]
        assert [type.name for type in dry.consequences.revision.after.types] == ["Can", "Vat"]
        assert api.context.version == 0
        result = await api.ontology.import_yaml(ImportOntology(text=FILE, author="Anna"))
        assert result.version == 1
        await wait_for_version(api, 1)
        assert "Cup" not in api.context.ontology.types
        assert api.context.ontology.types["Can"].defaults["Shape.Height"] == 0.2
        assert (await api.ontology.history()).events[0].author == "Anna"

    run_with_api(tmp_path, use)


def test_mistakes_in_a_file_have_their_lines(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        text = "types:\n  Vat: {parent: Suport}\n  Tub: {parent: Vat, colour: 3}\nwithout: [types Device]\n"
        with pytest.raises(ModelError) as wrong:
            await api.ontology.import_yaml(ImportOntology(text=text, file="vats.yaml"))
        mistakes = {(mistake.file, mistake.line, mistake.subject) for mistake in error_report(wrong.value).mistakes}
        assert mistakes >= {("vats.yaml", 2, "Vat"), ("vats.yaml", 3, "Tub"), ("vats.yaml", 4, "Device")}

    run_with_api(tmp_path, use)


def test_what_is_exported_is_read_back(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        near_relation = RelationType(name="isNear", joins=("Object", "Object"), symmetric=True)
        await api.ontology.change(
            Define(
                definitions=Definitions(types=(VAT, structs.replace(upper().types["Jar"], doc="Ours")), relations=(near_relation,)),
                removed=(DefinitionKey(section=Section.TYPES, name="Cup"),),
                renamed=(Renaming(section=Section.TYPES, name="Bottle", to="Flask"),),
            )
        )
        await wait_for_version(api, 1)
        ontology = api.context.ontology
        for whole in (False, True):
            document = await api.ontology.export_yaml(whole=whole)
            read = load_text(document.content.decode()).ontology
            assert {type(definition): definition for definition in read} == {
                type(definition): definition for definition in ontology
            } or set(map(str, read)) == set(map(str, ontology))
        site = tmp_path / "site.yaml"
        site.write_bytes((await api.map.export()).content)
        reloaded_site = load([site])
        assert set(map(str, reloaded_site.ontology)) == set(map(str, ontology))
        assert reloaded_site.map == api.context.map

    run_with_api(tmp_path, use)


def test_a_discovered_object_turns_out_to_be_a_known_one(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        sighting = "?It: Jar isOn Platform001 AND ?It.PositionX = 6 AND ?It.PositionY = 1 AND ?It.PositionZ = 0.7"
        report = UpdateMap(situation=sighting, author="Camera001", observation=Observation(as_of=50.0))
        received = await api.map.change(report)
        assert received.reception is not None
        (name,) = received.reception.added
        history = await api.map.history(name)
        assert history.discovered == Discovery(author="Camera001", at=50.0)
        considered = await api.map.consider_merge(MergeObject(name=name, into="Jar002"))
        assert ObjectRemoved(name) in considered.changes
        with pytest.raises(Refused, match="super-type"):
            await api.map.merge(MergeObject(name=name, into="Platform001"))
        merged = await api.map.merge(MergeObject(name=name, into="Jar002", author="Ann"))
        await wait_for_version(api, merged.version)
        assert api.context.map.has_fact("isOn", ("Jar002", "Platform001"))
        assert name not in api.context.map.objects
        history = await api.map.history("Jar002", limit=1)
        assert ([event.author for event in history.events], history.more) == (["Ann"], True)
        history = await api.map.history("Jar002", before=merged.version)
        assert ([event.author for event in history.events], history.more) == (["Camera001"], False)

    run_with_api(tmp_path, use)


def test_the_map_is_changed_renamed_undone_and_looked_back_on(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        first = await api.map.read()
        considered = await api.map.consider(UpdateMap(changes=(ValueSet("Jar001", "Weight", 99.0),)))
        assert [(rule.subject, rule.path) for rule in considered.broken] == [("Jar001", "Weight")]
        await api.map.change(UpdateMap(situation="Jar001 isOn Platform001", author="Anna"))
        renamed = await api.map.rename(RenameObject(name="Jar001", to="Krug", author="Ben"))
        await wait_for_version(api, renamed.version)
        assert "Krug" in api.context.map.objects
        old_map = await api.map.read(version=0)
        assert old_map.version == 0
        assert Map(old_map.objects, old_map.facts) == Map(first.objects, first.facts)
        assert [event.version for event in (await api.map.history("Krug")).events] == [2, 1]
        events = await api.map.events(limit=1)
        assert (events.events[0].author, events.more) == ("Ben", True)
        assert [event.all_changes for event in (await api.map.events(brief=True)).events][-1] == 2
        with pytest.raises(Refused, match="Jar001 changed in version 2: undo that first"):
            await api.map.undo(1)
        await api.map.undo(2)
        undone = await api.map.undo(1)
        await wait_for_version(api, undone.version)
        now = await api.map.read()
        assert Map(now.objects, now.facts) == Map(first.objects, first.facts)

    run_with_api(tmp_path, use)


def test_the_map_of_the_past_is_the_same_however_it_is_found(tmp_path: Path) -> None:
    async def use(system: SmallSystem, api: LiveApi) -> None:
        await api.map.change(UpdateMap(situation="Jar001 isOn Platform001"))
        await api.ontology.change(Define(renamed=(Renaming(section=Section.TYPES, name="Jar", to="Pot"),)))
        await api.map.rename(RenameObject(name="Platform001", to="Stage001"))
        await api.map.change(UpdateMap(changes=(ObjectRemoved("Tin001"), ValueSet("Jar001", "Weight", 0.5))))
        last_undo = await api.map.undo(3)
        await wait_for_version(api, last_undo.version)
        async with Client(system.addresses) as client:
            for version in range(last_undo.version + 1):
                map_state = await api.map.read(version=version)
                assert map_state.version == version
                assert Map(map_state.objects, map_state.facts) == await client.map(version)

    async def run() -> None:
        async with running(tmp_path / "data") as (system, api):
            await use(system, api)

    asyncio.run(run())


def test_many_events_come_from_as_many_pages_as_it_takes(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        changes = [UpdateMap(changes=(ValueSet("Jar001", "Weight", 1 + number / 1000),), author="Ada") for number in range(450)]
        for begin in range(0, len(changes), 50):
            await asyncio.gather(*map(api.map.change, changes[begin : begin + 50]))
        events = await api.map.events(limit=400)
        assert [event.version for event in events.events] == list(range(450, 50, -1))
        assert events.more
        later_events = await api.map.events(after=10, limit=430)
        assert [event.version for event in later_events.events] == list(range(11, 441))
        assert [event.version for event in (await api.map.events(before=3)).events] == [2, 1]

    run_with_api(tmp_path, use)


def test_all_of_it_is_done_over_http_too(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        async with httpx.AsyncClient(base_url=api.client.url) as client:
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
        assert (await client.get("/map", params={"version": 99})).status_code == 400
        query = await client.get("/map/query", params={"formula": "Jar001 isOn"})
        assert (query.status_code, query.json()["error"]) == (400, "RequestMistaken")
        assert (await client.get("/map/objects/Jar999/history")).status_code == 400
        assert (await client.get("/ontology/export.yaml", params={"whole": True})).text.startswith("ontology:")
        described = (await client.get("/openapi.json")).json()
        assert {"/ontology/undo/{version}", "/map/events", "/map/renames"} <= described["paths"].keys()
        assert "DefinitionKey" in json.dumps(described)
        assert (await client.get("/map/events")).json()["events"] == []

    run_with_api(tmp_path, use)
