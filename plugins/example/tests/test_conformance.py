"""The contract's own check of a reward method, found by its entry point as a user names it."""

import pytest

from stlbench.testing import check_method


@pytest.mark.parametrize("choice", ["verdict", "verdict[pay=end]"])
def test_the_contract_is_kept(choice: str) -> None:
    """Shapes, purity, batches, inputs and scale, on two formulas."""
    check_method(choice)
