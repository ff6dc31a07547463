"""Gymnasium's Hopper-v5, kept on its leg and going forwards, G[0,985] with F[0,15] of speed."""
