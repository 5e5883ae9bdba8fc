"""Which site `somrs up` starts a system with."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from somrs.cli.commands import DEMO_SITE, site_to_run
from somrs.deployment.private_files import discard
from somrs.deployment.system import SITE_FILE
from somrs.errors import UsageError
from tests.support.paths import SCENARIO_1


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A site file, whose map is in the folder `data` beside it."""
    site, data = tmp_path / "house.yaml", tmp_path / "data"
    site.write_text(SCENARIO_1.read_text())
    data.mkdir()
    (data / "repository.sqlite").touch()
    (data / SITE_FILE).write_bytes(msgspec.json.encode([str(site)]))
    return site


def test_without_a_site_and_a_map_it_is_that_of_the_demonstration(tmp_path: Path) -> None:
    assert site_to_run([], tmp_path / "data", fresh=False) == [DEMO_SITE]
    assert site_to_run([], tmp_path / "data", fresh=True) == [DEMO_SITE]


def test_without_a_site_the_map_in_the_data_folder_is_continued(house: Path) -> None:
    assert site_to_run([], house.parent / "data", fresh=False) == [house]


def test_the_map_of_another_site_is_not_deleted_for_that_of_the_demonstration(house: Path) -> None:
    with pytest.raises(UsageError, match="give the site to start with: somrs up SITE --fresh"):
        site_to_run([], house.parent / "data", fresh=True)


def test_a_site_that_is_not_there_is_named(house: Path) -> None:
    house.unlink()
    for site in ([], [house]):
        with pytest.raises(UsageError, match=r"house\.yaml: there is no such file"):
            site_to_run(site, house.parent / "data", fresh=False)


def test_what_a_system_has_kept_is_deleted_but_for_what_was_imported_just_now(tmp_path: Path) -> None:
    (tmp_path / "programs").mkdir()
    (tmp_path / "programs" / "robot.log").touch()
    (tmp_path / "repository.sqlite").touch()
    imported = tmp_path / "house.map.yaml"
    imported.touch()
    discard(tmp_path, keep=[imported])
    assert [*tmp_path.iterdir()] == [imported]
    discard(tmp_path / "not there")
