"""The help that a track adds to a task before training, and the scores to compare its policies with."""
