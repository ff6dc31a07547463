"""The clock of a solve."""

import time
from dataclasses import dataclass, field


@dataclass
class Clock:
    """The time that the user gave."""

    minutes: float
    _began: float = field(default_factory=lambda: time.perf_counter())

    @property
    def spent(self) -> float:
        """Seconds."""
        return time.perf_counter() - self._began

    @property
    def left(self) -> float:
        """Seconds, at least 0."""
        return max(0.0, 60 * self.minutes - self.spent)
