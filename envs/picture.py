"""From a robot's episode to a picture of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.view import view_frame
from activeloc.envs.episodes import Episodes
from activeloc.envs.rendering import Scene, draw

HEADINGS = 24
PIXELS = 160
DOTS = 2000


def scene_of(episodes: Episodes, robot: int, history: Sequence[float], caption: str = "") -> Scene:
    """The scene of a robot's episode as it stands.

    Args:
        episodes: The batch.
        robot: Which one.
        history: Entropy fractions so far, the present one last.
        caption: Words for the panel; the state of the episode if empty.
    """
    knowledge, truth = episodes.knowledge(robot), episodes.simulator.poses[robot].copy()
    belief, grid = episodes.belief, episodes.belief.terrain(robot).grid
    left, bottom, pixel = view_frame(grid, PIXELS, PIXELS)
    particles = None
    if isinstance(belief, ParticleBelief):
        particles = belief.particles(robot)[0]
        particles = particles[:: max(1, len(particles) // DOTS)]
    return Scene(
        grid=grid,
        belief=belief.view(robot, HEADINGS, PIXELS, PIXELS),
        belief_resolution=pixel,
        belief_origin=(left, bottom),
        pose=truth,
        estimate=knowledge.summary.estimate,
        scan=knowledge.scan,
        bearings=knowledge.sensor.bearings,
        z_max=knowledge.sensor.z_max,
        entropy=float(np.clip(history[-1], 0.0, 1.0)),
        history=[float(np.clip(h, 0.0, 1.0)) for h in history[:-1]],
        step=knowledge.step,
        caption=caption or _state(episodes, robot),
        radius=knowledge.motion.radius,
        particles=particles,
    )


def _state(episodes: Episodes, robot: int) -> str:
    info = episodes.info(robot)
    if episodes.terminated(robot):
        return "localized" if info["is_success"] else "wrong and sure"
    return f"{info['mass']:.0%} near the estimate"


def picture_of(
    episodes: Episodes, robot: int, history: Sequence[float], caption: str = "", size: int = 600
) -> NDArray[np.uint8]:
    """:func:`scene_of`, drawn: ``(H, W, 3)``."""
    return draw(scene_of(episodes, robot, history, caption), size)
