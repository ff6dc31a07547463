"""When an agent reports a policy."""

from __future__ import annotations

import numpy as np


def report_rounds(rounds: int, checkpoints: int) -> set[int]:
    """The rounds, 1..rounds, after which a policy is reported: evenly spaced, the last among them."""
    return set(np.linspace(0, rounds, min(checkpoints, rounds) + 1)[1:].round().astype(int).tolist())
