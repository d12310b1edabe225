"""Drawing a cloud of particles anew: when, how many, and which of them survive.

*Probabilistic Robotics* (2005), sections 4.3.4 and 8.3.7. The particles that are kept and the
others (:mod:`activeloc.beliefs.carried_off`) are drawn each among themselves, and keep what they
weigh together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from activeloc.beliefs.cloud import Cloud
from activeloc.beliefs.particle_bins import allocate, empty_slots, merge, roughen, shares
from activeloc.beliefs.particle_motion import NORMALS, noise
from activeloc.beliefs.resampling import SCHEMES, comb
from activeloc.beliefs.sample_size import draw_until
from activeloc.beliefs.settings import ParticleConfig


@dataclass(frozen=True, slots=True)
class Redrawn:
    """What becomes of a part of a cloud.

    Attributes:
        held: ``(n,)``; common bins that hold particles of it.
        masses: ``(n,)``; what they weigh there.
        weights: ``(N,)``; of those that come out of it.
        chosen: ``(N,)``; whose copies they are; None if it is left alone.
        noise: ``(N, 3)``; by which the copies differ; None for none of them.
    """

    held: NDArray[np.int32]
    masses: NDArray[np.float64]
    weights: NDArray[np.float64]
    chosen: NDArray[np.intp] | None = None
    noise: NDArray[np.uint16] | None = None

    @property
    def redrawn(self) -> bool:
        """Whether it is not left alone."""
        return self.chosen is not None


def resample(config: ParticleConfig, cloud: Cloud, always: bool = False) -> None:
    """Draw the particles anew by their weights, as many as the belief needs.

    With an ``allocation`` a under one, a bin that holds mass m gets particles in proportion to
    m^a instead of m, and they keep weights in proportion to m^(1 - a): an unlikely place is
    followed by more of them than its share, so that its evidence is known better and the truth
    does not die out among like places. The belief is the same.

    Args:
        config: Settings.
        cloud: The particles.
        always: Whether to draw even if the effective sample size is large.
    """
    parts = [_redraw(config, cloud, part, always) for part in cloud.parts]
    held = np.concatenate([part.held for part in parts])
    masses = np.concatenate([part.masses for part in parts])
    n = merge(held, masses, empty_slots(len(cloud.ground.bins)))
    cloud.masses = held[:n], masses[:n]
    if not any(part.redrawn for part in parts):
        return
    # Those that are kept seldom change; the others are drawn anew at almost every step.
    first = 0 if parts[0].redrawn else len(parts[0].weights)
    behind = list(zip(cloud.parts, parts, strict=True))[first > 0 :]
    weights = np.concatenate([part.weights for _, part in behind])
    poses, n = np.empty((len(weights), 3)), 0
    for given, part in behind:
        out = poses[n : n + len(part.weights)]
        _copy(config, cloud, cloud.poses[given], part, out)
        n += len(out)
    cloud.n_kept = len(parts[0].weights)
    cloud.follow(first, poses, weights)


def _redraw(config: ParticleConfig, cloud: Cloud, part: slice, always: bool) -> Redrawn:
    """What becomes of a part of the cloud.

    Args:
        config: Settings.
        cloud: The particles.
        part: Which of them.
        always: Whether to draw even if the effective sample size is large.
    """
    weights = cloud.normalised()[part]
    held, masses, index = cloud.bin(part)
    wheel, factor, n = np.empty(len(weights)), np.empty(len(masses)), len(weights)
    mass, squares, states = allocate(weights, index, masses, config.allocation, factor, wheel)
    if mass == 0.0:
        return Redrawn(held, masses, np.empty(0), np.empty(0, dtype=np.intp))
    most = config.n_max
    if part.start > 0 and not cloud.searching:
        most = min(most, config.n_elsewhere)
    even = wheel[-1] ** 2 >= config.ess_ratio * n * squares
    if not always and even and n <= 2 * most:
        return Redrawn(held, masses, weights)
    chosen = _choose(config, cloud, cloud.poses[part], wheel, states, most)
    w = np.empty(len(chosen))
    shares(chosen, index, factor, mass, w)
    return Redrawn(held, masses, w, chosen, noise(cloud.rng, len(chosen), 3))


def _copy(
    config: ParticleConfig,
    cloud: Cloud,
    poses: NDArray[np.float64],
    part: Redrawn,
    out: NDArray[np.float64],
) -> None:
    """Fill ``out (n, 3)`` with the survivors among a part's poses ``(N, 3)``."""
    ground = cloud.ground
    if part.chosen is None:
        out[:] = poses
    elif part.noise is not None:
        roughen(
            ground.terrain.open, ground.frame, poses, part.chosen, part.noise, NORMALS,
            config.roughening_xy, config.roughening_theta, out,
        )  # fmt: skip


def _choose(
    config: ParticleConfig,
    cloud: Cloud,
    poses: NDArray[np.float64],
    wheel: NDArray[np.float64],
    states: float,
    most: int,
) -> NDArray[np.intp]:
    """Indices of the survivors, by cumulative weights; ``most`` bounds their number."""
    least = min(config.n_min, most)
    if config.sizing == "kld":
        bins = cloud.ground.kld_bins
        out = np.empty(most, dtype=np.intp)
        n = draw_until(
            wheel, bins.index(poses), cloud.rng.random(most),
            float(ndtri(config.kld_confidence)), config.kld_error, least,
            np.zeros(len(bins), dtype=np.bool_), out,
        )  # fmt: skip
        return out[:n]
    n = int(min(max(config.per_state * states, least), most))
    if config.resampling == "systematic":
        return comb(wheel, n, cloud.rng.random())
    return SCHEMES[config.resampling](np.diff(wheel, prepend=0.0), n, cloud.rng.random(n))
