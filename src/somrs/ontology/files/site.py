"""Writes a whole site as one YAML file: the map, and the definitions that are not in the upper ontology."""

from __future__ import annotations

from somrs.ontology.files.dump import dump_map, dump_ontology, name_of
from somrs.ontology.files.levels import level_of
from somrs.ontology.files.loading import upper
from somrs.ontology.map import Map
from somrs.ontology.naming import key_of
from somrs.ontology.types import Ontology


def dump_site(ontology: Ontology, map: Map, name: str | None = None) -> str:
    """The text of a file that `load` reads back as this ontology and this map."""
    level = level_of(ontology)
    base = upper(level)
    is_unchanged = {key_of(definition): definition for definition in ontology} == {key_of(definition): definition for definition in base}
    definitions = dump_ontology(ontology, base=base, name=name or name_of(map, ontology) or "site") if not is_unchanged else ""
    if is_unchanged and level > 1:
        definitions = f"upper: {level}\n"
    return definitions + dump_map(map, ontology, name)
