"""Settings of the filters."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from activeloc import checks
from activeloc.beliefs.resampling import SCHEMES
from activeloc.errors import ConfigError


@dataclass(frozen=True, slots=True)
class HistogramConfig:
    """Settings of the histogram filter.

    Attributes:
        cell_size: Side of a cell [m].
        headings: Number of heading bins, even.
        reading_bin: Greatest width of the bins that readings are sorted into [m].
        sigma_factor: By how much the filter widens the sensor's ``sigma_hit``: like rooms lie
            differently on the grid, and a true-width likelihood takes that for a difference.
        likelihood_power: Exponent on each reading's likelihood.
        repetition: Ratio of the variances of a reading's own and of its shared sub-cell error; a
            direction read again from one place counts less, ``inf`` counts it in full.
        sectors: Directions told apart when readings and contacts are remembered.
        place_size: Travel after which the robot counts as elsewhere [m].
        contact_floor: Probability that a contact is felt where the map has no obstacle; 1 ignores
            contacts.
        odometry_floor: Weight of ways that an obstacle on the map would have cut short, against
            the odometry's reading; 1 ignores that evidence.
        slip: Probability that an odometry reading is badly wrong
            (:func:`activeloc.motion.slipped`), reckoned with once the belief is local.
        leak: Probability per step that the robot is carried anywhere (kidnapping); steps on one
            spot whose scans tell nothing new do not count.
        widen: Probability of being elsewhere above which the belief is laid out over the whole map
            again; see :mod:`activeloc.beliefs.background`.
        novelty: gamma; a reading that is shorter than the map explains with more than this
            probability is not used (people in the way); 0 uses all. 0.99 in the literature.
        least: Probability under which a state counts as empty; 0 updates every state at each step,
            and lays the leak out over all of them.
        precision: ``float32`` or ``float64``, of the stored belief.

    Raises:
        ConfigError: If a number is out of its range.
    """

    cell_size: float = 0.2
    headings: int = 72
    reading_bin: float = 0.1
    sigma_factor: float = 1.5
    likelihood_power: float = 0.6
    repetition: float = 0.0
    sectors: int = 12
    place_size: float = 0.25
    contact_floor: float = 0.02
    odometry_floor: float = 0.05
    slip: float = 0.05
    leak: float = 1e-4
    widen: float = 0.005
    novelty: float = 0.0
    least: float = 1e-10
    precision: str = "float32"

    def __post_init__(self) -> None:
        checks.number("belief.cell_size", self.cell_size, 0.01, 2.0)
        checks.integer("belief.headings", self.headings, 4, 720)
        if self.headings % 2:
            raise ConfigError(f"belief.headings must be even; got {self.headings}")
        _check_common(self)
        checks.number("belief.widen", self.widen, 0.0, 1.0, above_low=True)
        checks.number("belief.slip", self.slip, 0.0, 1.0)
        checks.number("belief.least", self.least, 0.0, 1e-3)
        checks.choice("belief.precision", self.precision, ("float32", "float64"))


@dataclass(frozen=True, slots=True)
class ParticleConfig:
    """Settings of the particle filter.

    Attributes:
        n_min: Fewest particles.
        n_max: Most particles, once the first scan has been read; as many again may stand for a
            robot that has been carried off.
        n_start: Particles that are spread over a whole map before a scan is read.
        n_elsewhere: Particles for the chance that the robot has been carried off, while it is small
            (twice as many in passing), and poses that are tried for it at each scan.
        per_state: Particles per effective state: N = ``per_state`` exp(H), within the two limits.
        allocation: A bin of mass m gets particles in proportion to m to this power, in (0, 1].
        ess_ratio: Resample when the effective sample size falls under this share of N.
        resampling: ``systematic``, ``stratified``, ``multinomial`` or ``residual``.
        sigma_factor: By how much the filter widens the sensor's ``sigma_hit``.
        likelihood_power: Exponent on each reading's likelihood.
        roughening_xy: Standard deviation added to x and y at each resampling [m].
        roughening_theta: Standard deviation added to the heading at each resampling [rad].
        reading_bin: Greatest width of the bins that readings are sorted into [m].
        repetition: As in :class:`HistogramConfig`; ``inf`` counts repeated readings in full.
        sectors: Directions told apart when readings and contacts are remembered.
        place_size: Travel after which the robot counts as elsewhere [m].
        contact_floor: Probability that a contact is felt where the map has no obstacle.
        contact_reach: An obstacle nearer than this explains a contact [m].
        odometry_floor: Weight of a particle that an obstacle on the map stopped short of what the
            odometry read.
        slip: Probability that an odometry reading is badly wrong
            (:func:`activeloc.motion.slipped`): as large a share of the particles does not take it
            at its word.
        leak: Probability per scan that tells anything that the robot was carried anywhere, or lost.
        recovery: ``background`` (:mod:`activeloc.beliefs.carried_off`), ``augmented`` (running
            means of the likelihood: :mod:`activeloc.beliefs.recovery`) or ``none``.
        widen: Probability of having been carried off at which the robot is looked for everywhere.
        alpha_slow: Rate of the slow mean of augmented MCL.
        alpha_fast: Rate of the fast mean, not below ``alpha_slow``.
        injection: Where augmented MCL draws poses from: the ``scan``'s likelihood or ``free``
            space.
        sizing: How many particles: by ``entropy``, as above, or by ``kld``
            (:mod:`activeloc.beliefs.sample_size`; particles are then drawn one by one).
        kld_error: Bound on the divergence of sample and belief [nat].
        kld_confidence: Probability that it holds.
        kld_size: Side of the bins that are counted [m].
        kld_angle: Width of their headings [rad].
        directions: Of the table of expected ranges; 0 casts every ray exactly, and asks a
            likelihood field at every pose.
        novelty: As in :class:`HistogramConfig`; 0 uses every reading.

    Raises:
        ConfigError: If a number is out of its range, ``n_min`` above ``n_max`` or ``alpha_slow``
            above ``alpha_fast``.
    """

    n_min: int = 12_000
    n_max: int = 50_000
    n_start: int = 200_000
    n_elsewhere: int = 1_000
    per_state: float = 20.0
    allocation: float = 0.5
    ess_ratio: float = 0.5
    resampling: str = "systematic"
    sigma_factor: float = 2.0
    likelihood_power: float = 0.7
    roughening_xy: float = 0.06
    roughening_theta: float = float(np.deg2rad(3.0))
    reading_bin: float = 0.1
    repetition: float = 0.0
    sectors: int = 12
    place_size: float = 0.25
    contact_floor: float = 0.02
    contact_reach: float = 0.2
    odometry_floor: float = 0.05
    slip: float = 0.05
    leak: float = 1e-3
    recovery: str = "background"
    widen: float = 0.02
    alpha_slow: float = 0.001
    alpha_fast: float = 0.1
    injection: str = "scan"
    sizing: str = "entropy"
    kld_error: float = 0.05
    kld_confidence: float = 0.99
    kld_size: float = 0.5
    kld_angle: float = float(np.pi / 18.0)
    directions: int = 128
    novelty: float = 0.0

    def __post_init__(self) -> None:
        checks.integer("belief.n_min", self.n_min, 1, 10_000_000)
        checks.integer("belief.n_max", self.n_max, 1, 10_000_000)
        checks.integer("belief.n_start", self.n_start, 1, 10_000_000)
        checks.integer("belief.n_elsewhere", self.n_elsewhere, 1, 10_000_000)
        if self.n_min > self.n_max:
            raise ConfigError(
                f"belief.n_min must be at most belief.n_max; got {self.n_min} and {self.n_max}"
            )
        checks.number("belief.per_state", self.per_state, 0.0, 1e6)
        checks.number("belief.allocation", self.allocation, 0.0, 1.0, above_low=True)
        checks.choice("belief.resampling", self.resampling, tuple(SCHEMES))
        checks.number("belief.ess_ratio", self.ess_ratio, 0.0, 1.0, above_low=True)
        checks.number("belief.roughening_xy", self.roughening_xy, 0.0, 10.0)
        checks.number("belief.roughening_theta", self.roughening_theta, 0.0, np.pi)
        checks.number("belief.contact_reach", self.contact_reach, 0.0, 1e3)
        checks.number("belief.slip", self.slip, 0.0, 1.0)
        checks.choice("belief.recovery", self.recovery, ("background", "augmented", "none"))
        checks.choice("belief.injection", self.injection, ("scan", "free"))
        checks.choice("belief.sizing", self.sizing, ("entropy", "kld"))
        checks.number("belief.widen", self.widen, 0.0, 1.0, above_low=True)
        checks.number("belief.alpha_fast", self.alpha_fast, 0.0, 1.0, above_low=True)
        checks.number("belief.alpha_slow", self.alpha_slow, 0.0, self.alpha_fast, above_low=True)
        checks.number("belief.kld_error", self.kld_error, 0.0, 10.0, above_low=True)
        checks.number("belief.kld_confidence", self.kld_confidence, 1e-6, 1.0 - 1e-9)
        checks.number("belief.kld_size", self.kld_size, 0.01, 1e3)
        checks.number("belief.kld_angle", self.kld_angle, 1e-3, 2.0 * np.pi)
        checks.integer("belief.directions", self.directions, 0, 3600)
        _check_common(self)


def _check_common(config: HistogramConfig | ParticleConfig) -> None:
    """Refuse what neither filter can use.

    Raises:
        ConfigError: If a number is out of its range.
    """
    checks.number("belief.sigma_factor", config.sigma_factor, 0.1, 100.0)
    checks.number("belief.likelihood_power", config.likelihood_power, 0.0, 1.0, above_low=True)
    checks.number("belief.reading_bin", config.reading_bin, 0.0, 1e4, above_low=True)
    if config.repetition != inf:
        checks.number("belief.repetition", config.repetition, 0.0, inf)
    checks.integer("belief.sectors", config.sectors, 1, 3600)
    checks.number("belief.place_size", config.place_size, 0.0, 1e3, above_low=True)
    for name in ("contact_floor", "odometry_floor"):
        checks.number(f"belief.{name}", getattr(config, name), 0.0, 1.0, above_low=True)
    checks.number("belief.leak", config.leak, 0.0, 1.0)
    checks.number("belief.novelty", config.novelty, 0.0, 1.0)
