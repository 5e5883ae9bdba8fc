"""The options of `somrs up` that typer does not have."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup

from somrs.cli.main import app


@pytest.mark.parametrize(
    ("arguments", "bus", "site"),
    [
        (["--bus"], "own", []),
        (["--bus", "lab.yaml", "jars:2.yaml"], "own", ["lab.yaml", "jars:2.yaml"]),
        (["lab.yaml", "--bus"], "own", ["lab.yaml"]),
        (["--bus", "nats://10.0.0.1:4222,nats://10.0.0.2:4222", "lab.yaml"], "nats://10.0.0.1:4222,nats://10.0.0.2:4222", ["lab.yaml"]),
        (["--bus", "127.0.0.1:4222", "lab.yaml"], "127.0.0.1:4222", ["lab.yaml"]),
        (["--bus", "one:4222,two:4222"], "one:4222,two:4222", []),
        (["lab.yaml", "--bus", "[::1]:4222"], "[::1]:4222", ["lab.yaml"]),
    ],
)
def test_a_bus_is_told_from_a_site(arguments: list[str], bus: str, site: list[str]) -> None:
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    with group.commands["up"].make_context("up", arguments) as context:
        assert context.params["bus"] == bus
        assert [*context.params["site"]] == [Path(file) for file in site]
