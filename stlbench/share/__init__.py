"""Runs and policies given away and taken in: bundles, policies from outside, and their scores."""
