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
    "activeloc/Maze7-v0": {"task": "maze", "map": "maze(size=7):*"},
    "activeloc/Maze15-v0": {"task": "maze", "map": "maze(size=15):*"},
    "activeloc/Maze21-v0": {"task": "maze", "map": "maze(size=21):*"},
    "activeloc/NoisyMaze9-v0": {
        "task": {"kind": "maze", "p_off": 0.106, "confidence": 0.5},
        "map": "maze(size=9):*",
    },
}

MAX_EPISODE_STEPS = 150
#: Id -> steps of an episode, where they are not :data:`MAX_EPISODE_STEPS`.
STEPS = {
    "activeloc/KidnappedRobot-v0": 300,  # To notice, and to begin again.
    "activeloc/Maze7-v0": 15,
    "activeloc/Maze15-v0": 20,
    "activeloc/Maze21-v0": 30,
    "activeloc/NoisyMaze9-v0": 15,
}


def register() -> None:
    """Enter every id into Gymnasium's registry; those that are there already are left alone."""
    for name, settings in ENVIRONMENTS.items():
        if name not in gym.registry:
            gym.register(
                id=name,
                entry_point="activeloc.envs.localization:LocalizationEnv",
                vector_entry_point="activeloc.envs.vector:LocalizationVectorEnv",
                max_episode_steps=STEPS.get(name, MAX_EPISODE_STEPS),
                kwargs=settings,
            )
