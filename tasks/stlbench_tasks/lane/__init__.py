"""Car on a highway that is fast again and again and does not crash, with a controller written by hand; needs the
extra field.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stlbench.contract import Array, GymTask

_LEFT, _IDLE, _RIGHT, _FASTER, _SLOWER = range(5)
_UNITS = 200.0, 16.0, 80.0
"""The scales of the observation: m along the road, m across, and m/s."""
_LANE, _LANES = 4.0, 4
_FREE, _NEAR, _BETTER = 17.0, 11.0, 5.0
"""Metres to the next car: from which the controller speeds up, below which it slows down, and by how much another lane
has to be freer."""
_TIME = 2.0
"""Seconds that it keeps, at the present speeds, from the car ahead."""


class Lane(GymTask):
    """Car on a highway that is fast again and again and does not crash, G[0,50] F[0,15]; needs the extra field."""

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        """Fast where the own lane is free, else to a freer lane beside it, else slower: a number of a manoeuvre."""
        ego, others = observation[0], observation[1:][observation[1:, 0] > 0.5]
        along, across, faster = (others[:, 1:4] * _UNITS).T
        lane = round(float(ego[2]) * _UNITS[1] / _LANE)
        gap, room = _gap(along, across, faster, 0.0)
        if gap > _FREE and room > _TIME:
            return (float(_FASTER),)
        sides = [(_LEFT, -_LANE)] * (lane > 0) + [(_RIGHT, _LANE)] * (lane < _LANES - 1)
        found = [(*_gap(along, across, faster, side), move) for move, side in sides if not _beside(along, across, side)]
        free = [(metres, move) for metres, seconds, move in found if metres > gap + _BETTER and seconds > _TIME]
        if free and room > _TIME / 2:
            return (float(max(free)[1]),)
        return (float(_SLOWER if gap < _NEAR or room < _TIME else _IDLE),)


def _gap(along: Array, across: Array, faster: Array, lane: float) -> tuple[float, float]:
    """Metres to the next car ahead in a lane that is so many metres to the right, and seconds until it is reached."""
    ahead = (np.abs(across - lane) < _LANE * 0.6) & (along > 0)
    if not ahead.any():
        return 1000.0, 1000.0
    metres = along[ahead] - 5.0  # a car is 5 m long
    return float(metres.min()), float((metres / np.maximum(-faster[ahead], 0.1)).min())


def _beside(along: Array, across: Array, lane: float) -> bool:
    """Whether a car of that lane is so near that there is no room."""
    return bool(np.any((np.abs(across - lane) < _LANE * 0.75) & (np.abs(along) < 20)))
