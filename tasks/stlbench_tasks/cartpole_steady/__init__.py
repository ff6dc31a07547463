"""Gymnasium's CartPole-v1, to be kept slow, in the middle and upright."""
