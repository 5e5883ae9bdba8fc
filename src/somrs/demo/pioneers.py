"""What the wires of Pioneer robots tell of a scenario that they have played by ARCOS."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from somrs.adapters.arcos.messages import Status, report
from somrs.adapters.arcos.packets import PacketParser

SPEED = "1"
"""Simulated seconds per second: the controllers of the robots run in real time."""


def wire_checks(wires: Path, scenario: str) -> dict[str, bool]:
    """The checks of the wires' records in a folder, each with whether it passed."""
    files = sorted(wires.glob("arcos-*.jsonl"))
    checks = {"both robots were driven by ARCOS": len(files) == 2 and all(any(_reports(file)) for file in files)}
    if scenario == "1b":
        stalled = [file for file in files if any(status.stalled_wheels for status in _reports(file))]
        checks["the motors of one of them stalled, as its controller reported"] = len(stalled) == 1
    return checks


def _reports(file: Path) -> Iterator[Status]:
    """The reports of a robot, as they came on its wire."""
    parser = PacketParser()
    with file.open(encoding="utf-8") as lines:
        for line in map(json.loads, lines):
            if line["direction"] == "<":
                for body in parser.feed(bytes.fromhex(line["message"])):
                    match report(body):
                        case Status() as status:
                            yield status
