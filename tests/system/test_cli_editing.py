"""`somrs ontology` and `somrs map` as a user meets them, beside a Repository that runs as one."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from somrs.client.addresses import Addresses
from somrs.ontology.files.loading import load_definitions, upper
from tests.support.command import somrs
from tests.support.paths import SCENARIO_1


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of a system of which only the Repository runs."""
    folder = tmp_path_factory.mktemp("cli") / "data"
    command = [sys.executable, "-m", "somrs.cli.main", "run", "repository", "--site", str(SCENARIO_1), "--data", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        try:
            assert program.stdout is not None
            address = json.loads(program.stdout.readline())["at"]
            Addresses(repository=address, registry="http://127.0.0.1:1/registry", task_manager="http://127.0.0.1:1/tm").write(folder)
            yield folder
        finally:
            program.terminate()


def run(data: Path, *arguments: str | Path, code: int = 0) -> str:
    """What the command says; it exits with the code, and without a stack trace."""
    result = somrs(*arguments, "--data", data)
    assert result.returncode == code, result.stdout + result.stderr
    assert "Traceback" not in result.stderr
    return result.stdout + result.stderr


def plain(text: str) -> str:
    """A table's text, however its lines were broken."""
    return " ".join(text.split())


def test_an_ontology_is_edited_and_what_was_done_is_undone(data: Path, tmp_path: Path) -> None:
    file = tmp_path / "vats.yaml"
    file.write_text("types:\n  Vat: {parent: Support}\n")
    assert "added type Vat" in run(data, "ontology", "import", file, "--dry-run")
    assert "version 1" in run(data, "ontology", "import", file, "--author", "Anna")
    assert "version 2" in run(data, "ontology", "rename", "type", "Vat", "Tub")
    assert "version 3" in run(data, "ontology", "remove", "types", "Cup", "Bottle")
    history = plain(run(data, "ontology", "history"))
    for part in ("Anna", "added type Vat", "renamed type Vat to Tub", "removed type Cup"):
        assert part in history, history
    events = json.loads(run(data, "ontology", "history", "--limit", "2", "--json"))
    assert [event["version"] for event in events] == [3, 2]
    assert "version 4" in run(data, "ontology", "undo", "3")
    assert "undid version 3" in plain(run(data, "ontology", "history", "--limit", "1"))
    assert "before version 4" in plain(run(data, "ontology", "history", "--limit", "1"))
    target = tmp_path / "out.yaml"
    run(data, "ontology", "export", target)
    assert "Tub" in load_definitions(target.read_text(), "out.yaml", upper()).types
    assert "Jar:" not in target.read_text()
    run(data, "ontology", "export", target, "--whole")
    assert "Jar:" in target.read_text()


def test_what_cannot_be_done_is_said_with_all_that_stands_in_the_way(data: Path, tmp_path: Path) -> None:
    message = run(data, "ontology", "remove", "type", "Jar", code=1)
    assert "Jar002: no type is called Jar" in message
    dry = run(data, "ontology", "remove", "type", "Jar", "--dry-run", code=1)
    assert "the change would be rejected" in dry
    assert "removed type Jar" in dry
    assert "attribute, relation, function, type, service" in run(data, "ontology", "remove", "thing", "Jar", code=2)
    assert "neither removed nor renamed" in run(data, "ontology", "rename", "type", "Device", "Machine", code=1)
    assert "there is no version 99" in run(data, "ontology", "undo", "99", code=1)
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("types:\n  Vat2: {parent: Suport}\n")
    assert "wrong.yaml:2: Vat2: no type is called Suport" in run(data, "ontology", "import", wrong, code=2)
    assert "nowhere.yaml" in run(data, "ontology", "import", tmp_path / "nowhere.yaml", code=2)


def test_a_map_is_looked_back_on_and_its_changes_undone(data: Path) -> None:
    run(data, "map", "update", "Jar002.Weight = 0.7", "--author", "Anna")
    run(data, "map", "rename", "Jar003", "Krug", "--author", "Ben")
    history = plain(run(data, "map", "events", "--limit", "2"))
    for part in ("Anna", "Jar002.Weight = 0.7", "Ben", "renamed object Jar003 to Krug"):
        assert part in history, history
    renamed, weighed = json.loads(run(data, "map", "events", "--limit", "2", "--json"))
    assert "Jar002.Weight" in run(data, "map", "undo", str(weighed["version"]), "--dry-run")
    run(data, "map", "undo", str(weighed["version"]))
    assert "0.7" not in run(data, "map", "show", "Jar002")
    assert "Ben" in run(data, "map", "history", "Krug")
    run(data, "map", "undo", str(renamed["version"]))
    assert "Jar003" in run(data, "map", "show", "Jar003")
    assert "is a device" in run(data, "map", "rename", "Robot1", "Rob", code=1)


def test_a_discovered_object_is_a_known_one(data: Path) -> None:
    sighting = "?It: Jar isOn Platform001 AND ?It.PositionX = 8.2 AND ?It.PositionY = 2.5 AND ?It.PositionZ = 0.3"
    told = run(data, "map", "update", sighting, "--author", "Camera001")
    name = told.split()[2].rstrip(",")
    assert "new on the map" in told
    assert "discovered by Camera001" in run(data, "map", "show", name)
    assert "discovered by Camera001" in run(data, "map", "history", name)
    assert json.loads(run(data, "map", "show", name, "--json"))["discovered"]["author"] == "Camera001"
    assert f"{name} disappeared" in run(data, "map", "merge", name, "Jar002", "--dry-run")
    run(data, "map", "merge", name, "Jar002", "--author", "Ben")
    assert f"{name} is Jar002" in plain(run(data, "map", "history", "Jar002"))
    assert "--before" in run(data, "map", "history", "Jar002", "--limit", "1")
    assert "is known to be Jar002 already" in run(data, "map", "merge", name, "Jar002", code=1)
    (merged,) = json.loads(run(data, "map", "events", "--limit", "1", "--json"))
    run(data, "map", "undo", str(merged["version"]))
    assert "discovered by Camera001" in run(data, "map", "show", name)


def test_an_object_is_added_and_removed_by_an_update(data: Path) -> None:
    position = "Jar099.PositionX = 4.0 AND Jar099.PositionY = 2.0 AND Jar099.PositionZ = 0.75"
    beside = position.replace("4.0", "1.0")
    refusal = run(data, "map", "update", f"Jar099 isOn Table001 AND {beside}", "--add", "Jar099:Jar", code=1)
    assert "Jar099: it is on Table001, and its position is 2.30 m beside that" in plain(refusal)
    run(data, "map", "update", f"Jar099 isOn Table001 AND {position}", "--add", "Jar099:Jar")
    shown = json.loads(run(data, "map", "show", "Jar099", "--json"))
    assert shown["type"] == "Jar"
    assert "Jar099 isOn Table001" in shown["facts"]
    run(data, "map", "update", "--remove", "Jar099")
    assert "there is no Jar099" in run(data, "map", "show", "Jar099", code=2)
    assert "NAME:TYPE" in run(data, "map", "update", "--add", "Jar099", code=2)
    assert "nothing to change" in run(data, "map", "update", code=2)
