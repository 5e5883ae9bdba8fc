"""What holds in a Python process that has just begun: what it has not imported, and what its hashes are not to matter for."""

from __future__ import annotations

import os
import subprocess
import sys

from somrs.ontology.files.loading import upper
from somrs.ontology.owl import export

WRITE = "import sys; from somrs.ontology.owl import export; from somrs.ontology.files.loading import upper;"


def test_the_same_ontology_gives_the_same_file() -> None:
    line = f"{WRITE} sys.stdout.buffer.write(export(upper()))"
    written = {
        subprocess.run([sys.executable, "-c", line], capture_output=True, check=True, env={**os.environ, "PYTHONHASHSEED": seed}).stdout
        for seed in ("1", "2")
    }
    assert written == {export(upper())}


def test_where_rdflib_is_missing_it_is_said_what_to_install() -> None:
    line = f"{WRITE} sys.modules['rdflib'] = None; export(upper())"
    result = subprocess.run([sys.executable, "-c", line], capture_output=True, text=True)
    assert "UsageError: OWL files need rdflib" in result.stderr
    assert "somrs[api]" in result.stderr


def test_units_are_loaded_only_when_they_differ() -> None:
    program = """
import sys
from somrs.entish.parse import parse
from somrs.ontology.map import Map
from somrs.ontology.objects import Object
from somrs.ontology.truth import formula_holds
map = Map([Object(name="Jar1", type="Jar")])
from somrs.ontology.types import AttributeType, Kind, ObjectType, Ontology
weight = AttributeType(name="Weight", kind=Kind.NUMBER, unit="kg")
ontology = Ontology([weight, ObjectType(name="Jar", parent=None, defaults={"Weight": 1})])
assert formula_holds(parse("Jar1.Weight = 1 kg AND Jar1.Weight < 2"), map, ontology)
assert "pint" not in sys.modules
assert formula_holds(parse("Jar1.Weight = 1000 g"), map, ontology)
assert "pint" in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)
