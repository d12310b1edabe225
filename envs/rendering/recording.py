"""An episode as plain arrays: what films, pages and galleries are made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.envs.rendering.draw import likely_poses
from activeloc.envs.rendering.ground import places_of, pooled, probabilities_of, shades_of
from activeloc.envs.rendering.scene import Scene, layout
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid

SLICE_SIDE = 80
"""Most cells along the longer side of a heading's slice."""


@dataclass(frozen=True, eq=False)
class Recording:
    """S moments of an episode: its start, and one after each step.

    Beliefs are kept as shades, a byte a cell on a scale of logarithms
    (:func:`activeloc.envs.rendering.ground.shades_of`): what a picture needs of them.

    Attributes:
        agent: Who played.
        outcome: How it ended: ``localized``, ``wrong and sure`` or ``not localized``.
        grid: The map.
        origin: x and y of the lower left corner of the belief's first cell [m].
        resolution: Side of the belief's cells [m].
        shades: ``(S, R, C)``; of the belief over places.
        slice_resolution: Side of the slices' cells [m].
        slices: ``(S, K, r, c)``; shades of the belief by heading; slice k is centred at
            ``-pi + 2 pi k / K``.
        headings: S arrays ``(M, 3)``; likely poses.
        particles: S arrays ``(N, 3)``; none if the belief is not made of them.
        poses: ``(S, 3)``; true x [m], y [m], theta [rad].
        estimates: ``(S, 3)``.
        scans: ``(S, B)`` [m].
        bearings: ``(B,)`` [rad].
        z_max: Longest range of a beam [m].
        radius: Of the robot [m]; None for one that is easy to see.
        entropy: ``(S,)`` [nat].
        entropy_fraction: ``(S,)``; of the uniform belief's.
        mass: ``(S,)``; probability near the estimate.
        error_m: ``(S,)``; distance of the estimate from the truth.
        error_rad: ``(S,)``; angle between them.
        actions: ``(S - 1, ...)``; what was done at each step.
        commands: S - 1 strings: the actions in words.
        captions: S strings: the state of the episode in words.
        carried_at: Moment at which somebody carried the robot off; None for never.
    """

    agent: str
    outcome: str
    grid: OccupancyGrid
    origin: tuple[float, float]
    resolution: float
    shades: NDArray[np.uint8]
    slice_resolution: float
    slices: NDArray[np.uint8]
    headings: tuple[NDArray[np.float64], ...]
    particles: tuple[NDArray[np.float32], ...]
    poses: NDArray[np.float64]
    estimates: NDArray[np.float64]
    scans: NDArray[np.float64]
    bearings: NDArray[np.float64]
    z_max: float
    radius: float | None
    entropy: NDArray[np.float64]
    entropy_fraction: NDArray[np.float64]
    mass: NDArray[np.float64]
    error_m: NDArray[np.float64]
    error_rad: NDArray[np.float64]
    actions: NDArray[Any]
    commands: tuple[str, ...]
    captions: tuple[str, ...]
    carried_at: int | None

    def __len__(self) -> int:
        """S, the number of moments."""
        return len(self.entropy)

    def scene(self, moment: int, with_agent: bool = False) -> Scene:
        """A moment, to be drawn as it was.

        Args:
            moment: Which one, from 0; after the last one the last one stays.
            with_agent: Whether the caption begins with the agent's name.
        """
        s = min(moment, len(self) - 1)
        n = places_of(self.grid, self.resolution)
        fractions = np.clip(self.entropy_fraction, 0.0, 1.0)
        return Scene(
            grid=self.grid,
            belief=probabilities_of(self.shades[s], n)[None],
            belief_resolution=self.resolution,
            belief_origin=self.origin,
            pose=self.poses[s],
            estimate=self.estimates[s],
            scan=self.scans[s],
            bearings=self.bearings,
            z_max=self.z_max,
            entropy=float(fractions[s]),
            history=fractions[:s].tolist(),
            step=s,
            caption=f"{self.agent}: {self.captions[s]}" if with_agent else self.captions[s],
            radius=self.radius,
            particles=self.particles[s] if self.particles else None,
            headings=self.headings[s],
        )


