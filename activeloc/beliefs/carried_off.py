"""Where a robot may be that is not where its particles are.

A robot may be carried off, or its particles may have lost it. The belief reckons with both: at each
step it leaks a little of its mass to every place there is. Spread over a whole map, that mass would
take as many particles as a robot that knows nothing. So it is followed in two ways:

*Newcomers.* A few particles of each leak, drawn by the scan, join the cloud behind those that are
kept. They move and are weighed like all others, and what they weigh together is the probability of
having been carried off. They are enough to raise suspicion, and too few to say where the robot is:
among like places a few lucky ones decide.

*Looking back.* Once that probability reaches ``widen``, the last steps
(:mod:`~activeloc.beliefs.particle_past`) are gone through again for the leaks alone, with as many
particles as a robot takes that knows nothing. They take the newcomers' place, and are as many as
their own spread asks for until they hold half of the belief, and the cloud is one again, or next to
nothing.

Both are Bayes' rule for a uniform leak, but for what leaked before the steps that are remembered,
which is taken to be uniform still.
"""

from __future__ import annotations

from math import exp, inf, log, log1p

import numpy as np
from numpy.typing import NDArray

from activeloc.beliefs.cloud import Cloud, spread_poses
from activeloc.beliefs.monte_carlo import MonteCarlo
from activeloc.beliefs.particle_past import Counted, Past
from activeloc.beliefs.redrawing import resample
from activeloc.beliefs.resampling import comb

TRIED_PER_NEWCOMER = 20
"""Poses that are weighed for each one that joins."""
FOUND = 0.5
"""Probability of having been carried off at which nobody asks any more."""
GIVEN_UP = 0.25
"""Share of ``widen`` under which it is no longer looked for everywhere."""


def take_in(
    model: MonteCarlo, cloud: Cloud, scan: Counted, log_w: NDArray[np.float64]
) -> tuple[float, float]:
    """Give the particles their weights after a scan, and let newcomers join them.

    Args:
        model: Of the filter.
        cloud: The particles, as they were before the scan; kept if nothing explains it.
        scan: What was read.
        log_w: ``(N,)``; their weights after it, on the cloud's scale. Overwritten.

    Returns:
        The scan's log-evidence, and what it would be if nobody could be carried off; -inf if
        nothing explains it.
    """
    cloud.normalised()
    before, poses, log_new, log_stay = cloud.log_total, np.empty((0, 3)), -inf, 0.0
    top = float(log_w.max())
    w = np.exp(log_w - top) if top > -inf else np.zeros_like(log_w)
    kept, everyone = float(w[: cloud.n_kept].sum()), float(w.sum())
    if model.leak > 0.0:
        log_stay = log1p(-model.leak) if model.leak < 1.0 else -inf
        for tried in (model.config.n_elsewhere, model.config.n_start):
            poses, log_new = newcomers(model, cloud, scan, tried)
            if len(poses) or top + log_stay > -inf:
                break
        log_new += before
    stayed, peak = top + log(everyone) - before if everyone else -inf, max(top + log_stay, log_new)
    if peak == -inf:
        return -inf, stayed
    if model.leak > 0.0:
        cloud.past.read(scan, top + log_stay + log(kept) if kept else -inf)
    w *= exp(top + log_stay - peak)
    log_w += log_stay
    n = len(poses)
    if n:
        cloud.poses = np.concatenate([cloud.poses, poses])
        w = np.concatenate([w, np.full(n, exp(log_new - peak))])
        log_w = np.concatenate([log_w, np.full(n, log_new)])
    cloud.weigh(log_w, w, peak)
    return cloud.log_total - before, stayed


def newcomers(
    model: MonteCarlo, cloud: Cloud, scan: Counted, tried: int
) -> tuple[NDArray[np.float64], float]:
    """Where a robot may just have been carried ``(n, 3)``, and the logarithm of each one's weight.

    What leaks out of a belief of mass one is spread over the open ground and weighed by the scan,
    and what is left of it is drawn as a few particles of equal weight.

    Args:
        model: Of the filter.
        cloud: Whose map and source of noise are used.
        scan: What was read.
        tried: Poses that are weighed.
    """
    poses = spread_poses(cloud.ground.terrain, tried, cloud.rng)
    log_p = np.zeros(tried)
    model.weigh(cloud, poses, scan, log_p)
    top = float(log_p.max())
    if top == -inf:
        return np.empty((0, 3)), -inf
    wheel = np.exp(log_p - top).cumsum()
    n = max(1, tried // TRIED_PER_NEWCOMER)
    log_each = log(model.leak) + top + log(wheel[-1] / tried) - log(n)
    return poses[comb(wheel, n, cloud.rng.random())], log_each


def search(model: MonteCarlo, cloud: Cloud) -> None:
    """Begin to look for the robot everywhere, or stop it, as its chance of being elsewhere says.

    Args:
        model: Of the filter.
        cloud: The particles, after a scan; drawn anew where they must be.
    """
    w = cloud.elsewhere
    if not cloud.searching and w >= model.config.widen and not cloud.past.motions:
        look_back(model, cloud)
        w = cloud.elsewhere
    found = cloud.searching and w >= FOUND
    if found:
        cloud.n_kept, cloud.past, cloud.searching = len(cloud.poses), Past(), False
    elif cloud.searching and w < GIVEN_UP * model.config.widen:
        cloud.searching = False
    resample(model.config, cloud, always=found)


def look_back(model: MonteCarlo, cloud: Cloud) -> None:
    """Go through the past again for what leaked.

    Args:
        model: Of the filter.
        cloud: The particles; its newcomers are given up for those that are found.
    """
    found, w = _found(model, cloud)
    kept = cloud.normalised()[: cloud.n_kept]
    scale = (1.0 - w) / kept.sum() if kept.any() else 0.0
    with np.errstate(divide="ignore"):
        log_w = np.log(np.append(kept * scale, found.normalised() * w))
    cloud.join(found.poses, log_w, cloud.n_kept)
    cloud.past, cloud.searching = Past(), True
    cloud.noticed += 1
    cloud.place.clear()


def _found(model: MonteCarlo, cloud: Cloud) -> tuple[Cloud, float]:
    """Where a robot is that was carried off in the past, and the probability that it was."""
    n = model.config.n_start
    found = cloud.of(spread_poses(cloud.ground.terrain, n, cloud.rng), np.full(n, -np.log(n)))
    with np.errstate(divide="ignore"):
        log_found, log_kept = np.log(cloud.past.steps[0].w), np.log1p(-cloud.past.steps[0].w)
        stay = np.log1p(-model.leak)
    for step in cloud.past.steps:
        for u, contact in step.motions:
            model.move(found, u, contact)
        log_w = found.log_w.copy()
        model.weigh(found, found.poses, step.scan, log_w)
        poses, log_new = newcomers(model, found, step.scan, n // 4)
        both = np.logaddexp(log_kept, log_found)
        log_w = np.append(log_w + (log_found + stay), np.full(len(poses), log_new + both))
        if log_w.max() == -inf:  # An impossible scan is no evidence.
            continue
        found.join(poses, log_w)
        found.n_kept = len(found.poses)
        found.normalised()
        log_found, log_kept = found.log_total, log_kept + step.log_kept
        found.log_w -= log_found
        found.log_total = 0.0
        resample(model.config, found)
    return found, float(1.0 / (1.0 + np.exp(np.clip(log_kept - log_found, -700.0, 700.0))))
