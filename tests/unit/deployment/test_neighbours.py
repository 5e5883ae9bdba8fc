"""The file of a Registry's neighbours."""

from __future__ import annotations

from pathlib import Path

import pytest

from somrs.deployment.neighbours import read_neighbouring_maps, read_neighbours
from somrs.errors import UsageError
from somrs.protocol.messages.neighbours import Neighbour as NeighbouringMap
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


def test_a_neighbour_may_have_several_registries(tmp_path: Path) -> None:
    text = "Harbour: {registry: ['http://a:1/registry', 'http://a:1/registry-2'], takes: all, gives: nothing}"
    assert neighbours_in(tmp_path, text) == (
        Neighbour(name="Harbour", address="http://a:1/registry", takes=Selection()),
        Neighbour(name="Harbour-2", address="http://a:1/registry-2", takes=Selection(), map="Harbour"),
    )


@pytest.mark.parametrize(
    ("text", "expected_text"),
    [
        ("Harbour: {registry: [], takes: all, gives: all}", "is a URL such as http://HOST:PORT/registry, not ''"),
        ("- Harbour", "the names of neighbours are missing"),
        ("\nHarbour: 3", "neighbours.yaml:2: Harbour: Expected `object`"),
        ("Harbour: {registry: 'http://a:1/r', takes: all}", "missing required field `gives`"),
        (
            "Harbour: {registry: 'http://a:1/r', takes: some, gives: all}",
            "`registry` is its address, or a list of addresses, and `takes` and",
        ),
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


MAPS = """
Harbour:
  repository: http://harbour.example:8500/repository
  shows: [Yard, Ramp1]
  changes: true
Airport:
  registry: http://airport.example:8600/registry
  takes: all
  gives: all
  repository: http://airport.example:8500/repository
  shows: nothing
  changes: false
Mill: {repository: 'http://mill.example:8500/repository', shows: all, changes: false}
Farm: {registry: 'http://farm.example:8600/registry', takes: all, gives: nothing}
"""


def test_a_neighbour_may_have_a_map_or_services_or_both(tmp_path: Path) -> None:
    assert [neighbour.name for neighbour in neighbours_in(tmp_path, MAPS)] == ["Airport", "Farm"]
    assert read_neighbouring_maps(tmp_path / "neighbours.yaml", "Town") == (
        NeighbouringMap(map="Harbour", address="http://harbour.example:8500/repository", shows=("Yard", "Ramp1")),
        NeighbouringMap(map="Airport", address="http://airport.example:8500/repository", may_change=False),
        NeighbouringMap(map="Mill", address="http://mill.example:8500/repository", shows_all=True, may_change=False),
    )


@pytest.mark.parametrize(
    ("text", "expected_text"),
    [
        ("Harbour: {repository: 'http://a:1/r', shows: all}", "missing required field `changes`"),
        ("Harbour: {repository: harbour, shows: all, changes: true}", "`repository` is a URL such as http://HOST:PORT/repository"),
        ("Harbour: {repository: 'http://a:1/r', shows: some, changes: true}", "`shows` is all, nothing, or a list of places"),
        ("Harbour: {repository: 'http://a:1/r', shows: all, changes: true, hides: all}", "unknown field `hides`"),
        ("Town: {repository: 'http://a:1/r', shows: all, changes: true}", "Town is the name of the own map"),
        ("My town: {repository: 'http://a:1/r', shows: all, changes: true}", "a neighbour with a map has the map's name"),
    ],
)
def test_a_mistake_about_a_map_is_told_with_its_place(tmp_path: Path, text: str, expected_text: str) -> None:
    file = tmp_path / "neighbours.yaml"
    file.write_text(text, "utf-8")
    with pytest.raises(UsageError) as raised:
        read_neighbouring_maps(file, "Town")
    assert "neighbours.yaml" in str(raised.value)
    assert expected_text in str(raised.value)