@dataclass(slots=True)
class Tape:
    """Takes an episode down, moment by moment."""

    scenes: list[Scene] = field(default_factory=list)
    shades: list[NDArray[np.uint8]] = field(default_factory=list)
    slices: list[NDArray[np.uint8]] = field(default_factory=list)
    headings: list[NDArray[np.float64]] = field(default_factory=list)
    infos: list[Mapping[str, Any]] = field(default_factory=list)
    actions: list[Any] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)
    origin: tuple[float, float] = (0.0, 0.0)

    def start(self, scene: Scene, info: Mapping[str, Any]) -> None:
        """Take down the start."""
        self._moment(scene, info)

    def step(self, scene: Scene, info: Mapping[str, Any], action: object, command: str) -> None:
        """Take down what an action has led to."""
        self.actions.append(np.array(action))
        self.commands.append(command)
        self._moment(scene, info)

    def _moment(self, scene: Scene, info: Mapping[str, Any]) -> None:
        rows, cols, self.origin = _on_the_map(scene)
        belief, resolution = np.asarray(scene.belief)[:, rows, cols], scene.belief_resolution
        self.shades.append(shades_of(belief.sum(axis=0), places_of(scene.grid, resolution)))
        pool = ceil(max(belief.shape[1:]) / SLICE_SIDE)
        slices = heading_slices(pooled(belief, pool))
        n = len(slices) * places_of(scene.grid, pool * resolution)
        self.slices.append(shades_of(slices, n))
        self.headings.append(likely_poses(scene, layout(scene.grid)))
        self.infos.append(info)
        # The belief is what is large, and it has just been kept.
        self.scenes.append(_without_belief(scene))

    def recording(self, agent: str) -> Recording:
        """What has been taken down so far.

        Args:
            agent: Who played.

        Raises:
            ConfigError: If nothing has been.
        """
        if not self.scenes:
            raise ConfigError("nothing has been recorded: reset() the environment first")
        first, last = self.scenes[0], self.infos[-1]
        assert first.bearings is not None
        carried = [bool(info.get("kidnapped", False)) for info in self.infos]
        return Recording(
            agent=agent,
            outcome=outcome_of(last),
            grid=first.grid,
            origin=self.origin,
            resolution=first.belief_resolution,
            shades=np.array(self.shades),
            slice_resolution=first.belief_resolution * ceil(max(self.shades[0].shape) / SLICE_SIDE),
            slices=np.array(self.slices),
            headings=tuple(self.headings),
            particles=tuple(
                np.asarray(scene.particles, dtype=np.float32)
                for scene in self.scenes
                if scene.particles is not None
            ),
            poses=np.array([scene.pose for scene in self.scenes]),
            estimates=np.array([scene.estimate for scene in self.scenes]),
            scans=np.array([scene.scan for scene in self.scenes]),
            bearings=np.asarray(first.bearings, dtype=np.float64),
            z_max=first.z_max,
            radius=first.radius,
            entropy=_column(self.infos, "entropy"),
            entropy_fraction=_column(self.infos, "entropy_fraction"),
            mass=_column(self.infos, "mass"),
            error_m=_column(self.infos, "error_m"),
            error_rad=_column(self.infos, "error_rad"),
            actions=np.array(self.actions),
            commands=tuple(self.commands),
            captions=tuple(scene.caption for scene in self.scenes),
            carried_at=carried.index(True) if any(carried) else None,
        )


def outcome_of(info: Mapping[str, Any]) -> str:
    """How an episode that ended with this ``info`` ended, in words."""
    if info["is_success"]:
        return "localized"
    return "wrong and sure" if info["wrong"] else "not localized"


def heading_slices(belief: NDArray[np.floating]) -> NDArray[np.floating]:
    """The belief ``(T, R, C)`` summed over K sectors of headings: ``(K, R, C)``.

    K is 8, 4 or 1, the largest that bins can be shared out among fairly. Sector k is centred at
    ``-pi + 2 pi k / K``, so that the directions of the map's axes are in the middle of one.
    """
    bins = len(belief)
    sectors = next(k for k in (8, 4, 1) if bins % k == 0 and (bins > k or k == 1))
    halves = np.roll(np.repeat(0.5 * belief, 2, axis=0), bins // sectors, axis=0)
    result: NDArray[np.floating] = halves.reshape(sectors, -1, *belief.shape[1:]).sum(axis=1)
    return result


def _on_the_map(scene: Scene) -> tuple[slice, slice, tuple[float, float]]:
    """Rows and columns of the belief on the map and one beyond, and the first one's corner [m].

    The one beyond is what the edge is blended with when it is drawn.
    """
    side, (left, bottom) = scene.belief_resolution, scene.belief_origin
    x_min, x_max, y_min, y_max = scene.grid.extent
    rows, cols = (
        slice(max(0, floor((low - start) / side + 1e-6) - 1), ceil((high - start) / side) + 1)
        for low, high, start in ((y_min, y_max, bottom), (x_min, x_max, left))
    )
    return rows, cols, (left + cols.start * side, bottom + rows.start * side)


def _without_belief(scene: Scene) -> Scene:
    parts = {name: getattr(scene, name) for name in scene.__dataclass_fields__}
    return Scene(**{**parts, "belief": np.zeros((1, 1, 1)), "history": ()})


def _column(infos: Sequence[Mapping[str, Any]], name: str) -> NDArray[np.float64]:
    return np.array([info[name] for info in infos], dtype=np.float64)
