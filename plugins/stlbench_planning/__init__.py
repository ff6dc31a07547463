"""Exact planning on a grid of the state: what a reward asks for, and the best that is possible."""
