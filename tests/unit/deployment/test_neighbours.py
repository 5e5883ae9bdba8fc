"""The file of a Registry's neighbours."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.deployment.neighbours import read_neighbours
from somrs.errors import UsageError
from somrs.registry.neighbours import Neighbour
from somrs.registry.selection import Selection

HARBOUR = "Harbour: {registry: 'http://harbour.example:8600/registry', takes: all, gives: nothing}"


def neighbours_in(folder: Path, text: str) -> tuple[Neighbour, ...]:
    file = folder / "neighbours.yaml"
    file.write_text(text)
    return read_neighbours(file)


def test_neighbours_keep_their_order_and_what_passes(tmp_path: Path) -> None:
    text = f"""
{HARBOUR}
Airport:
  registry: http://airport.example:8600/registry
  takes: {{types: [Transport, Clean], areas: [Hall2]}}
  gives: {{providers: [Robot1]}}
"""
    assert neighbours_in(tmp_path, text) == (
        Neighbour(name="Harbour", address="http://harbour.example:8600/registry", takes=Selection()),
        Neighbour(
            name="Airport",
            address="http://airport.example:8600/registry",
            takes=Selection(types=("Transport", "Clean"), areas=("Hall2",)),
            gives=Selection(providers=("Robot1",)),
        ),
    )
    assert neighbours_in(tmp_path, "") == ()


@pytest.mark.parametrize(
    ("text", "expected_text"),
    [
        ("- Harbour", "the names of neighbours are missing"),
        ("\nHarbour: 3", "neighbours.yaml:2: Harbour: Expected `object`"),
        ("Harbour: {registry: 'http://a:1/r', takes: all}", "missing required field `gives`"),
        ("Harbour: {registry: 'http://a:1/r', takes: some, gives: all}", "`registry` is its address, and `takes` and `gives` are"),
        ("Harbour: {registry: 'http://a:1/r', takes: {type: [A]}, gives: all}", "unknown field `type`"),
        ("Harbour: {registry: harbour, takes: all, gives: all}", "is a URL such as http://HOST:PORT/registry, not 'harbour'"),
        (f"{HARBOUR}\n{HARBOUR.replace('Harbour', 'Port')}", "the neighbours Harbour and Port are both http://harbour.example"),
        (f"{HARBOUR}\n{HARBOUR}", "is already written in line 1"),
        ("Harbour: {", "this is not YAML"),
    ],
)
def test_a_mistake_is_told_with_its_place(tmp_path: Path, text: str, expected_text: str) -> None:
    with pytest.raises(UsageError) as raised:
        neighbours_in(tmp_path, text)
    assert "neighbours.yaml" in str(raised.value)
    assert expected_text in str(raised.value)
