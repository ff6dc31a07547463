"""The paper's task on the Fetch arm of Gymnasium-Robotics: two points in turn."""
