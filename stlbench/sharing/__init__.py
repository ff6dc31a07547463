"""Results as one file: packed for others, checked anywhere, scored again rather than believed."""
