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
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.configuration import unknown
from activeloc.errors import ActiveLocError, LogError

MAX_BYTES = 1 << 30
MAX_LINE = 1 << 17
MAX_BEAMS = 4096
MAX_COORDINATE = 1e6
FLASER_MAX = 80.0
"""A ``FLASER`` line does not say its laser's longest range [m]; a SICK laser that misses an echo
says 81.83 or 81.91."""
TINY = 0.02
"""A travel shorter than this has no direction: wheels that turn on the spot read a few mm [m]."""

_TAIL = 3  # Time sent, host, time written.
_SKIPPED = frozenset(
    {"SYNC", "COMMENT", "TRUEPOS", "LASER3", "LASER4", "LASER5", "ROBOTLASER2", "RAWLASER1"}
    | {"RAWLASER2", "RAWLASER3", "RAWLASER4", "RAWLASER5", "POSITIONLASER", "SONAR", "BUMPER"}
    | {"NMEAGGA", "NMEARMC", "NMEA-GGA", "NMEA-RMC", "SM_UPDATE", "ODO_UPDATE", "LASER_READING"}
)
_KNOWN = _SKIPPED | {"FLASER", "RLASER", "ROBOTLASER1", "ODOM", "PARAM"}


@dataclass(frozen=True, eq=False)
class Recording:
    """Scans of one laser, with where the robot was and where its wheels believed it to be.

    Arrays are kept as read-only copies.

    Attributes:
        scans: ``(T, B)`` [m]; +inf is a maximum-range reading.
        bearings: ``(B,)``; beam angles relative to the heading, ascending [rad].
        reference: ``(T, 3)``; poses that a SLAM program says, to measure errors against.
        odometry: ``(T, 3)``; raw wheel odometry, in a frame of its own.
        times: ``(T,)``; ascending [s].
        name: What to call it.
        numbers: ``(T,)``; each scan's place in the whole log, from 0; counted here if None.

    Raises:
        LogError: If there is no scan, shapes do not fit together, a pose or a time is not finite,
            times or bearings do not ascend, or a range is negative or NaN.
    """

    scans: NDArray[np.float64]
    bearings: NDArray[np.float64]
    reference: NDArray[np.float64]
    odometry: NDArray[np.float64]
    times: NDArray[np.float64]
    name: str = "recording"
    numbers: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        n_scans = len(np.atleast_1d(self.times))
        n_beams = len(np.atleast_1d(self.bearings))
        if self.numbers is None:
            object.__setattr__(self, "numbers", np.arange(n_scans, dtype=np.int64))
        shapes = {
            "scans": (n_scans, n_beams),
            "bearings": (n_beams,),
            "reference": (n_scans, 3),
            "odometry": (n_scans, 3),
            "times": (n_scans,),
            "numbers": (n_scans,),
        }
        for name, shape in shapes.items():
            dtype = np.int64 if name == "numbers" else np.float64
            array = np.array(getattr(self, name), dtype=dtype)
            if array.shape != shape or array.size == 0:
                raise LogError(f"{self.name}: {name} must be {shape}, not empty; got {array.shape}")
            if name != "scans" and not np.isfinite(array).all():
                raise LogError(f"{self.name}: {name} must be finite")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if not (self.scans >= 0.0).all():
            raise LogError(f"{self.name}: ranges must be in [0, inf]")
        if (np.diff(self.times) < 0.0).any() or (np.diff(self.bearings) <= 0.0).any():
            raise LogError(f"{self.name}: times and bearings must ascend")

    def __len__(self) -> int:
        return len(self.times)

    @property
    def scan_numbers(self) -> NDArray[np.int64]:
        """``(T,)``; each scan's place in the whole log."""
        assert self.numbers is not None
        return self.numbers

    @property
    def seconds(self) -> float:
        """How long it took to record, without what has been cut out [s]."""
        whole = np.diff(self.scan_numbers) == 1
        return float(np.diff(self.times)[whole].sum())

    def controls(self) -> NDArray[np.float64]:
        """Control u of each scan but the first: ``(T - 1, 3)`` of rot1, trans, rot2.

        See :func:`controls_between`.
        """
        return controls_between(self.odometry)

    def from_scan(self, first: int) -> Recording:
        """Without the scans before ``first``.

        Raises:
            ConfigError: If ``first`` is not one of its scans.
        """
        checks.integer("first scan", first, 0, len(self) - 1)
        return self._kept(np.arange(first, len(self)))

    def until(self, n_scans: int) -> Recording:
        """The first ``n_scans`` scans, or all if there are fewer.

        Raises:
            ConfigError: If that is not a number from 1.
        """
        checks.integer("number of scans", n_scans, 1, 10**9)
        return self._kept(np.arange(min(n_scans, len(self))))

    def cut(self, first: int, end: int) -> Recording:
        """Without scans ``first`` up to, not including, ``end``: there the robot is carried.

        The wheels do not turn while it is: the odometry goes on where it was, so the control
        across the cut is no motion.

        Raises:
            ConfigError: Unless 0 < first < end < T.
        """
        checks.integer("kidnapped at scan", first, 1, len(self) - 2)
        checks.integer("set down at scan", end, first + 1, len(self) - 1)
        kept = np.r_[np.arange(first), np.arange(end, len(self))]
        odometry = self.odometry.copy()
        turn = odometry[first - 1, 2] - odometry[end, 2]
        c, s = np.cos(turn), np.sin(turn)
        offset = odometry[end:, :2] - odometry[end, :2]
        odometry[end:, :2] = odometry[first - 1, :2] + offset @ np.array([[c, s], [-s, c]])
        odometry[end:, 2] = _wrap(odometry[end:, 2] + turn)
        return replace(self, odometry=odometry)._kept(kept)

    def _kept(self, kept: NDArray[np.int64]) -> Recording:
        return replace(
            self,
            scans=self.scans[kept],
            reference=self.reference[kept],
            odometry=self.odometry[kept],
            times=self.times[kept],
            numbers=self.scan_numbers[kept],
        )


