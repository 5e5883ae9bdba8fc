"""Measures traffic, all of it in one run: `python benchmarks/traffic.py`.

That are the planner on grids, beside others; deliveries by many robots in a hall; and how many robots the simulator moves with physics. The
parts can be run alone, also for other numbers of robots.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PARTS = (("grids.py",), ("hall.py",), ("worlds.py", "physics", "10", "30", "50"))
"""The scripts beside this one, with their arguments."""


def main() -> int:
    for script, *arguments in PARTS:
        print(f"== {script}", flush=True)
        code = subprocess.run([sys.executable, Path(__file__).with_name(script), *arguments], check=False).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
