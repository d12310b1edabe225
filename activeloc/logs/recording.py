"""A recorded run: scans, where the robot was, and where its wheels believed it to be."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.errors import LogError

TINY = 0.02
"""A travel shorter than this has no direction: wheels that turn on the spot read a few mm [m]."""


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
        odometry[end:, 2] = wrap_angles(odometry[end:, 2] + turn)
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


def wrap_angles(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles in [-pi, pi)."""
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
    heading, turn = poses[:-1, 2], wrap_angles(delta[:, 2])
    trans = np.hypot(delta[:, 0], delta[:, 1])
    rot1 = wrap_angles(np.arctan2(delta[:, 1], delta[:, 0]) - heading)
    backwards = np.abs(rot1) > 0.5 * np.pi
    rot1 = np.where(backwards, wrap_angles(rot1 + np.pi), rot1)
    trans = np.where(backwards, -trans, trans)
    tiny = np.abs(trans) < TINY
    trans = np.where(tiny, trans * np.cos(rot1), trans)
    rot1 = np.where(tiny, 0.0, rot1)
    return np.stack([rot1, trans, wrap_angles(turn - rot1)], axis=-1)
