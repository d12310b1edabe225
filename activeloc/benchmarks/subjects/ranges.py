"""Look-ups in the table of ranges, once it is filled."""

from __future__ import annotations

from collections.abc import Iterator

from activeloc.benchmarks.clock import alternate
from activeloc.benchmarks.report import Row, at_most
from activeloc.benchmarks.settings import Settings
from activeloc.benchmarks.worlds import Z_MAX, bearings, free_poses, large_map, local_poses
from activeloc.range_table import RangeTable
from activeloc.raycast import cast_scan


def measure(settings: Settings) -> Iterator[Row]:
    """Scans of a localized cloud, and of poses anywhere."""
    grid = large_map(settings.maps)
    table, angles = RangeTable(grid, Z_MAX), bearings(60)
    n = settings.size(8_333, 50)
    for name, poses, target in (
        ("coherent: 60 beams, localized", local_poses(grid, n), at_most(2.0)),
        ("60 beams, anywhere", free_poses(grid, n), None),
    ):
        calls = {
            "ours": lambda poses=poses: table.levels(poses, angles),
            "exact rays": lambda poses=poses: cast_scan(grid, poses[::10], angles, Z_MAX),
        }
        seconds = alternate(calls, budget=settings.budget, rounds=settings.rounds)
        ours = 1e9 * seconds["ours"] / (n * 60)
        exact = 1e9 * seconds["exact rays"] / (len(poses[::10]) * 60)
        note = f"{table.table.nbytes / 1e6:.0f} MB of table, filled where it is asked"
        yield Row.of("ranges", name, "ns", ours, "exact rays", exact, target, note)
