"""OWL files on the Ontology page and on the command line."""

from __future__ import annotations

import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page, expect

from .conftest import RunningSystem, take_screenshot

PREFIXES = "@prefix : <http://example.org/vases#> . @prefix type: <urn:so-mrs:type:> . @prefix owl: <http://www.w3.org/2002/07/owl#> ."
VASES = f"""{PREFIXES}
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
:Vase a owl:Class ; rdfs:subClassOf type:Jar ; owl:disjointWith type:Can .
:Vase1 a :Vase .
"""


def somrs(*arguments: str, system: RunningSystem) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "somrs.cli.main", "ontology", *arguments, "--data", str(system.data)]
    return subprocess.run(line, capture_output=True, text=True)


def test_what_a_file_would_change_is_shown_and_what_it_says_besides(
    system: RunningSystem, window: Callable[..., Page], tmp_path: Path
) -> None:
    file = tmp_path / "vases.ttl"
    file.write_text(VASES)
    page = window(f"{system.url}/ontology")
    page.get_by_role("button", name="Import").click()
    dialog = page.get_by_role("dialog", name="Import definitions")
    dialog.locator("input[type=file]").set_input_files(file)
    expect(dialog.get_by_text("Not imported: 1")).to_be_visible()
    expect(dialog.get_by_role("row").filter(has_text="owl:disjointWith Can")).to_contain_text("3")
    expect(dialog.get_by_text("Also add its one individual to the map")).to_be_visible()
    expect(dialog.get_by_role("button", name="Import")).to_be_visible()
    take_screenshot(page, "ontology-import-owl")
    dialog.get_by_text("Also add its one individual to the map").click()
    expect(dialog.get_by_text("Vase1: a Vase must have PositionX")).to_be_visible()
    expect(dialog.get_by_role("button", name="Import")).to_be_hidden()
    with urllib.request.urlopen(f"{system.url}/api/ontology/export.ttl?map=true") as answer:
        assert b"Vase" not in answer.read()


def test_the_command_line_writes_and_considers_the_same(system: RunningSystem, tmp_path: Path) -> None:
    out_file = tmp_path / "site.rdf"
    assert "objects" in somrs("export", str(out_file), "--map", system=system).stdout
    dry_run = somrs("import", str(out_file), "--map", "--dry-run", system=system)
    assert (dry_run.returncode, dry_run.stdout, dry_run.stderr) == (0, "nothing would change\n", "")
    (tmp_path / "vases.ttl").write_text(VASES)
    result = somrs("import", str(tmp_path / "vases.ttl"), "--dry-run", system=system)
    assert result.stdout == "added type Vase\n"
    assert "vases.ttl:3: Vase: owl:disjointWith Can" in result.stderr
    broken = somrs("import", str(tmp_path / "vases.ttl"), "--map", system=system)
    assert broken.returncode == 2
    assert "Vase1: a Vase must have PositionX" in broken.stderr
