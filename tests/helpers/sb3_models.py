"""Models of Stable-Baselines3 that nobody trained."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any


def saved(
    path: Path, algorithm: str, env: Any, policy: str = "MlpPolicy", *, spread: float = 1, seed: int = 1, **words: Any
) -> Any:
    """Save a model whose weights scatter by `spread`, so that its actions differ; the model."""
    import stable_baselines3
    import torch

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options = {"device": "cpu", "seed": 0, "policy_kwargs": words}
        model = getattr(stable_baselines3, algorithm)(policy, env, **options)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for weight in model.policy.parameters():
            weight.copy_(spread * torch.randn(weight.shape, generator=generator))
    model.save(path)
    return model
