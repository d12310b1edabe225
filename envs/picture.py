"""From a robot's episode to a picture of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.view import view_frame
from activeloc.envs.episodes import Episodes
from activeloc.envs.maze_episodes import MazeEpisodes
from activeloc.envs.rendering import Scene

HEADINGS = 24
PIXELS = 160
DOTS = 2000


def scene_of(
    episodes: Episodes | MazeEpisodes, robot: int, history: Sequence[float], caption: str = ""
) -> Scene:
    """The scene of a robot's episode as it stands.

    Args:
        episodes: The batch.
        robot: Which one.
        history: Entropy fractions so far, the present one last.
        caption: Words for the panel; the state of the episode if empty.
    """
    if isinstance(episodes, MazeEpisodes):
        return _maze_scene(episodes, robot, history, caption)
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


def _maze_scene(
    episodes: MazeEpisodes, robot: int, history: Sequence[float], caption: str
) -> Scene:
    """A maze of cells of 1 m; a heading's belief is shared by the two bins that meet at it."""
    planes = episodes.belief.planes()[robot]
    bins = np.zeros((8, *planes.shape[1:]))
    for k in range(4):
        for t in (3 + 2 * k, 4 + 2 * k):
            bins[t % 8] += 0.5 * planes[k]
    likeliest = episodes.lattice.pose_of(robot, int(episodes.belief.likeliest[robot]))
    info = episodes.info(robot)
    return Scene(
        grid=episodes.grid(robot),
        belief=bins / bins.sum(),
        belief_resolution=1.0,
        pose=_in_metres(episodes.pose(robot)),
        estimate=_in_metres(likeliest),
        scan=np.array([info["depth"] - 0.5]),
        bearings=np.zeros(1),
        z_max=float(episodes.lattice.size),
        entropy=float(np.clip(history[-1], 0.0, 1.0)),
        history=[float(np.clip(h, 0.0, 1.0)) for h in history[:-1]],
        step=int(episodes.steps[robot]),
        caption=caption or f"largest probability {info['mass']:.2f}",
        radius=0.3,
    )


def _in_metres(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Row, column and heading to the pose of the cell's centre."""
    row, col, heading = place
    return np.array([col + 0.5, row + 0.5, 0.5 * np.pi * heading])


def _state(episodes: Episodes, robot: int) -> str:
    info = episodes.info(robot)
    if episodes.terminated(robot):
        return "localized" if info["is_success"] else "wrong and sure"
    return f"{info['mass']:.0%} near the estimate"
