"""Gymnasium environments: one table of ids.

``import activeloc`` registers them; ``gym.make("activeloc/GlobalLocalization-v0")`` makes one,
``gym.make_vec(..., num_envs=B)`` the native vector environment.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym

#: Id -> default settings. All are one class.
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "activeloc/GlobalLocalization-v0": {"task": "global"},
    "activeloc/KidnappedRobot-v0": {"task": "kidnapped"},
    "activeloc/PositionTracking-v0": {"task": "tracking"},
}

MAX_EPISODE_STEPS = 150


def register() -> None:
    """Enter every id into Gymnasium's registry; those that are there already are left alone."""
    for name, settings in ENVIRONMENTS.items():
        if name not in gym.registry:
            gym.register(
                id=name,
                entry_point="activeloc.envs.localization:LocalizationEnv",
                vector_entry_point="activeloc.envs.vector:LocalizationVectorEnv",
                max_episode_steps=MAX_EPISODE_STEPS,
                kwargs=settings,
            )
