"""Agents that come with stlbench. Each module is one agent or one part of it."""
