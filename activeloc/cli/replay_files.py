"""What ``activeloc localize`` writes: a table, a summary, two pictures."""

from __future__ import annotations

import csv
import io
import json
import platform
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from importlib.util import find_spec
from math import degrees, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from activeloc.files import write_atomically

if TYPE_CHECKING:
    from activeloc.replay import Row, Run

FILES = ("trajectory.csv", "summary.json", "path.png", "error.png")
_COLUMNS = ("scan", "time", "x", "y", "theta", "entropy", "error_m", "error_rad")


def write_files(run: Run, folder: Path, command: Sequence[str]) -> None:
    """Write a run into a folder, each file whole or not at all; what is there is replaced.

    Raises:
        OSError: If the folder cannot be made or written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    write_atomically(folder / "trajectory.csv", trajectory_csv(run.rows))
    if find_spec("matplotlib") is not None:
        _draw(run, folder)
    # Last: a folder with a summary is complete.
    write_atomically(folder / "summary.json", summary_json(run, command))


def trajectory_csv(rows: Sequence[Row]) -> bytes:
    """A row for each scan; numbers as short as they can be and still be read back exactly."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for row in rows:
        x, y, theta = row.estimate.tolist()
        writer.writerow(
            [row.scan, repr(row.time), x, y, theta, row.entropy, row.error_m, row.error_rad]
        )
    return text.getvalue().encode()


def summary_json(run: Run, command: Sequence[str]) -> bytes:
    """Settings, score, timings and what it was made with."""
    import activeloc
    from activeloc.replay import RULE

    prepared, score = run.prepared, run.score
    summary: dict[str, Any] = {
        "command": shlex.join(command),
        "recording": prepared.recording.name,
        "map": {"name": prepared.grid.name, "sha256": prepared.grid.digest},
        "seed": run.seed,
        "scans": len(run.rows),
        "first_scan": run.rows[0].scan,
        "last_scan": run.rows[-1].scan,
        "set_down_at_scan": run.carried_to,
        "carried_m": run.carried_m,
        "settings": {
            "belief_kind": type(prepared.config.belief).__name__,
            "sensor_kind": type(prepared.sensor).__name__,
            **_plain(asdict(prepared.config)),
            "sensor": _plain(asdict(prepared.sensor)),
        },
        "rule": RULE,
        "right": score.right,
        "median_error_m": score.median_m,
        "median_error_deg": degrees(score.median_rad),
        "scans_to_localize": score.localized_at,
        "scans_to_recover": None if run.recovery is None else run.recovery.localized_at,
        "reference_on_open_ground": prepared.on_open_ground(),
        "recorded_seconds": prepared.recording.seconds,
        "seconds": run.seconds[0],
        "processor_seconds": run.seconds[1],
        "times_faster_than_recorded": run.times_faster,
        "versions": {
            "python": platform.python_version(),
            "activeloc": activeloc.__version__,
            **{name: metadata.version(name) for name in ("numpy", "scipy", "numba")},
        },
    }
    return (json.dumps(summary, indent=2, allow_nan=False) + "\n").encode()


def _plain(settings: dict[str, Any]) -> dict[str, Any]:
    """The settings without infinities, which JSON does not have."""
    plain: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, dict):
            plain[name] = _plain(value)
        else:
            infinite = isinstance(value, float) and not isfinite(value)
            plain[name] = str(value) if infinite else value
    return plain


def _draw(run: Run, folder: Path) -> None:
    from activeloc import plots
    from activeloc.replay import NEAR_M, NEAR_RAD

    grid, rows = run.prepared.grid, run.rows
    scans = np.array([row.scan for row in rows])
    plots.plot_paths(
        grid.cells,
        grid.extent,
        scans,
        np.array([row.estimate for row in rows]),
        run.prepared.recording.reference,
        np.array([row.is_near for row in rows]),
        folder / "path.png",
    )
    errors = {
        "error [m]": (np.array([row.error_m for row in rows]), NEAR_M),
        "error [deg]": (np.rad2deg([row.error_rad for row in rows]), degrees(NEAR_RAD)),
    }
    plots.plot_errors(
        scans,
        errors,
        np.array([row.entropy for row in rows]),
        folder / "error.png",
    )
