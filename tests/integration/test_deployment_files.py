"""The files with which systemd runs the components on several hosts."""

from __future__ import annotations

import configparser
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from somrs.cli.main import command
from tests.support.paths import ROOT

FOLDER = ROOT / "deploy" / "systemd"
UNIT = FOLDER / "somrs@.service"
COMPONENTS = ("bus", "gateway", "repository", "registry", "task-manager", "scheduler", "trust")


def settings() -> dict[str, str]:
    """The variables in the file of settings, as systemd reads it."""
    lines = (line.strip() for line in (FOLDER / "somrs.env").read_text().splitlines())
    pairs = (line.partition("=") for line in lines if line and not line.startswith("#"))
    return {name: "".join(shlex.split(value)) if " " not in value else shlex.split(value)[0] for name, _, value in pairs}


@pytest.mark.parametrize("component", COMPONENTS)
def test_each_component_gets_its_settings_from_the_file(monkeypatch: pytest.MonkeyPatch, component: str) -> None:
    for name, value in settings().items():
        monkeypatch.setenv(name, value)
    unit = configparser.ConfigParser(interpolation=None, strict=False)
    unit.read(UNIT)
    program, run, name = shlex.split(unit["Service"]["ExecStart"].replace("%i", component))
    assert Path(program).name == "somrs"
    group: Any = command()
    parameters = group.commands[run].commands[name].make_context(name, []).params
    by_component: dict[str, dict[str, object]] = {
        "bus": {"data": Path("/var/lib/somrs"), "host": "10.0.0.1", "port": 4222, "route": [f"10.0.0.{host}:6222" for host in (1, 2, 3)]},
        "gateway": {"host": "10.0.0.1", "port": 8600, "name": "office", "url": "http://somrs.example:8600"},
        "trust": {"data": Path("/var/lib/somrs"), "host": "10.0.0.1", "port": 8610},
        "repository": {"site": [Path("/etc/somrs/office.yaml")]},
    }
    expected = by_component.get(component, {})
    if component not in ("bus", "trust"):
        expected |= {"bus": settings()["SOMRS_BUS"], "name": "office"}
    assert {key: list(value) if isinstance(value, tuple) else value for key, value in parameters.items() if key in expected} == expected


def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    if (verifier := shutil.which("systemd-analyze")) is None:
        pytest.skip("SKIPPED: systemd-analyze is not installed, so nobody has checked deploy/systemd/somrs@.service")
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/somrs/bin/somrs", sys.executable))
    verified = subprocess.run([verifier, "verify", str(unit)], capture_output=True, text=True, check=False)
    assert (verified.returncode, verified.stderr) == (0, "")
