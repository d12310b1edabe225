"""What a policy sees: the belief, the map, the scan and a few scalars, of one shape for any map.

The *world view* sums the belief on ``(headings, rows, cols)`` over the smallest square around the
map, channels first, and averages the map over the same pixels. A probability spread over half a
million states is invisible to a network, so the view shows ``sqrt(p / max p)``: in [0, 1], equal to
one at its peak, and able to show a hundredth of it as a tenth.

The *egocentric view* (:mod:`activeloc.beliefs.metric_view`) shows what may be around the robot. It
depends neither on the map's size nor on where north is; it is left out unless it is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs import Belief, Summary
from activeloc.beliefs.metric_view import PLACE, PLANES, WAYS, MetricView
from activeloc.beliefs.view import map_view

SCALARS = ("entropy", "mass", "touched", "turned", "travelled")


@dataclass(frozen=True, slots=True)
class ObservationConfig:
    """Resolution of the world view, and whether there is an egocentric one.

    Attributes:
        headings: Heading bins.
        rows: Rows of pixels.
        cols: Columns of pixels.
        view: Whether the egocentric view is in it.
        radius: Its window is ``2 radius + 1`` pixels of 0.5 m wide.

    Raises:
        ConfigError: If a number is out of its range.
    """

    headings: int = 8
    rows: int = 32
    cols: int = 32
    view: bool = False
    radius: int = 8

    def __post_init__(self) -> None:
        checks.integer("observation.headings", self.headings, 1, 360)
        checks.integer("observation.rows", self.rows, 1, 512)
        checks.integer("observation.cols", self.cols, 1, 512)
        checks.boolean("observation.view", self.view)
        checks.integer("observation.radius", self.radius, 1, 100)

    def space(self, n_beams: int) -> gym.spaces.Dict:
        """The observation space of one robot; see :func:`observe` for what is in it."""
        shape = (self.headings, self.rows, self.cols)
        spaces: dict[str, gym.spaces.Space[Any]] = {
            "belief": gym.spaces.Box(0.0, 1.0, shape, np.float32),
            "map": gym.spaces.Box(0.0, 1.0, shape[1:], np.float32),
            "scan": gym.spaces.Box(-1.0, 1.0, (n_beams,), np.float32),
            "scalars": gym.spaces.Box(-1.0, 1.0, (len(SCALARS),), np.float32),
        }
        if self.view:
            side = 2 * self.radius + 1
            shapes = {"view": (PLANES, side, side), "ways": WAYS, "place": PLACE}
            for name, part in shapes.items():
                spaces[name] = gym.spaces.Box(0.0, 1.0, part, np.float32)
        return gym.spaces.Dict(spaces)


def observe(
    config: ObservationConfig,
    belief: Belief,
    robot: int,
    summary: Summary,
    scan: NDArray[np.float64],
    z_max: float,
    u: NDArray[np.float64],
    touched: bool,
    view: MetricView | None = None,
) -> dict[str, NDArray[Any]]:
    """The observation of one robot: new arrays of float32.

    Args:
        config: Resolution.
        belief: Whose view is drawn.
        robot: Which one.
        summary: What the belief says in short.
        scan: ``(B,)`` [m].
        z_max: Longest range of the sensor [m].
        u: ``(3,)`` last odometry reading.
        touched: Whether the last motion was stopped by an obstacle.
        view: Draws the egocentric view; None to leave it out.

    Returns:
        ``belief`` ``(headings, rows, cols)``: sqrt(p / max p). ``map`` ``(rows, cols)``: share of
        free ground. ``scan`` ``(B,)``: range over ``z_max``, -1 for no reading. ``scalars``: the
        entropy as a fraction of the uniform's, the mass near the estimate, whether the robot
        touched something, how far it turned [half turns] and travelled [m, cut to 1]. ``view``
        ``(5, s, s)``, ``ways`` ``(2, 12, 9)`` and ``place`` ``(24,)``: see
        :mod:`activeloc.beliefs.metric_view`.
    """
    p = belief.view(robot, config.headings, config.rows, config.cols)
    peak = float(p.max())
    seen = np.where(np.isnan(scan), -1.0, np.minimum(scan, z_max) / z_max)
    scalars = [
        summary.entropy / max(summary.uniform_entropy, 1e-9),
        summary.mass,
        float(touched),
        (u[0] + u[2]) / np.pi,
        u[1],
    ]
    return {
        "belief": np.sqrt(np.clip(p / peak, 0.0, 1.0)).astype(np.float32),
        "map": map_view(belief.terrain(robot).grid, config.rows, config.cols).copy(),
        "scan": seen.astype(np.float32),
        "scalars": np.clip(scalars, -1.0, 1.0).astype(np.float32),
        **(view.draw(robot) if view is not None else {}),
    }
