"""Sound bounds of a margin over a box of signals."""
