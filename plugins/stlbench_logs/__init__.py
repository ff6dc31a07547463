"""The built-in logs: runs shown by tools of others."""
