"""Three robots that change their order and keep their distances: one formula over all of them."""
