"""Tasks that come with stlbench: a package each, with a `task.yaml`, the dynamics, and their tests."""
