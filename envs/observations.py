"""What a policy sees: the belief, the map, the scan and a few scalars, of one shape for any map.

The *world view* sums the belief on ``(headings, rows, cols)`` over the smallest square around the
map, channels first, and averages the map over the same pixels. A probability spread over half a
million states is invisible to a network, so the view shows ``sqrt(p / max p)``: in [0, 1], equal to
one at its peak, and able to show a hundredth of it as a tenth.

The *egocentric view* (:mod:`activeloc.beliefs.metric_view`) shows what may be around the robot. It
depends neither on the map's size nor on where north is; it is left out unless it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs import Belief, Summary
from activeloc.beliefs.view import map_view, show

if TYPE_CHECKING:
    from activeloc.beliefs.metric_view import MetricView

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
            from activeloc.beliefs.metric_view import PLACE, PLANES, WAYS

            side = 2 * self.radius + 1
            shapes = {"view": (PLANES, side, side), "ways": WAYS, "place": PLACE}
            for name, part in shapes.items():
                spaces[name] = gym.spaces.Box(0.0, 1.0, part, np.float32)
        return gym.spaces.Dict(spaces)


def observe(
    config: ObservationConfig,
    belief: Belief,
    robots: NDArray[np.intp],
    summaries: Sequence[Summary],
    scans: NDArray[np.float64],
    z_max: float,
    u: NDArray[np.float64],
    touched: NDArray[np.bool_],
    view: MetricView | None = None,
) -> dict[str, NDArray[Any]]:
    """The observations of some robots: new arrays of float32 with a leading axis of n.

    Args:
        config: Resolution.
        belief: Whose view is drawn.
        robots: ``(n,)``; which.
        summaries: What their beliefs say in short.
        scans: ``(n, B)`` [m].
        z_max: Longest range of the sensor [m].
        u: ``(n, 3)`` last odometry readings.
        touched: ``(n,)``; whether the last motion was stopped by an obstacle.
        view: Draws the egocentric view; None to leave it out.

    Returns:
        ``belief`` ``(n, headings, rows, cols)``: sqrt(p / max p). ``map`` ``(n, rows, cols)``:
        share of free ground. ``scan`` ``(n, B)``: range over ``z_max``, -1 for no reading.
        ``scalars`` ``(n, 5)``: the entropy as a fraction of the uniform's, the mass near the
        estimate, whether the robot touched something, how far it turned [half turns] and travelled
        [m, cut to 1]. ``view`` ``(n, 5, s, s)``, ``ways`` ``(n, 2, 12, 9)`` and ``place``
        ``(n, 24)``: see :mod:`activeloc.beliefs.metric_view`.
    """
    n, shape = len(robots), (config.rows, config.cols)
    beliefs = np.empty((n, config.headings, *shape), dtype=np.float32)
    maps = np.empty((n, *shape), dtype=np.float32)
    for i, robot in enumerate(robots.tolist()):
        p = belief.view(robot, config.headings, *shape)
        show(p.reshape(-1), float(p.max()), beliefs[i].reshape(-1))
        maps[i] = map_view(belief.terrain(robot).grid, *shape)
    seen = np.where(np.isnan(scans), -1.0, np.minimum(scans, z_max) / z_max)
    rows = zip(summaries, touched.tolist(), u.tolist(), strict=True)
    result: dict[str, NDArray[Any]] = {
        "belief": beliefs,
        "map": maps,
        "scan": seen.astype(np.float32),
        "scalars": np.array([_scalars(*row) for row in rows], dtype=np.float32),
    }
    if view is not None:
        drawn = [view.draw(robot) for robot in robots.tolist()]
        result |= {name: np.stack([one[name] for one in drawn]) for name in drawn[0]}
    return result


def _scalars(summary: Summary, touched: bool, u: list[float]) -> list[float]:
    """One robot's ``SCALARS``, each cut to [-1, 1]."""
    share = summary.entropy / max(summary.uniform_entropy, 1e-9)
    given = (share, summary.mass, float(touched), (u[0] + u[2]) / np.pi, u[1])
    return [min(max(value, -1.0), 1.0) for value in given]
