"""Gymnasium's Walker2d-v5, kept on its legs and going forwards, G[0,985] with F[0,15] of speed."""
