"""The paper's pendulum: three angles in turn."""
