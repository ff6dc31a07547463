"""The paper's mobile robot navigation: two regions in turn."""
