"""Search for starts from which a policy or a controller violates the formula."""
