"""Robustness and satisfaction of whole recorded traces."""
