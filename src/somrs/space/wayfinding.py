"""Path search on a field of clearances: A* on its cells, guided by exact distances on a coarser grid.

Driving near obstacles costs more than driving in open space, so that paths lead through the middle of doors.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from somrs.space.clearance import CELL, Cell, Field

BLOCK = 6
"""Cells along the side of a block, which is a cell of the coarse grid."""
TIGHT = 2.0
"""Additional cost per metre of driving without any spare clearance."""
LEVELS = 50
"""Number of levels of clearance; level 0 is occupied."""
HASTE = 1.1 / CELL
"""Weight of the coarse distance, in cells per metre. Overestimating it by 10 % halves the search, for paths a few per cent longer."""
MOST_COSTS = 8
"""The number of blocks whose costs to all others are kept."""
_STEPS = tuple((dr, dc, math.hypot(dr, dc)) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if (dr, dc) != (0, 0))


@dataclass(frozen=True, slots=True)
class Costs:
    """The approximate cost of reaching each block, in metres of free driving; never much higher than the actual cost."""

    blocks: NDArray[np.float64]

    def cost_to(self, cell: Cell) -> float:
        return float(self.blocks[cell[0] // BLOCK, cell[1] // BLOCK])


def _levels_of(field: Field, radius: float, comfort: float) -> NDArray[np.uint8]:
    """The level of each cell: 0 where the robot cannot be, from 1 (touching) to LEVELS (`comfort` or more to spare)."""
    room = (field - radius) / comfort
    levels: NDArray[np.uint8] = np.where(room < 0, 0, 1 + np.clip(room, 0, 1) * (LEVELS - 1)).astype(np.uint8)
    return levels


def _factor(level: Any) -> Any:
    """The cost of a metre at a level, or at each level of an array."""
    return 1 + TIGHT * (1 - (level - 1) / (LEVELS - 1)) ** 2


class FreeGround:
    """The cells of a field where a robot can be, and what all searches on them share. `comfort`: clearance to spare that is worth a detour.

    The outermost cells of the field must be obstacles.
    """

    def __init__(self, field: Field, radius: float, comfort: float) -> None:
        self.field = field
        self.labels: NDArray[np.int32] = ndimage.label(field >= radius, structure=np.ones((3, 3)))[0]
        levels = _levels_of(field, radius, comfort)
        self._columns, self._cells = levels.shape[1], levels.tobytes()
        self._blocks, self._graph = _coarse(levels)
        self._costs: dict[int, Costs] = {}

    def costs_from(self, start: Cell) -> Costs:
        """Costs by Dijkstra's algorithm over blocks. The last ones are kept: a stop of one robot is often one of the next robot, too."""
        block = start[0] // BLOCK * self._blocks[1] + start[1] // BLOCK
        if block not in self._costs:
            while len(self._costs) >= MOST_COSTS:
                del self._costs[next(iter(self._costs))]
            self._costs[block] = Costs(dijkstra(self._graph, indices=block).reshape(self._blocks))
        return self._costs[block]

    def search(self, start: Cell, goal: Cell) -> list[Cell] | None:
        """The cells of a cheap path from start to goal, which must both be free; None if there is none."""
        ahead: list[float] = self.costs_from(goal).blocks.ravel().tolist()
        return _search(self._cells, self._columns, ahead, start, goal)


def _coarse(levels: NDArray[np.uint8]) -> tuple[tuple[int, int], csr_array]:
    """The numbers of rows and columns of blocks, and the costs between neighbours; a block has the level of its best cell."""
    rows, columns = (-(-n // BLOCK) for n in levels.shape)
    padded = np.zeros((rows * BLOCK, columns * BLOCK), dtype=np.uint8)
    padded[: levels.shape[0], : levels.shape[1]] = levels
    best = padded.reshape(rows, BLOCK, columns, BLOCK).max(axis=(1, 3))
    price, number = _factor(best.astype(float)) * BLOCK * CELL, np.arange(rows * columns).reshape(rows, columns)
    sources, targets, weights = [], [], []
    for dr, dc, step in _STEPS:
        source_cells = slice(max(-dr, 0), rows - max(dr, 0)), slice(max(-dc, 0), columns - max(dc, 0))
        target_cells = slice(max(dr, 0), rows - max(-dr, 0)), slice(max(dc, 0), columns - max(-dc, 0))
        open = (best[source_cells] > 0) & (best[target_cells] > 0)
        sources.append(number[source_cells][open])
        targets.append(number[target_cells][open])
        weights.append((price[source_cells][open] + price[target_cells][open]) / 2 * step)
    joined = np.concatenate(weights), (np.concatenate(sources), np.concatenate(targets))
    return (rows, columns), coo_array(joined, shape=(number.size, number.size)).tocsr()


def _search(cells: bytes, columns: int, ahead: list[float], start: Cell, goal: Cell) -> list[Cell] | None:
    """A* on cells with these levels. `ahead`: the cost from each block to the goal."""
    block_columns = -(-columns // BLOCK)
    prices = [math.inf, *(float(_factor(level)) for level in range(1, LEVELS + 1))]
    steps = [(dr * columns + dc, length) for dr, dc, length in _STEPS]
    # Priority: cost so far plus estimated cost ahead, in cells. The estimate is the coarse cost or, near the goal, the straight line.
    begin, end = start[0] * columns + start[1], goal[0] * columns + goal[1]
    costs, predecessors, closed = {begin: 0.0}, {begin: begin}, set[int]()
    queue = [(0.0, begin)]
    while queue:
        _, cell = heapq.heappop(queue)
        if cell == end:
            break
        if cell in closed:
            continue
        closed.add(cell)
        so_far, price = costs[cell], prices[cells[cell]]
        for offset, length in steps:
            neighbour = cell + offset
            level = cells[neighbour]
            if level == 0 or neighbour in closed:
                continue
            cost = so_far + length * (price + prices[level]) / 2
            if cost < costs.get(neighbour, math.inf):
                costs[neighbour], predecessors[neighbour] = cost, cell
                row, column = divmod(neighbour, columns)
                coarse = ahead[row // BLOCK * block_columns + column // BLOCK] * HASTE
                heapq.heappush(queue, (cost + max(coarse, math.hypot(row - goal[0], column - goal[1])), neighbour))
    else:
        return None
    way = [end]
    while way[-1] != begin:
        way.append(predecessors[way[-1]])
    return [divmod(cell, columns) for cell in reversed(way)]
