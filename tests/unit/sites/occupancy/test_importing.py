"""The import of an occupancy map as a site that passes all checks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from somrs.cli.import_commands import import_site
from somrs.ontology.files.loading import load
from somrs.ontology.objects import Fact
from somrs.sites.draft import Draft
from somrs.sites.occupancy.building import building_of
from somrs.sites.occupancy.grid import Cell, OccupancyGrid
from somrs.sites.occupancy.importing import add_building
from somrs.sites.plan import Box
from somrs.space.findings import find_mistakes
from tests.support.floor_plans import FloorPlan, grid_of, rooms_in_rows
from tests.unit.sites.occupancy.test_building import PLANS


def save(grid: OccupancyGrid, path: Path) -> None:
    """Write a grid as `map_saver` does."""
    shades = np.select([grid.mask(Cell.OCCUPIED), grid.mask(Cell.FREE)], [0, 254], 205).astype(np.uint8)
    Image.fromarray(np.flipud(shades)).save(path.with_suffix(".pgm"))
    path.write_text(
        f"image: {path.with_suffix('.pgm').name}\nmode: trinary\nresolution: {grid.resolution}\norigin: [{grid.x}, {grid.y}, {grid.yaw}]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        "utf-8",
    )


def test_a_saved_map_becomes_a_site_file_without_mistakes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = rooms_in_rows([5.0, 4.0], [6.0], 0.1, [(0.9, 0.5)])
    source, target = tmp_path / "hall.yaml", tmp_path / "site.yaml"
    save(grid_of(plan, yaw=0.3, obstacles=[Box(1.0, 3.0, 0.8, 1.2, 0.0)]), source)
    import_site([source], target)
    assert "no problems" in capsys.readouterr().out
    loaded = load([target])
    assert loaded.map is not None
    kinds = [object.type for object in loaded.map.objects.values()]
    assert [kinds.count(kind) for kind in ("Storey", "Room", "Floor", "Wall", "Door", "Obstacle")] == [1, 2, 2, 6, 1, 1]
    assert Fact("connects", ("Door001", "Room001", "Room002")) in loaded.map.facts()
    assert find_mistakes(loaded.map, loaded.ontology) == []


@settings(deadline=None, max_examples=8)
@given(plan=PLANS, noise=st.sampled_from([0.0, 0.002, 0.02]), seed=st.integers(0, 1000))
def test_every_floor_plan_becomes_a_map_without_mistakes_also_of_a_noisy_grid(plan: FloorPlan, noise: float, seed: int) -> None:
    grid, rng = grid_of(plan, yaw=0.3), np.random.default_rng(seed)
    is_noise = rng.random(grid.shape) < noise
    grid.states[is_noise] = rng.integers(-1, 2, size=int(is_noise.sum()))
    draft = Draft()
    add_building(draft, "Hall", building_of(grid))
    site = draft.site("Hall", "hall.yaml")
    assert find_mistakes(site.map, site.ontology) == []
