"""Lunar lander that reaches its pad, stays there and does not crash; needs the extra field."""
