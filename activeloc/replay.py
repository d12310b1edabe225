"""A filter over a recorded run: what it would have believed, scan by scan, against the reference.

The belief starts uniform over the open ground and sees what the robot saw: the raw odometry as
control, a fan of the laser's beams as scan. The reference poses are only measured against. A log
says nothing of commands, so no contact is ever reported.

The defaults are not those of the simulated tasks. Neighbouring beams of a laser share what the
map gets wrong, so 17 of them are used, 10 degrees apart on a laser of one degree, and their
likelihoods are raised to the power 0.5; the sensor is wider and expects more that is not on the
map; the wheels slip more in turns. Real maps are full of thin clutter, beside which the robot has
driven: the disc that must fit is smaller than any robot.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.beliefs.histogram import HistogramBelief
from activeloc.beliefs.particles import ParticleBelief
from activeloc.beliefs.settings import HistogramConfig, ParticleConfig
from activeloc.configuration import build, build_kind, unknown
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.logs import Recording
from activeloc.motion import MotionModel, MotionNoise, Terrain, wrap
from activeloc.sensors import BeamModel, LikelihoodField

NEAR_M = 0.5
NEAR_RAD = float(np.deg2rad(10.0))
HOLD = 10
RULE = (
    "right: over the last quarter of the scans the median error is at most 0.5 m in position and "
    "at most 10 degrees in heading; localized: at the first scan from which 10 scans running are "
    "within both"
)

BELIEFS: dict[str, type[HistogramConfig] | type[ParticleConfig]] = {
    "histogram": HistogramConfig,
    "particles": ParticleConfig,
}
SENSORS: dict[str, type[BeamModel] | type[LikelihoodField]] = {
    "beam": BeamModel,
    "field": LikelihoodField,
}
DEFAULTS: dict[str, dict[str, Any]] = {
    "histogram": {
        "cell_size": 0.3,
        "headings": 36,
        "reading_bin": 0.25,
        "sigma_factor": 1.0,
        "likelihood_power": 0.5,
        "repetition": inf,
        "contact_floor": 1.0,
        "odometry_floor": 0.5,
        "leak": 1e-4,
    },
    "particles": {
        "sigma_factor": 1.0,
        "likelihood_power": 0.5,
        "repetition": inf,
        "contact_floor": 1.0,
        "odometry_floor": 0.5,
        "leak": 1e-4,
    },
    "beam": {
        "z_max": 8.0,
        "sigma_hit": 0.2,
        "lambda_short": 0.5,
        "w_hit": 0.75,
        "w_short": 0.1,
        "w_max": 0.05,
        "w_rand": 0.1,
    },
    "field": {
        "z_max": 8.0,
        "sigma_hit": 0.2,
        "w_hit": 0.85,
        "w_max": 0.05,
        "w_rand": 0.1,
        "reading_bin": 0.25,
    },
    "odometry": {
        "rotation_from_rotation": 0.13,
        "rotation_from_translation": 0.05,
        "translation_from_translation": 0.08,
        "translation_from_rotation": 0.08,
    },
}
"""What differs from the filters' own defaults, by kind; the odometry's noise is that of a B21."""


@dataclass(frozen=True, slots=True)
class ReplayConfig:
    """How a recorded run is filtered.

    Attributes:
        beams: At most so many beams of a scan are used, evenly spread about straight ahead.
        radius: Of the disc that must fit where the robot stands [m].
        odometry: Noise of the wheels.
        sensor: What the filter assumes of the laser; its beams and field of view are set by the
            recording.
        belief: Of the filter; decides which.

    Raises:
        ConfigError: If a number is out of its range.
    """

    beams: int = 17
    radius: float = 0.1
    odometry: MotionNoise = field(default_factory=lambda: MotionNoise(**DEFAULTS["odometry"]))
    sensor: BeamModel | LikelihoodField = field(
        default_factory=lambda: BeamModel(**DEFAULTS["beam"])
    )
    belief: HistogramConfig | ParticleConfig = field(
        default_factory=lambda: HistogramConfig(**DEFAULTS["histogram"])
    )

    def __post_init__(self) -> None:
        checks.integer("beams", self.beams, 1, 4096)
        checks.number("radius", self.radius, 0.0, 100.0)

    @classmethod
    def of(cls, belief: str, settings: Mapping[str, Any] | None = None) -> ReplayConfig:
        """The defaults for a kind of belief, with settings laid over them.

        Args:
            belief: ``histogram`` or ``particles``.
            settings: Nested, by the names of the fields; the sensor's ``kind`` is ``beam`` or
                ``field``.

        Raises:
            ConfigError: If a name is unknown or a value is refused.
        """
        if belief not in BELIEFS:
            raise unknown("belief", belief, BELIEFS)
        given = dict(settings or {})
        for name in given:
            if name not in (known := [item.name for item in fields(cls)]):
                raise unknown("setting", name, known)
        sensor = given.pop("sensor", "beam")
        sensor = {"kind": sensor} if isinstance(sensor, str) else sensor
        for name in ("beams", "field_of_view"):
            if isinstance(sensor, Mapping) and name in sensor:
                raise ConfigError(f"sensor.{name} is the recording's; the number of beams: beams")
        return cls(
            sensor=build_kind(SENSORS, _over(_kind(sensor), sensor), "sensor", "beam"),
            belief=build(BELIEFS[belief], _over(belief, given.pop("belief", {})), "belief"),
            odometry=build(MotionNoise, _over("odometry", given.pop("odometry", {})), "odometry"),
            **given,
        )


def _kind(sensor: object) -> str:
    kind = sensor.get("kind", "beam") if isinstance(sensor, Mapping) else "beam"
    return kind if isinstance(kind, str) and kind in SENSORS else "beam"


def _over(kind: str, given: object) -> object:
    """Settings over the defaults of a kind; what is no mapping is left to be refused."""
    return {**DEFAULTS[kind], **given} if isinstance(given, Mapping) else given


@dataclass(frozen=True, slots=True)
class Row:
    """What the filter believed after one scan.

    Attributes:
        scan: Its number in the whole log.
        time: When it was taken [s].
        estimate: ``(3,)``; the most likely pose.
        entropy: On the common bins [nat].
        error_m: From the reference's place [m].
        error_rad: From the reference's heading, in [0, pi] [rad].
    """

    scan: int
    time: float
    estimate: NDArray[np.float64]
    entropy: float
    error_m: float
    error_rad: float

    @property
    def is_near(self) -> bool:
        """Whether both errors are within 0.5 m and 10 degrees."""
        return self.error_m <= NEAR_M and self.error_rad <= NEAR_RAD


def fan(bearings: NDArray[np.float64], beams: int) -> tuple[NDArray[np.int64], float]:
    """Which of a laser's beams to use: evenly spread about straight ahead.

    Args:
        bearings: ``(B,)``, evenly spaced, ascending [rad].
        beams: At most so many.

    Returns:
        Indices ``(n,)`` with n odd, and the angle between the first and the last of them [rad];
        each is within half a recorded spacing of where an even fan has it.

    Raises:
        ConfigError: If the laser does not look ahead.
    """
    if not bearings[0] - 1e-9 <= 0.0 <= bearings[-1] + 1e-9:
        raise ConfigError(
            f"the laser looks from {bearings[0]:g} to {bearings[-1]:g} rad; expected a fan that "
            "holds straight ahead"
        )
    ahead = int(np.abs(bearings).argmin())
    reach = min(ahead, len(bearings) - 1 - ahead)
    wanted = (beams - 1) // 2
    if reach == 0 or wanted == 0:
        return np.array([ahead]), 0.0
    stride = reach // (wanted + 1) + 1
    side = reach // stride
    chosen = ahead + stride * np.arange(-side, side + 1)
    return chosen, float(bearings[chosen[-1]] - bearings[chosen[0]])


class Replay:
    """A filter made ready for a recording on a map.

    Args:
        recording: The run.
        grid: The map.
        config: How it is filtered.

    Raises:
        ConfigError: If the recording's laser does not look ahead.
        MapError: If the robot fits nowhere on the map.
    """

    def __init__(self, recording: Recording, grid: OccupancyGrid, config: ReplayConfig) -> None:
        chosen, width = fan(recording.bearings, config.beams)
        self.recording = recording
        self.grid = grid
        self.config = config
        self.sensor = replace(config.sensor, beams=len(chosen), field_of_view=width)
        self.motion = MotionModel(odometry=config.odometry, radius=config.radius)
        scans = recording.scans[:, chosen]
        self.scans = np.where(scans >= self.sensor.z_max, inf, scans)
        self.controls = recording.controls()

    def on_open_ground(self) -> float:
        """Share of the reference poses where the filter thinks that the robot can be."""
        terrain = Terrain(self.grid, self.config.radius)
        return float(terrain.contains(self.recording.reference).mean())

    def rows(self, seed: int) -> Iterator[Row]:
        """What the filter believes after each scan; all its chance follows from the seed."""
        belief = self._belief(seed)
        for i in range(len(self.recording)):
            if i:
                belief.predict(0, self.controls[i - 1], False)
            belief.correct(0, self.scans[i])
            summary = belief.summarise(0)
            offset = summary.estimate - self.recording.reference[i]
            yield Row(
                scan=int(self.recording.scan_numbers[i]),
                time=float(self.recording.times[i]),
                estimate=summary.estimate,
                entropy=summary.entropy,
                error_m=float(np.hypot(offset[0], offset[1])),
                error_rad=float(np.abs(wrap(offset[2]))),
            )

    def _belief(self, seed: int) -> HistogramBelief | ParticleBelief:
        """The uniform prior."""
        checks.integer("seed", seed, 0, 2**63 - 1)
        config = self.config.belief
        if isinstance(config, HistogramConfig):
            grid_filter = HistogramBelief(1, config, self.sensor, self.motion)
            grid_filter.reset(0, self.grid)
            return grid_filter
        cloud = ParticleBelief(1, config, self.sensor, self.motion)
        cloud.reset(0, self.grid, np.random.default_rng(seed))
        return cloud


def localize(
    recording: Recording, grid: OccupancyGrid, config: ReplayConfig, seed: int
) -> Iterator[Row]:
    """What a filter believes after each scan of a recording: see :class:`Replay`."""
    return Replay(recording, grid, config).rows(seed)


@dataclass(frozen=True, slots=True)
class Score:
    """How well a run went; see :data:`RULE`.

    Attributes:
        right: Whether the estimate was at the reference in the end.
        median_m: Median error over the last quarter of the scans [m].
        median_rad: The same of the heading [rad].
        localized_at: Place of the scan at which it was first localized, from 0; None if it never
            was.
    """

    right: bool
    median_m: float
    median_rad: float
    localized_at: int | None


def score(rows: Sequence[Row]) -> Score:
    """Judge a run by its rows.

    Raises:
        ConfigError: If there are none.
    """
    if not rows:
        raise ConfigError("a run without scans cannot be judged")
    last = rows[-(-3 * len(rows) // 4) :] or rows[-1:]
    median_m = float(np.median([row.error_m for row in last]))
    median_rad = float(np.median([row.error_rad for row in last]))
    right = median_m <= NEAR_M and median_rad <= NEAR_RAD
    return Score(right, median_m, median_rad, _localized_at(rows))


def _localized_at(rows: Sequence[Row]) -> int | None:
    """First of :data:`HOLD` rows running that are near."""
    running = 0
    for i, row in enumerate(rows):
        running = running + 1 if row.is_near else 0
        if running == HOLD:
            return i + 1 - HOLD
    return None


def after(rows: Sequence[Row], scan: int) -> Sequence[Row]:
    """The rows from a scan number of the log on."""
    return [row for row in rows if row.scan >= scan]


@dataclass(slots=True)
class Clock:
    """Wall and processor time of a piece of work [s]."""

    wall: float = field(default_factory=time.perf_counter)
    processor: float = field(default_factory=time.process_time)

    def read(self) -> tuple[float, float]:
        """Seconds since it was made: wall, processor."""
        return time.perf_counter() - self.wall, time.process_time() - self.processor


@dataclass(frozen=True, eq=False)
class Run:
    """A run that is over.

    Attributes:
        prepared: What was run.
        rows: What the filter believed.
        seed: Of its chance.
        seconds: Wall and processor time, tables of the map included [s].
        carried_to: Number of the scan at which a kidnapped robot was set down.
    """

    prepared: Replay
    rows: Sequence[Row]
    seed: int
    seconds: tuple[float, float]
    carried_to: int | None = None

    @property
    def score(self) -> Score:
        """Over all its scans."""
        return score(self.rows)

    @property
    def recovery(self) -> Score | None:
        """From the scan at which the robot was set down; None if it was not carried."""
        later = [] if self.carried_to is None else after(self.rows, self.carried_to)
        return score(later) if later else None

    @property
    def carried_m(self) -> float:
        """How far the robot was carried [m]; 0 if it was not."""
        recording = self.prepared.recording
        down = np.flatnonzero(recording.scan_numbers == self.carried_to)
        if self.carried_to is None or len(down) == 0 or down[0] == 0:
            return 0.0
        offset = recording.reference[down[0]] - recording.reference[down[0] - 1]
        return float(np.hypot(offset[0], offset[1]))

    @property
    def times_faster(self) -> float:
        """Recorded seconds in a second of filtering."""
        return self.prepared.recording.seconds / max(self.seconds[0], 1e-9)
