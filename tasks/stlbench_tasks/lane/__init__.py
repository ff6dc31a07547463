"""Car on a highway that is fast again and again and does not crash; needs the extra field."""
