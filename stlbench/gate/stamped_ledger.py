"""A ledger of calibrated results, in which only what this code computed on this machine counts as finished."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from stlbench.gate.calibration import CALIBRATIONS
from stlbench.result import Result
from stlbench.status import Status
from stlbench.study.ledger import Ledger

__all__ = ["StampedLedger"]


class StampedLedger(Ledger):
    """A ledger that puts a stamp on each result.

    Args:
        path: the file.
        stamp: further provenance. A result with another one, or without calibration, does not count as finished:
            it was computed by other code or on another machine, and may not speak for this one.
    """

    def __init__(self, path: Path, stamp: Mapping[str, str]) -> None:
        super().__init__(path)
        self._stamp = dict(stamp)

    def record(self, result: Result) -> None:
        """Write the result with its stamp."""
        super().record(replace(result, provenance={**result.provenance, **self._stamp}))

    def finished(self, keys: Iterable[str], retry: Collection[Status] = (), attempts: int | None = None) -> set[str]:
        """See `Ledger.finished`; only what is calibrated and has this stamp."""
        results, stamp = self.results(super().finished(keys, retry, attempts)), self._stamp.items()
        return {result.key for result in results if stamp <= result.provenance.items() and _calibrated(result)}


def _calibrated(result: Result) -> bool:
    return result.provenance.keys() >= set(CALIBRATIONS)
