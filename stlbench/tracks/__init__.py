"""What a track adds to a task before training, and what its policies are compared with."""
