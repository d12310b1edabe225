"""Exact rays on a large map, 25 m far: their cost, and how many are wrong."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from activeloc.benchmarks.clock import Call, alternate
from activeloc.benchmarks.floors import seconds_of_look_up
from activeloc.benchmarks.report import Curve, Row, at_most, ratio_at_most
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.worlds import Z_MAX, bearings, free_poses, large_map, local_poses
from activeloc.benchmarks.yardsticks import is_installed, named, nav2
from activeloc.benchmarks.yardsticks.crossings import count_wrong
from activeloc.benchmarks.yardsticks.traversal import Traversal
from activeloc.grid import OccupancyGrid
from activeloc.raycast import cast_scan

PLAIN = "cell by cell"


def measure(settings: Settings) -> Iterator[Row | Curve]:
    """Scans of a localized cloud and of poses anywhere; rays by their length; wrong rays."""
    grid = large_map(settings.maps)
    rays = settings.size(120_000, 2_400)
    for beams, poses, where in (
        (60, local_poses(grid, rays // 60), "localized"),
        (180, free_poses(grid, rays // 180), "anywhere"),
    ):
        yield from _scans(settings, grid, poses, beams, f"{beams} beams, {where}")
    yield from _by_length(settings, grid)
    yield _wrong(settings, grid)


def _casts(
    grid: OccupancyGrid, poses: NDArray[np.float64], angles: NDArray[np.float64], z_max: float
) -> dict[str, Call]:
    plain, reach = Traversal(grid), z_max / grid.resolution
    prepared, narrow = plain.prepared(poses), angles.astype(np.float32)
    return {
        "ours": lambda: cast_scan(grid, poses, angles, z_max),
        PLAIN: lambda: plain.cast(prepared, narrow, reach),
    }


def _scans(
    settings: Settings, grid: OccupancyGrid, poses: NDArray[np.float64], beams: int, name: str
) -> Iterator[Row]:
    angles = bearings(beams)
    calls = _casts(grid, poses, angles, Z_MAX)
    scan = cast_scan(grid, local_poses(grid, 1)[0], angles, Z_MAX)
    n_theirs = settings.size(2_000, 20)
    if is_installed(nav2.NAME):
        pose = local_poses(grid, 1)[0]
        calls[nav2.NAME] = nav2.update_of(grid, pose, angles, scan, n_theirs)
    seconds = alternate(calls, budget=settings.budget, rounds=settings.rounds)
    rays = {"ours": len(poses) * beams, PLAIN: len(poses) * beams, nav2.NAME: n_theirs * beams}
    ns = {what: 1e9 * values / rays[what] for what, values in seconds.items()}
    length = cast_scan(grid, poses, angles, Z_MAX).mean()
    note = f"{grid.name}, mean range {length:.1f} m"
    yield Row.of("rays", name, "ns", ns["ours"], PLAIN, ns[PLAIN], ratio_at_most(0.75), note)
    yield Row.of(
        "rays", name, "ns", ns["ours"], named(nav2.NAME, nav2.NAME), ns.get(nav2.NAME),
        ratio_at_most(0.55), "theirs: a whole update of a localized cloud, per beam",
    )  # fmt: skip


def _by_length(settings: Settings, grid: OccupancyGrid) -> Iterator[Curve]:
    """Cost of a ray by how far it may go."""
    angles, poses = bearings(60), free_poses(grid, settings.size(1_000, 20))
    lengths = (1.5, 3.0, 6.0, 12.0, 25.0)
    costs: dict[str, list[float]] = {"ours": [], PLAIN: []}
    for z_max in lengths:
        calls = _casts(grid, poses, angles, z_max)
        seconds = alternate(calls, budget=settings.budget / 5, rounds=settings.rounds)
        for what, values in seconds.items():
            costs[what].append(1e9 * float(np.median(values)) / (len(poses) * 60))
    axes = "rays", "longest range [m]", "a ray [ns]"
    yield Curve(*axes, "exact rays", lengths, tuple(costs["ours"]))
    yield Curve(*axes, PLAIN, lengths, tuple(costs[PLAIN]), "yardstick")
    floor = 1e9 * seconds_of_look_up(coherent=False)
    yield Curve(*axes, "a look-up of one number", lengths, (floor,) * len(lengths), "floor")


def _wrong(settings: Settings, grid: OccupancyGrid) -> Row:
    """Rays anywhere, and rays along axes and diagonals from the middles of cells."""
    n = settings.size(60, 3)
    free, reach = free_poses(grid, 2 * n, seed=1), Z_MAX / grid.resolution
    free[n:, :2] = grid.to_metres(np.floor(grid.to_cells(free[n:, :2])) + 0.5)
    free[n:, 2] = np.round(free[n:, 2] / (0.25 * np.pi)) * (0.25 * np.pi)
    angles = np.linspace(-np.pi, np.pi, 16, endpoint=False)
    ranges = cast_scan(grid, free, angles, Z_MAX) / grid.resolution
    in_cells = np.column_stack([grid.to_cells(free[:, :2]), free[:, 2]])
    wrong = count_wrong(grid.blocked, in_cells, angles, reach, ranges)
    note = f"of {ranges.size}, against every crossing with a grid line, sorted"
    return Row.of("rays", "wrong rays", "rays", float(wrong), target=at_most(0.0), note=note)
