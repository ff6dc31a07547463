"""Films of recorded traces."""
