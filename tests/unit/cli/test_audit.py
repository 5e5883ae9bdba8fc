"""`somrs audit` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from somrs.cli.main import app

RUNNER = CliRunner()


def somrs(*arguments: str, code: int = 0) -> str:
    result = RUNNER.invoke(app, arguments)
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture
def data(tmp_path: Path) -> str:
    folder = str(tmp_path / "data")
    somrs("user", "add", "Ada", "--data", folder)
    somrs("user", "role", "Ada", "engineer", "--data", folder)
    somrs("token", "new", "Keeper", "--data", folder)
    return folder


def test_the_entries_are_listed_and_exported(data: str, tmp_path: Path) -> None:
    listed = somrs("audit", "list", "--data", data)
    assert "access.set_role" in listed
    assert "before: operator" in " ".join(listed.split())
    assert "access.add_person" not in somrs("audit", "list", "--most", "2", "--data", data)
    entries = json.loads(somrs("audit", "list", "--json", "--data", data))
    assert "no entries of Eve" in somrs("audit", "list", "--name", "Eve", "--data", data)
    file = tmp_path / "export.jsonl"
    assert "4 entries" in somrs("audit", "export", str(file), "--data", data)
    assert [json.loads(line) for line in file.read_text().splitlines()] == entries
    assert "is there already" in somrs("audit", "export", str(file), "--data", data, code=2)


def test_a_digest_that_was_noted_is_compared(data: str) -> None:
    digest = somrs("audit", "verify", "--data", data).partition("digest: ")[2].split()[0]
    somrs("user", "remove", "Ada", "--data", data)
    assert "5 entries from number 1 on, none altered" in somrs("audit", "verify", "--digest", digest, "--data", data)
    assert "no entry has the digest" in somrs("audit", "verify", "--digest", "1" * 64, "--data", data, code=2)


def test_a_name_is_erased(data: str) -> None:
    assert "erased in 3 entries" in somrs("audit", "erase", "Ada", "--data", data)
    assert "Ada" not in somrs("audit", "list", "--data", data)
    assert "in 3 of them something was erased" in somrs("audit", "verify", "--data", data)
    assert "no entry has the name Ada" in somrs("audit", "erase", "Ada", "--data", data)


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    for command in (["list"], ["verify"], ["erase", "Ada"], ["export", str(tmp_path / "export.jsonl")]):
        assert "there is no folder" in somrs("audit", *command, "--data", str(tmp_path / "nothing"), code=2)
    assert not (tmp_path / "export.jsonl").exists()
