"""The made-up plugins of the command line's tests, on which damaged input is tried."""

from __future__ import annotations

from importlib import import_module

import pytest
from cli.conftest import say, toy

__all__ = ["brief", "say", "toy"]


@pytest.fixture
def brief(monkeypatch, say, toy):
    """Runs end without tables and figures, which take most of their time and are not what is tried."""
    module = import_module("stlbench.cli.run")  # the package has a function of that name
    monkeypatch.setattr(module, "report_cells", lambda *_: None)
    return say
