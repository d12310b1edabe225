"""Labelled observations: put in order, cut into minibatches, seen in a mirror."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc.agents.commands import LEFT, RIGHT
from activeloc.agents.sb3.vec_env import Observation
from activeloc.beliefs.metric_view import BEARINGS
from activeloc.envs.observations import SCALARS
from activeloc.errors import ConfigError

Floats = NDArray[np.float32]

_METRIC = ("ways", "place", "scan", "scalars")


@dataclass(frozen=True)
class Batch:
    """Labelled observations.

    Attributes:
        observations: Each ``(N, ...)``.
        values: ``(N, A)`` action values; their differences count.
        weights: ``(N,)`` of each row in the loss.

    Raises:
        ConfigError: If lengths differ, or a row has no action that may be taken.
    """

    observations: Observation
    values: Floats
    weights: Floats

    def __post_init__(self) -> None:
        lengths = {len(part) for part in (*self.observations.values(), self.values, self.weights)}
        if len(lengths) != 1 or self.values.ndim != 2:
            raise ConfigError(f"a batch's parts must have one length; got {sorted(lengths)}")
        if np.isnan(self.values).any() or not np.isfinite(self.values.max(axis=1)).all():
            raise ConfigError("action values must not be NaN, and one in each row finite")


def shuffled(
    held: Sequence[Batch], batch_size: int, epochs: int, rng: np.random.Generator
) -> Iterator[Batch]:
    """All rows in a new order for each epoch, cut into minibatches."""
    keys = held[0].observations.keys() if held else ()
    observations = {key: np.concatenate([b.observations[key] for b in held]) for key in keys}
    values = np.concatenate([batch.values for batch in held])
    weights = np.concatenate([batch.weights for batch in held])
    for _ in range(epochs):
        order = rng.permutation(len(values))
        for start in range(0, len(order), batch_size):
            rows = order[start : start + batch_size]
            parts = {key: array[rows] for key, array in observations.items()}
            yield Batch(parts, values[rows], weights[rows])


def can_mirror(batch: Batch) -> bool:
    """Whether a batch is of what is seen from the robot alone, with turns to both sides."""
    extra = set(batch.observations) - {"view", "depth", "time", *_METRIC}
    return "view" in batch.observations and not extra and batch.values.shape[1] >= 2


def mirrored(batch: Batch) -> Batch:
    """The same seen in a mirror: left and right are swapped, in the view and among the actions.

    The view ``(N, 5, rows, cols)`` looks along its rows: columns go from left to right. Its planes
    2 and 4 are for a robot turned to the left and to the right. On a metric map, bearings count
    from ahead to the left, beams from right to left.
    """
    observations = dict(batch.observations)
    if "ways" in observations:
        other_side = -np.arange(BEARINGS) % BEARINGS
        observations["ways"] = observations["ways"][:, :, other_side]
        halves = observations["place"].reshape(-1, 2, BEARINGS)[:, :, other_side]
        observations["place"] = halves.reshape(observations["place"].shape)
        observations["scan"] = observations["scan"][:, ::-1]
        turned = np.array([-1.0 if name == "turned" else 1.0 for name in SCALARS], dtype=np.float32)
        observations["scalars"] = observations["scalars"] * turned
    planes = observations["view"][:, [0, 1, 4, 3, 2]]
    observations["view"] = planes[..., ::-1]
    observations = {key: np.ascontiguousarray(part) for key, part in observations.items()}
    order = np.arange(batch.values.shape[1])
    order[[LEFT, RIGHT]] = RIGHT, LEFT
    return Batch(observations, batch.values[:, order], batch.weights)
