"""The assignment problem: pairs of rows and columns with the least total cost, each row and column in at most one pair.

The method is that of Kuhn and Munkres with shortest augmenting paths; its time grows with the square of the rows times the columns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence


def assign(costs: Sequence[Mapping[str, float]], unassigned: float) -> list[str | None]:
    """The column of each row, or None, so that the sum of all costs is least. A row without a column costs `unassigned`.

    `costs` has, for each row, the cost of every column that it may have.
    """
    columns = sorted({column for row in costs for column in row})
    # Each row may also have a column of its own, which stands for no column.
    width = len(columns) + len(costs)
    matrix = [[row.get(column, math.inf) for column in columns] + [math.inf] * len(costs) for row in costs]
    for i, row in enumerate(matrix):
        row[len(columns) + i] = unassigned
    row_of = _augmented(matrix, width)
    assigned: list[str | None] = [None] * len(costs)
    for j, column in enumerate(columns):
        if row_of[j] is not None:
            assigned[row_of[j]] = column  # type: ignore[index]  # not None
    return assigned


def _augmented(matrix: Sequence[Sequence[float]], width: int) -> list[int | None]:
    """The row of each column. Every row has a finite cost in a column that no other row may have."""
    row_of: list[int | None] = [None] * width
    row_potentials, potentials = [0.0] * len(matrix), [0.0] * width
    for first_row in range(len(matrix)):
        distances, previous = [math.inf] * width, [-1] * width
        reached = [False] * width
        row, column, rows = first_row, -1, {first_row}
        while True:
            nearest = -1
            for j in range(width):
                if not reached[j]:
                    distance = matrix[row][j] - row_potentials[row] - potentials[j]
                    if distance < distances[j]:
                        distances[j], previous[j] = distance, column
                    if nearest < 0 or distances[j] < distances[nearest]:
                        nearest = j
            step = distances[nearest]
            for i in rows:
                row_potentials[i] += step
            for j in range(width):
                if reached[j]:
                    potentials[j] -= step
                else:
                    distances[j] -= step
            reached[nearest], column = True, nearest
            next_row = row_of[column]
            if next_row is None:
                break
            row = next_row
            rows.add(row)
        while column >= 0:
            before = previous[column]
            row_of[column] = row_of[before] if before >= 0 else first_row
            column = before
    return row_of
