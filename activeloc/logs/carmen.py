"""Recorded runs: what a real robot's laser and wheels said, read from CARMEN logs.

A log is text, a message a line: a name, its fields, then the time at which it was sent, the host
and the time at which it was written. Read are

=============== ==================================================================================
``FLASER``      n, n ranges, laser pose x y theta, odometry x y theta
``ROBOTLASER1`` laser type, first angle, field of view, angle between beams, longest range,
                accuracy, remission mode, n, n ranges, m, m remissions, laser pose, robot pose,
                tv, rv, two safety distances, turn axis; older ones lack m, the remissions and
                the axis
``RLASER``      as ``FLASER``; looks backwards: checked, not used
``ODOM``        x y theta tv rv acceleration: checked, not used (each scan has its own odometry)
``PARAM``       a name and a value: checked, not used
=============== ==================================================================================

Comments (``#``) and CARMEN's other messages are skipped, unknown words refused. The robot's pose
(second in a laser line) is the raw wheel odometry; the laser's pose (first) is the reference where
a SLAM program has corrected it. A filter estimates the pose of the laser, as if it sat at the
centre of the robot: an offset of a few centimetres is lost in the noise of the odometry.

Source: CARMEN's logger (carmen.sourceforge.net/logger_playback.html).
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from activeloc import checks
from activeloc.errors import ActiveLocError, LogError
from activeloc.logs.messages import LaserLine, message
from activeloc.logs.recording import Recording

MAX_BYTES = 1 << 30
MAX_LINE = 1 << 17


def read_log(path: str | os.PathLike[str], max_range: float | None = None) -> Recording:
    """Read a CARMEN log: its ``FLASER`` lines or, if it has none, its ``ROBOTLASER1`` lines.

    Ranges at or above the laser's longest become +inf. That is 80 m for ``FLASER``; a
    ``ROBOTLASER1`` line says its own.

    Args:
        path: Of the log.
        max_range: The laser's longest range, in place of those [m].

    Raises:
        LogError: With file and line, if the file cannot be read, is no log, or a line is damaged.
        ConfigError: If ``max_range`` is not positive.
    """
    path = Path(path)
    if max_range is not None:
        checks.number("max_range", max_range, 0.0, 1e4, above_low=True)
    found: dict[str, list[LaserLine]] = {"FLASER": [], "ROBOTLASER1": []}
    n_rear = 0
    for number, line in _lines(path):
        try:
            name, scan = message(line, max_range)
            if scan is not None:
                _check_next(found[name], scan)
                found[name].append(scan)
            n_rear += name == "RLASER"
        except ActiveLocError as error:
            raise LogError(f"{path}:{number}: {error}") from None
    scans = found["FLASER"] or found["ROBOTLASER1"]
    if not scans:
        rear = f" ({n_rear} RLASER lines look backwards)" if n_rear else ""
        raise LogError(f"{path}: no FLASER or ROBOTLASER1 line{rear}; expected a CARMEN log")
    first, step = scans[0].bearings
    return Recording(
        scans=np.array([scan.ranges for scan in scans]),
        bearings=first + step * np.arange(len(scans[0].ranges), dtype=np.float64),
        reference=np.array([scan.laser for scan in scans]),
        odometry=np.array([scan.robot for scan in scans]),
        times=np.array([scan.time for scan in scans]),
        name=path.stem,
    )


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of each line that says something.

    Raises:
        LogError: If the file cannot be read, is too large, or a line is too long or no text.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise LogError(f"{path}: a log must be a regular file")
        if status.st_size > MAX_BYTES:
            raise LogError(f"{path}: {status.st_size} bytes; at most {MAX_BYTES} are allowed")
        with path.open("rb") as file:
            number = 0
            while raw := file.readline(MAX_LINE + 1):
                number += 1
                if len(raw) > MAX_LINE:
                    raise LogError(f"{path}:{number}: line is longer than {MAX_LINE} bytes")
                text = _text(raw, path, number)
                if text and not text.startswith("#"):
                    yield number, text
    except OSError as error:
        raise LogError(f"{path}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        if isinstance(error, LogError):
            raise
        raise LogError(f"{str(path)!r}: cannot read: {error}") from None


def _text(raw: bytes, path: Path, number: int) -> str:
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        raise LogError(f"{path}:{number}: not UTF-8 text; expected a CARMEN log") from None
    text = text.strip()
    if any(ord(letter) < 32 and letter != "\t" for letter in text):
        raise LogError(f"{path}:{number}: control characters; expected a CARMEN log, as text")
    return text


def _check_next(scans: list[LaserLine], scan: LaserLine) -> None:
    """Refuse a scan that cannot follow those before.

    Raises:
        LogError: If its beams are others, or it was taken before them.
    """
    if not scans:
        return
    n, before = len(scan.ranges), len(scans[-1].ranges)
    if n != before or not np.allclose(scan.bearings, scans[-1].bearings, atol=1e-6):
        raise LogError(f"{n} beams at other angles than the {before} of the scan before")
    if scan.time < scans[-1].time:
        raise LogError(f"time {scan.time:f} s; the scan before was at {scans[-1].time:f} s")
