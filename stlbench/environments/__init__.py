"""Environments of Gymnasium: made by name, read by names of their entries, acted on by vectors."""
