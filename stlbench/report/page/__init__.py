"""One page: everything that a folder of results holds, in a single HTML file that loads nothing from elsewhere."""
