"""One line of a CARMEN log: which message it is, and the scan that it holds."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from activeloc.configuration import unknown
from activeloc.errors import LogError
from activeloc.logs.recording import wrap_angles

MAX_BEAMS = 4096
MAX_COORDINATE = 1e6
FLASER_MAX = 80.0
"""A ``FLASER`` line does not say its laser's longest range [m]; a SICK laser that misses an echo
says 81.83 or 81.91."""

_TAIL = 3  # Time sent, host, time written.
_SKIPPED = frozenset(
    {"SYNC", "COMMENT", "TRUEPOS", "LASER3", "LASER4", "LASER5", "ROBOTLASER2", "RAWLASER1"}
    | {"RAWLASER2", "RAWLASER3", "RAWLASER4", "RAWLASER5", "POSITIONLASER", "SONAR", "BUMPER"}
    | {"NMEAGGA", "NMEARMC", "NMEA-GGA", "NMEA-RMC", "SM_UPDATE", "ODO_UPDATE", "LASER_READING"}
)
_KNOWN = _SKIPPED | {"FLASER", "RLASER", "ROBOTLASER1", "ODOM", "PARAM"}


@dataclass(frozen=True, slots=True)
class LaserLine:
    """What a laser line says.

    Attributes:
        ranges: ``(B,)``; +inf is a maximum-range reading [m].
        bearings: The first, and between two [rad].
        laser: ``(3,)``; pose of the laser.
        robot: ``(3,)``; pose of the robot.
        time: When it was sent [s].
    """

    ranges: NDArray[np.float64]
    bearings: tuple[float, float]
    laser: NDArray[np.float64]
    robot: NDArray[np.float64]
    time: float


def message(line: str, max_range: float | None) -> tuple[str, LaserLine | None]:
    """Name of a line's message, and its scan if it is one that is used.

    Args:
        line: Text of the line, neither empty nor a comment.
        max_range: The laser's longest range, in place of what the line or its kind says [m].

    Raises:
        LogError: If a field is missing, no number, or out of its range.
        ConfigError: If there is no message of that name.
    """
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


def _flaser(name: str, fields: list[str], max_range: float) -> LaserLine:
    n = _count(name, "n", fields, 0)
    _demand(name, fields, 1 + n + 6 + _TAIL)
    poses = _poses(name, fields[1 + n : 7 + n])
    # 181 beams reach from -90 to +90 degrees; of 180, the last has been left out.
    bearings = (0.0, 1.0) if n == 1 else (-0.5 * np.pi, np.pi / (n - n % 2))
    return LaserLine(
        _ranges(name, fields[1 : 1 + n], max_range), bearings, poses[0], poses[1],
        _time(name, fields),
    )  # fmt: skip


def _robotlaser(fields: list[str], max_range: float | None) -> LaserLine:
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
    return LaserLine(ranges, (first, step), poses[0], poses[1], _time(name, fields))


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
    poses[:, 2] = wrap_angles(poses[:, 2])
    return poses


def _time(name: str, fields: list[str]) -> float:
    return float(_numbers(name, "time", [fields[-3], fields[-1]])[0])
