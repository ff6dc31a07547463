"""The comparative study at the sampling time of the authors' program."""
