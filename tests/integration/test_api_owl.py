"""OWL files through the API: exported, imported after a look at the consequences, and put on the map."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from rdflib import Graph

from somrs.api.ontology import ImportOntology
from somrs.api.remote import LiveApi
from somrs.errors import ModelError, RemoteError
from somrs.ontology import owl
from somrs.ontology.objects import FactAdded, ObjectAdded
from tests.integration.test_api_editing import run_with_api, wait_for_version
from tests.support.small_system import running
from tests.unit.ontology.owl.test_owl import PREFIXES

NEW = (
    PREFIXES
    + """
type:Cup a owl:Class ; rdfs:label "Mug" ; rdfs:subClassOf type:Graspable .
type:Bottle owl:deprecated true ; a owl:Class ; rdfs:subClassOf type:Graspable .
:Vase a owl:Class ; rdfs:subClassOf type:Cup ; owl:disjointWith type:Jar .
:Vase1 a :Vase ; attribute:PositionX 1 ; attribute:PositionY 1 ; attribute:PositionZ 0.8 ;
  attribute:Shape [ attribute:Form "Cylinder" ; attribute:Radius 0.1 ; attribute:Height 0.2 ] ; relation:isOn object:Cupboard001 .
"""
)


def test_what_is_exported_can_be_taken_over_and_changes_nothing(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        for format in owl.Format:
            document = await api.ontology.export_owl(format=format, map=True)
            assert document.name == {"turtle": "site.ttl", "xml": "site.rdf"}[format]
            assert len(Graph().parse(data=document.content, format=format.value)) > 1000
            result = await api.ontology.import_owl(ImportOntology(text=document.content.decode()), dry=True, map=True)
            assert (result.consequences.revision, result.on_map, result.notes) == (None, (), ())
            assert result.objects == len(api.context.map.objects)
        bare = await api.ontology.export_owl(shapes=False)
        assert b"NodeShape" not in bare.content

    run_with_api(tmp_path, use)


def test_a_file_is_taken_over_after_its_consequences_were_shown(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        dry = await api.ontology.import_owl(ImportOntology(text=NEW, file="vases.ttl"), dry=True, map=True)
        assert dry.version is None
        assert dry.consequences.revision is not None
        assert [type.name for type in dry.consequences.revision.before.types] == ["Bottle", "Cup"]
        assert sorted(type.name for type in dry.consequences.revision.after.types) == ["Mug", "Vase"]
        assert [type(change) for change in dry.on_map] == [ObjectAdded, FactAdded]
        assert [(note.file, note.subject) for note in dry.notes] == [("vases.ttl", "Vase")]
        assert "Vase" not in api.context.ontology.types
        result = await api.ontology.import_owl(ImportOntology(text=NEW, author="Anna"), map=True)
        assert result.version is not None
        await wait_for_version(api, result.version)
        types = api.context.ontology.types
        assert types["Vase"].parent == "Mug"
        assert not {"Cup", "Bottle"} & types.keys()
        assert api.context.map.objects["Vase1"].values["Shape.Radius"] == 0.1
        assert api.context.map.has_fact("isOn", ("Vase1", "Cupboard001"))
        assert (await api.ontology.history()).events[0].author == "Anna"

    run_with_api(tmp_path, use)


def test_nothing_is_taken_over_of_a_file_whose_objects_break_a_rule(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        broken = NEW.replace('"Cylinder"', '"Cylindre"')
        with pytest.raises(ModelError, match="did you mean Cylinder"):
            await api.ontology.import_owl(ImportOntology(text=broken), map=True)
        assert "Vase" not in api.context.ontology.types
        result = await api.ontology.import_owl(ImportOntology(text=broken))
        assert result.objects == 1
        assert result.on_map == ()
        assert result.version is not None
        await wait_for_version(api, result.version)
        assert "Vase" in api.context.ontology.types
        assert "Vase1" not in api.context.map.objects

    run_with_api(tmp_path, use)


def test_a_type_that_is_in_use_cannot_be_deprecated_away(tmp_path: Path) -> None:
    async def use(api: LiveApi) -> None:
        text = PREFIXES + "type:Jar owl:deprecated true ; a owl:Class ; rdfs:subClassOf type:Graspable ."
        dry = await api.ontology.import_owl(ImportOntology(text=text), dry=True)
        assert any("Jar" in rule.message for rule in dry.consequences.broken)
        with pytest.raises(RemoteError, match="Jar"):
            await api.ontology.import_owl(ImportOntology(text=text))

    run_with_api(tmp_path, use)


def test_long_files_are_read_in_a_process_of_their_own(tmp_path: Path) -> None:
    async def use() -> None:
        async with running(tmp_path / "data") as (_, api):
            document = await api.ontology.export_owl(map=True)
            text = document.content.decode() + "\n#" * 250_000
            result = await api.ontology.import_owl(ImportOntology(text=text), dry=True, map=True)
            assert (result.consequences.revision, result.on_map) == (None, ())

    asyncio.run(use())
