"""Mixed-integer linear programmes, row by row; HiGHS solves them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array


class Programme:
    """Linear rows over variables that are numbered as they are made."""

    def __init__(self) -> None:
        self.low, self.high, self.whole = list[float](), list[float](), list[int]()
        self.rows, self.least, self.most = list[Mapping[int, float]](), list[float](), list[float]()

    def variable(self, low: float, high: float, whole: bool = False) -> int:
        """A new variable between two numbers, perhaps a whole one."""
        self.low.append(low)
        self.high.append(high)
        self.whole.append(int(whole))
        return len(self.low) - 1

    def require(self, row: Mapping[int, float], least: float, most: float = np.inf) -> None:
        """The sum of variables times their factors lies between two numbers."""
        self.rows.append(row)
        self.least.append(least)
        self.most.append(most)

    def maximise(self, variable: int, **options: Any) -> Any:
        """The result of `scipy.optimize.milp` for the greatest value of a variable, with these options."""
        entries = [(i, j, factor) for i, row in enumerate(self.rows) for j, factor in row.items()]
        rows, columns, factors = zip(*entries, strict=True)
        matrix = coo_array((factors, (rows, columns)), shape=(len(self.rows), len(self.low))).tocsr()
        cost = np.zeros(len(self.low))
        cost[variable] = -1
        return milp(
            cost,
            constraints=LinearConstraint(matrix, self.least, self.most),
            integrality=self.whole,
            bounds=Bounds(self.low, self.high),
            options=options,
        )
