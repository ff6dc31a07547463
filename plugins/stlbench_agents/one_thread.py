"""PyTorch on one thread, without denormal numbers, for as long as an agent trains."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Dead ReLUs push Adam's moments into denormal numbers, which are slow; flushing them is put back at the end, as
    what runs in the process later must not see another arithmetic."""
    import torch  # takes seconds: here, where something trains, and not where parameters of an agent are checked

    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
