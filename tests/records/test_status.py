"""How cells end, and which of these ends are tried again."""

from __future__ import annotations

import pytest

from stlbench.errors import UsageError
from stlbench.records.status import ACCIDENTS, accidents_of


def test_failures_to_try_again() -> None:
    assert accidents_of("failed") == accidents_of(True) == accidents_of(["failed", "timeout"]) == ACCIDENTS
    assert accidents_of("killed, raised") == ("raised", "killed")
    assert accidents_of(None) == accidents_of(False) == ()
    with pytest.raises(UsageError, match="no failure 'kiled'; did you mean 'killed'"):
        accidents_of("kiled")
    with pytest.raises(UsageError, match="no failure 'done'"):
        accidents_of("done,killed")
