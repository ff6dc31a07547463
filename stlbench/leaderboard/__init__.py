"""A table of submitted bundles: their policies scored on starts that nobody could know, beside what they claim."""
