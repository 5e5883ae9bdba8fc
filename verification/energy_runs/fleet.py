"""The building of an energy run: a hall with robots, few chargers, and platforms between which the robots carry boxes."""

from __future__ import annotations

import random
from dataclasses import dataclass

ROW = 5
"""Platforms in a row."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """What a seed determines: how many robots, chargers and platforms there are, the distance between two platforms (`spacing`, m), and the
    charges of the robots at the beginning (%)."""

    seed: int
    robots: int = 10
    chargers: int = 3
    platforms: int = 15
    spacing: float = 3.0
    lowest_charge: int = 25
    highest_charge: int = 95

    @property
    def boxes(self) -> list[str]:
        return [f"Box{number:02}" for number in range(1, self.platforms, 2)]

    @property
    def destinations(self) -> list[str]:
        return [f"Platform{number:02}" for number in range(1, self.platforms + 1)]

    def site(self) -> str:
        """The site as YAML."""
        rows = -(-self.platforms // ROW)
        width, depth = self.spacing * (max(ROW, self.robots / 2) + 1), self.spacing * (rows + 2)
        dice = random.Random(self.seed)
        lines = [
            "upper: 2",
            "map: Hall",
            "objects:",
            "  Room001:",
            "    type: Room",
            "    parts:",
            f"      Floor001: {_box('Floor', width / 2, depth / 2, -0.1, width, depth, 0.1)}",
            f"      WallSouth: {_box('Wall', width / 2, -0.05, 0, width, 0.1, 2.5)}",
            f"      WallNorth: {_box('Wall', width / 2, depth + 0.05, 0, width, 0.1, 2.5)}",
            f"      WallWest: {_box('Wall', -0.05, depth / 2, 0, 0.1, depth, 2.5)}",
            f"      WallEast: {_box('Wall', width + 0.05, depth / 2, 0, 0.1, depth, 2.5)}",
        ]
        facts: list[str] = []
        for number in range(self.platforms):
            x, y = self.spacing * (number % ROW + 1), self.spacing * (number // ROW + 1)
            lines.append(f"  Platform{number + 1:02}: {_box('Platform', x, y, 0, 0.5, 0.5, 0.3)}")
            if number % 2 == 0:
                lines.append(f"  Box{number + 1:02}: {{type: Jar, at: [{x}, {y}, 0.3]}}")
                facts.append(f"  - Box{number + 1:02} isOn Platform{number + 1:02}")
        for number in range(self.chargers):
            lines.append(f"  Charger{number + 1}: {{type: Charger, at: [{width - 1}, {self.spacing * (number + 1)}]}}")
        for number in range(self.robots):
            x, y = 1 + number * (width - 4) / self.robots, depth - 1
            charge = dice.randint(self.lowest_charge, self.highest_charge)
            lines.append(f"  Robot{number + 1:02}: {{type: PioneerP3DX, at: [{x:.2f}, {y}, 0], Price: 10 EUR, Charge: {charge}}}")
        return "\n".join([*lines, "facts:", *facts, ""])


def _box(kind: str, x: float, y: float, z: float, width: float, depth: float, height: float) -> str:
    shape = f"Shape: {{Form: Box, Width: {width}, Depth: {depth}, Height: {height}}}"
    return f"{{type: {kind}, at: [{x}, {y}, {z}], {shape}}}"
