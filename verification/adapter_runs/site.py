"""The building of the runs, and the settings of the adapters in it."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from verification.adapter_runs.cases import Case, Phase

ROOT = Path(__file__).parents[2]
ROBOTS = ("Robot1", "Robot2")
DOMAIN = os.getpid() % 100 + 1
"""Runs at the same time do not hear each other's nodes."""

MAP = """
map: Lab
objects:
  Building1:
    type: Building
    parts:
      Storey1:
        type: Storey
        parts:
          Floor1: {type: Floor, at: [4, 3, -0.1], Shape: {Form: Box, Width: 8.2, Depth: 6.2, Height: 0.1}}
  Table1: {type: Table, at: [1, 4.2, 0], Shape: {Form: Box, Width: 0.6, Depth: 1.4, Height: 0.7}}
  Platform1: {type: Platform, at: [6.5, 4.6, 0], Shape: {Form: Box, Width: 0.8, Depth: 0.8, Height: 0.3}}
  Jar1: {type: Jar, at: [1.15, 3.9, 0.7]}
  Jar2: {type: Jar, at: [1.15, 4.5, 0.7]}
  Charger1: {type: Charger, at: [3.5, 0.7]}
  Robot1: {type: PioneerP3DX, at: [2, 1.5, 0], Price: 10 EUR, Speed: 0.8, Charge: 96}
  Robot2: {type: PioneerP3DX, at: [6, 1.5, 0], Price: 25 EUR, Speed: 1.0, Charge: 96}
facts:
  - Jar1 isOn Table1
  - Jar2 isOn Table1
"""

DOOR = """
  Door1: {type: AutomaticDoor, at: [4, 3, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
  South1: {type: Wall, at: [4, 1.15, 0], Shape: {Form: Box, Width: 0.1, Depth: 2.5, Height: 2.5}}
  North1: {type: Wall, at: [4, 4.85, 0], Shape: {Form: Box, Width: 0.1, Depth: 2.5, Height: 2.5}}
"""

UPPER = 4.0
"""The height of the upper floor of the building with a lift, m."""

LIFT = """
          Gate1: {type: LiftDoor, at: [8.05, 3, 0], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
      Storey2:
        type: Storey
        Elevation: 4
        parts:
          Floor2: {type: Floor, at: [4, 3, 3.9], Shape: {Form: Box, Width: 8.2, Depth: 6.2, Height: 0.1}}
          Gate2: {type: LiftDoor, at: [8.05, 3, 4], Shape: {Form: Box, Width: 0.1, Depth: 1.2, Height: 2.1}}
      Lift1: {type: Lift, at: [9.1, 3, 0], Speed: 0.5, Shape: {Form: Box, Width: 1.8, Depth: 1.8, Height: 2.3}}
"""

LIFT_FACTS = """
  - Lift1 stopsAt Storey1
  - Lift1 stopsAt Storey2
  - Gate1 leadsInto Lift1
  - Gate2 leadsInto Lift1
"""

LIFT_MAPPING = 'things: {Lift1: {type: Lift, session: {connection: broker, topic: lifts/1, levels: {Storey1: "1", Storey2: "2"}}}}\n'
MAPPING = "things: {Door1: {type: AutomaticDoor, session: {connection: broker, topic: doors/1}}}\n"


def goal_of(case: Case, thing: str) -> str:
    return "Robot1.Charge = 100" if case.phase is Phase.CHARGING else f"{thing} isOn Platform1"


def write_site(case: Case, folder: Path) -> Path:
    """Write the site of a case into a folder."""
    text = MAP
    if case.phase is Phase.PASSING:
        text = MAP.replace("  Table1:", f"{DOOR}  Table1:")
        (folder / "things.yaml").write_text(MAPPING)
    elif case.phase is Phase.RIDING:
        text = MAP.replace("\n  Table1:", f"{LIFT}  Table1:").replace("[6.5, 4.6, 0]", f"[6.5, 4.6, {UPPER:g}]") + LIFT_FACTS.lstrip("\n")
        (folder / "things.yaml").write_text(LIFT_MAPPING)
    settings = adapters_of(case.kind)
    assert settings is not None, "it has been tried out whether the protocol runs here"
    file = folder / "site.yaml"
    file.write_text(f"{text}\n{yaml.safe_dump({'adapters': settings})}")
    return file


def adapters_of(kind: str) -> dict[str, Any] | None:
    """The settings of the adapters; None if the protocol does not run here."""
    match kind.split():
        case ["vda5050", version]:
            return {"vda5050": {"broker": "own", "vehicles": {robot: {"simulated": version} for robot in ROBOTS}}}
        case ["ros2"]:
            python = _ros_python()
            binding = str(ROOT / "examples" / "ros2_robot.yaml")
            robots = {robot: {"binding": binding, "namespace": robot.lower(), "simulated": True} for robot in ROBOTS}
            environment = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}  # nodes that are killed leave their shared memory
            ros = {"python": str(python), "domain": DOMAIN, "discovery": "LOCALHOST", "environment": environment, "robots": robots}
            return {"ros2": ros} if python is not None else None
        case ["things"]:
            return {"things": {"broker": "own", "mappings": ["things.yaml"], "simulated": {"Door1": {}}}}
        case ["lift", *vehicles]:
            levels = {"1": 0.0, "2": UPPER}
            things = {"broker": "own", "mappings": ["things.yaml"], "simulated": {"Lift1": levels}}
            return {"things": things, **((adapters_of("vda5050 3.0") or {}) if vehicles else {})}
    return {}


def _ros_python() -> Path | None:
    """A Python with ROS 2: that of `scripts/ros2`, or this one; None if there is none."""
    folder = ROOT / ".venv-ros2"
    if (folder / ".ready").exists():
        return folder / "bin" / "python"
    return Path(sys.executable) if find_spec("rclpy") is not None else None
