"""The distance filter: readings too short for the belief are somebody in the way.

Fox, Burgard & Thrun, "Markov localization for mobile robots in dynamic environments", JAIR 11
(1999), section 3.3.2. People who are on no map can only shorten a beam. A reading z is therefore
left out when it is shorter than the mapped obstacles explain with more than a probability gamma::

    P_short(z | x) = P(a hit reads more than z | x, m)
    P_short(z)     = sum_x P_short(z | x) bel_bar(x)      left out if > gamma, 0.99 in the paper

The probability is of *hits* alone: a model that allows for early readings would explain a person
away and keep the reading. Readings longer than expected are kept, so that a belief in the wrong
place is still corrected; a belief that has no idea (global localization) leaves little out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from activeloc import checks
from activeloc.beliefs import Belief
from activeloc.sensors import RangeSensor
from activeloc.sensors.readings import check_scan, expected_range, rays_of

POSES = 500  # Drawn from the belief for one scan.


def p_short(
    z: NDArray[np.float64], z_expected: NDArray[np.float64], sigma: float, z_max: float
) -> NDArray[np.float64]:
    """P_short(z | z*): a hit's probability to read more than z; the arguments broadcast.

    A hit is a Gaussian around z*, cut to ``[0, z_max)`` and normalised; it reads ``z_max`` where
    nothing is in range (z* >= z_max). NaN gives NaN.

    Args:
        z: Readings [m].
        z_expected: Ranges that the map gives [m].
        sigma: Standard deviation of a hit [m]; 0 for an exact sensor.
        z_max: Longest range reported [m].
    """
    sigma = max(sigma, 1e-9)
    low, high = -z_expected / sigma, (z_max - z_expected) / sigma
    # Upper tails, so that a reading far too short does not round to a probability of one less.
    kept = ndtr(-low) - ndtr(-high)
    with np.errstate(invalid="ignore", divide="ignore"):
        hit = (ndtr(-(z - z_expected) / sigma) - ndtr(-high)) / kept
    short = np.where(z_expected >= z_max, np.where(np.isnan(z), np.nan, 1.0), np.clip(hit, 0, 1))
    result: NDArray[np.float64] = np.where(z >= z_max, 0.0, short)
    return result


def drop_novel(
    belief: Belief,
    robot: int,
    sensor: RangeSensor,
    scan: NDArray[np.float64],
    gamma: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """The scan without the readings that are too short for the belief: those are NaN.

    Args:
        belief: After ``predict``, before ``correct``; it is not changed.
        robot: Whose belief and scan it is.
        sensor: The sensor that the filter assumes, at its true width.
        scan: ``(B,)`` [m].
        gamma: Probability above which a reading is left out; 0 leaves the scan as it is, and
            1 leaves nothing out.
        rng: Source of the poses that stand for the belief; nothing is drawn where gamma is 0.

    Raises:
        ConfigError: If gamma is no probability.
        ScanError: If the scan is not one of the sensor's.
    """
    checks.number("novelty", gamma, 0.0, 1.0)
    z = check_scan(scan, sensor)
    if gamma == 0.0:
        return z
    poses = belief.sample(robot, POSES, rng)
    expected = expected_range(sensor, belief.terrain(robot).grid, rays_of(poses, sensor.bearings))
    given: Any = sensor
    sigma = float(getattr(given, "sigma_hit", 0.0))
    novel = p_short(z, expected, sigma, sensor.z_max).mean(axis=0) > gamma
    return np.where(novel, np.nan, z)
