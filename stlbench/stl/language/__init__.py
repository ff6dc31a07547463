"""Formulas: lexer, parser, syntax tree, and what can be read off a tree."""
