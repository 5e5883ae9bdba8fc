"""The mapping files on the page about things are right."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from somrs.adapters.things.adapter import ThingsAdapter
from somrs.ontology.files.loading import load

PAGE = Path(__file__).parents[4] / "docs" / "how-to" / "connect-things.md"
BLOCKS = re.findall(r"```yaml\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)

LIGHTS = next(block for block in BLOCKS if block.startswith("attributes: {On"))


def test_the_site_with_light_before_the_robot_goes_is_right(tmp_path: Path) -> None:
    (tmp_path / "lights.yaml").write_text(LIGHTS)
    (tmp_path / "site.yaml").write_text(next(block for block in BLOCKS if "MoveTo" in block))
    loaded = load([tmp_path / "site.yaml"])
    assert loaded.ontology.services["MoveTo"].precondition == "Lamp1.On = TRUE"


@pytest.mark.parametrize("block", [block for block in BLOCKS if "things:" in block and "adapters:" not in block])
def test_a_mapping_of_the_page_is_right(tmp_path: Path, block: str) -> None:
    (tmp_path / "things.yaml").write_text(block)
    (tmp_path / "mqtt.password").write_text("secret")
    (tmp_path / "lights.yaml").write_text(LIGHTS)
    adapter = ThingsAdapter({"broker": "mqtt://localhost", "mappings": ["things.yaml"]}, tmp_path)
    names = list(yaml.safe_load(block)["things"])
    assert [thing.name for thing in adapter.mappings[0].things] == names


@pytest.mark.parametrize("block", [block for block in BLOCKS if "adapters:" in block])
def test_settings_of_the_page_are_right(tmp_path: Path, block: str) -> None:
    settings = yaml.safe_load(block)["adapters"]["things"]
    if settings.get("broker") == "own":
        settings["broker"] = "mqtt://localhost"
    passages = next(block for block in BLOCKS if "Lift1: {type: Lift" in block)
    (tmp_path / "things.yaml").write_text(passages)
    (tmp_path / "scale.td.json").touch()
    ThingsAdapter(settings, tmp_path)
