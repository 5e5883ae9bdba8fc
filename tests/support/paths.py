"""Where things are, for tests."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
SCENARIO_1 = ROOT / "src" / "somrs" / "demo" / "data" / "scenario-1.yaml"

SHARED = ROOT.parent / "shared"
"""Buildings and problems that others published. They are not part of the repository: what needs them is skipped where they are not."""
