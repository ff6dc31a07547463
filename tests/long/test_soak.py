"""A short soak: all kinds of faults, and a run that is killed three times."""

from __future__ import annotations

import pytest
from long.soak import Soak, told


@pytest.mark.slow
def test_a_short_soak(tmp_path):
    soak = Soak(tmp_path, count=200, share=0.15, kills=3, jobs=2)
    found = soak.run()
    assert not found.broken, told(soak)
    assert found.kills == 3
