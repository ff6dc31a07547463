"""The paper's task on the ball-in-cup of the DeepMind control suite: catch, let go, catch."""
