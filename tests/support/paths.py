"""Paths for tests."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
SCENARIO_1 = ROOT / "src" / "somrs" / "demo" / "data" / "scenario-1.yaml"
SCENARIO_2 = SCENARIO_1.with_name("scenario-2.yaml")

SHARED = ROOT.parent / "shared"
"""Published buildings and problems. They are not part of the repository; tests that need them are skipped without them."""
