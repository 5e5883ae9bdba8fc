"""`somrs thing check` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from somrs.cli.main import app

RUNNER = CliRunner()

MAPPING = """
things:
  Lamp1:
    type: Light
    connection: broker
    attributes: {On: {topic: lamp/state}}
    services: {SwitchOn: {write: [{topic: lamp/set, payload: "ON"}]}}
"""


def check(file: Path, *options: str, code: int = 0) -> str:
    result = RUNNER.invoke(app, ["thing", "check", str(file), *options], env={"COLUMNS": "200"})
    assert result.exit_code == code, result.output
    return result.output


def test_what_a_mapping_becomes_is_printed(tmp_path: Path) -> None:
    file = tmp_path / "things.yaml"
    file.write_text(MAPPING)
    printed = check(file)
    for expected in ("Lamp1", "broker: lamp/state", "SwitchOn", "?Provider.On = TRUE", "broker: lamp/set <- ON"):
        assert expected in printed
    report = json.loads(check(file, "--json"))
    assert report["services"][0]["done_when"] == "?Provider.On = TRUE"


def test_problems_are_printed_with_their_lines_and_the_exit_status_is_2(tmp_path: Path) -> None:
    file = tmp_path / "things.yaml"
    file.write_text(MAPPING.replace("type: Light", "type: Lihgt"))
    assert f"{file}:4: Lamp1: there is no type Lihgt; did you mean Light" in check(file, code=2)
    assert "there is no file" in check(tmp_path / "none.yaml", code=2)


def test_what_is_not_mapped_is_printed(tmp_path: Path) -> None:
    file = tmp_path / "discovery.json"
    file.write_text(json.dumps({"homeassistant/button/bell/config": {"name": "Bell", "command_topic": "bell"}}))
    assert "not mapped: Bell: Bell: an entity of the kind button" in check(file)


def test_announcements_among_other_messages_are_found(tmp_path: Path) -> None:
    topic, config = "homeassistant/button/bell/config", {"name": "Bell", "command_topic": "bell"}
    file = tmp_path / "dump.json"
    for text in (
        json.dumps({topic: config, "bell/state": "ON"}),
        json.dumps({topic: json.dumps(config)}),
        f"{topic} {json.dumps(config)}\nbell/state ON\n",
    ):
        file.write_text(text)
        assert "not mapped: Bell: Bell: an entity of the kind button" in check(file)


def test_messages_that_cannot_be_meant_are_told(tmp_path: Path) -> None:
    file = tmp_path / "things.yaml"
    services = "{SetBrightness: {write: [{topic: lamp/set, payload: Brightness}]}}"
    lamp = f"type: Light, attributes: {{Brightness: {{topic: lamp/b}}}}, services: {services}"
    file.write_text(f'connections: {{house: {{url: "mqtt://broker"}}}}\nthings:\n  Lamp1: {{{lamp}}}\n  Lamp2: {{{lamp}}}\n')
    printed = check(file)
    assert "Lamp1: SetBrightness sends the same whatever is ordered; write ?Brightness in its payload" in printed
    assert "Lamp1, Lamp2: lamp/set gets the same messages from them" in printed


@pytest.mark.parametrize("text", ['connections: {house: {url: "mqtt://10.0.0.5"}}', "things: {}", "types: {Boiler: {parent: Heater}}"])
def test_a_file_without_things_is_told(tmp_path: Path, text: str) -> None:
    file = tmp_path / "things.yaml"
    file.write_text(text)
    assert "warning: there are no things in it" in check(file)
