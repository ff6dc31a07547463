"""Monitors: verdicts while a trace is still growing."""
