"""Plugins: found by entry point, chosen on the command line, told apart by a fingerprint of their source."""