def _wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    result: NDArray[np.float64] = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return result


def controls_between(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation, translation, rotation between successive poses ``(T, 3)``: ``(T - 1, 3)``.

    Thrun, Burgard & Fox, *Probabilistic Robotics* (2005), table 5.6, lines 2 to 4. A travel towards
    behind is one backwards (``trans`` negative) after a small rotation, not a half turn, a drive
    and another half turn; one shorter than 2 cm has no direction, and counts as far as it went
    along the heading.
    """
    delta = np.diff(poses, axis=0)
    heading, turn = poses[:-1, 2], _wrap(delta[:, 2])
    trans = np.hypot(delta[:, 0], delta[:, 1])
    rot1 = _wrap(np.arctan2(delta[:, 1], delta[:, 0]) - heading)
    backwards = np.abs(rot1) > 0.5 * np.pi
    rot1 = np.where(backwards, _wrap(rot1 + np.pi), rot1)
    trans = np.where(backwards, -trans, trans)
    tiny = np.abs(trans) < TINY
    trans = np.where(tiny, trans * np.cos(rot1), trans)
    rot1 = np.where(tiny, 0.0, rot1)
    return np.stack([rot1, trans, _wrap(turn - rot1)], axis=-1)


@dataclass(frozen=True, slots=True)
class _Scan:
    """One laser line."""

    ranges: NDArray[np.float64]
    bearings: tuple[float, float]  # First, and between two.
    laser: NDArray[np.float64]
    robot: NDArray[np.float64]
    time: float


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
    found: dict[str, list[_Scan]] = {"FLASER": [], "ROBOTLASER1": []}
    n_rear = 0
    for number, line in _lines(path):
        try:
            name, scan = _message(line, max_range)
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


def _message(line: str, max_range: float | None) -> tuple[str, _Scan | None]:
    """Name of a line's message, and its scan if it is one that is used."""
    name, *fields = line.split()
    if name not in _KNOWN:
        raise unknown("message", name[:40], _KNOWN)
    if name in ("FLASER", "RLASER"):
        scan = _flaser(name, fields, FLASER_MAX if max_range is None else max_range)
        return name, scan if name == "FLASER" else None
    if name == "ROBOTLASER1":
        return name, _robotlaser(fields, max_range)
    if name == "ODOM":
        _demand(name, fields, 6 + _TAIL)
        _numbers(name, "reading", fields[:6])
        _time(name, fields)
    if name == "PARAM" and len(fields) < 2:
        raise LogError(f"PARAM: {len(fields)} fields; expected a name and a value")
    return name, None


def _flaser(name: str, fields: list[str], max_range: float) -> _Scan:
    n = _count(name, "n", fields, 0)
    _demand(name, fields, 1 + n + 6 + _TAIL)
    poses = _poses(name, fields[1 + n : 7 + n])
    # 181 beams reach from -90 to +90 degrees; of 180, the last has been left out.
    bearings = (0.0, 1.0) if n == 1 else (-0.5 * np.pi, np.pi / (n - n % 2))
    return _Scan(
        _ranges(name, fields[1 : 1 + n], max_range), bearings, poses[0], poses[1],
        _time(name, fields),
    )  # fmt: skip


def _robotlaser(fields: list[str], max_range: float | None) -> _Scan:
    name = "ROBOTLASER1"
    if len(fields) < 8:
        raise LogError(f"{name}: {len(fields)} fields; expected 8 before the ranges")
    first, width, step, longest = _numbers(name, "geometry", fields[1:5])
    n = _count(name, "number of readings", fields, 7)
    if not (0.0 < step <= np.pi and abs(first) <= 2.0 * np.pi and (n - 1) * step <= 2.0 * np.pi):
        raise LogError(
            f"{name}: {n} beams from {first:g} rad in steps of {step:g} rad (field of view "
            f"{width:g} rad); expected a positive step, and at most a full turn"
        )
    if longest <= 0.0:
        raise LogError(f"{name}: longest range {longest:g} m; expected a positive number")
    end = 8 + n
    older = len(fields) == end + 10 + _TAIL
    m = 0 if older else _count(name, "number of remissions", fields, end, least=0)
    start = end if older else end + 1 + m
    _demand(name, fields, start + (10 if older else 11) + _TAIL)
    if not older:
        _numbers(name, "remission", fields[end + 1 : start])
    poses = _poses(name, fields[start : start + 6])
    _numbers(name, "velocity or distance", fields[start + 6 : len(fields) - _TAIL])
    ranges = _ranges(name, fields[8:end], longest if max_range is None else max_range)
    return _Scan(ranges, (first, step), poses[0], poses[1], _time(name, fields))


def _count(name: str, what: str, fields: list[str], place: int, least: int = 1) -> int:
    text = fields[place] if place < len(fields) else ""
    # Not int(): it takes 1_0, and digits of every script.
    given = int(text) if text.isascii() and text.isdecimal() and len(text) < 10 else -1
    if not least <= given <= MAX_BEAMS:
        raise LogError(
            f"{name}: {what} is {text[:40]!r}; expected an integer in [{least}, {MAX_BEAMS}]"
        )
    return given


def _demand(name: str, fields: list[str], wanted: int) -> None:
    if len(fields) != wanted:
        raise LogError(
            f"{name}: {len(fields)} fields; expected {wanted} by the numbers of readings it gives"
        )


def _numbers(name: str, what: str, texts: list[str]) -> NDArray[np.float64]:
    """Finite numbers.

    Raises:
        LogError: If one is no number, or none that is finite.
    """
    values = np.empty(len(texts))
    for i, text in enumerate(texts):
        try:
            values[i] = float(text) if "_" not in text else np.nan
        except ValueError:
            values[i] = np.nan
        if not isfinite(values[i]):
            raise LogError(f"{name}: {what} {i} is {text[:40]!r}; expected a finite number")
    return values


def _ranges(name: str, texts: list[str], max_range: float) -> NDArray[np.float64]:
    values = _numbers(name, "range", texts)
    if (values < 0.0).any():
        i = int(np.argmax(values < 0.0))
        raise LogError(f"{name}: range {i} is {texts[i][:40]}; expected a number from 0 [m]")
    return np.where(values >= max_range, np.inf, values)


def _poses(name: str, texts: list[str]) -> NDArray[np.float64]:
    """Laser's and robot's pose: ``(2, 3)``, theta in [-pi, pi)."""
    poses = _numbers(name, "pose field", texts).reshape(2, 3)
    if (np.abs(poses) > MAX_COORDINATE).any():
        far = poses.ravel()[np.abs(poses).argmax()]
        raise LogError(f"{name}: a pose holds {far:g}; expected at most {MAX_COORDINATE:g}")
    poses[:, 2] = _wrap(poses[:, 2])
    return poses


def _time(name: str, fields: list[str]) -> float:
    return float(_numbers(name, "time", [fields[-3], fields[-1]])[0])


def _check_next(scans: list[_Scan], scan: _Scan) -> None:
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
