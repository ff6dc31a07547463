"""Predicates compiled to functions of a sample or of arrays of samples."""
