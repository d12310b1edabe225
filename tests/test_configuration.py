"""Settings: nested building, the nearest known name, and a refusal for every bad value."""

from dataclasses import dataclass, field, fields
from math import inf, nan, pi

import numpy as np
import pytest

from activeloc import checks
from activeloc.beliefs.histogram import HistogramConfig
from activeloc.beliefs.particles import ParticleConfig
from activeloc.configuration import build, build_kind
from activeloc.envs.actions import Actions
from activeloc.envs.observations import ObservationConfig
from activeloc.envs.rewards import RewardWeights
from activeloc.envs.tasks import Task
from activeloc.errors import ActiveLocError, ConfigError
from activeloc.motion import MotionModel, MotionNoise
from activeloc.sensors import BeamModel, LikelihoodField

SENSORS = {"beam": BeamModel, "field": LikelihoodField}


# --- building ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Inner:
    size: float = 1.0

    def __post_init__(self) -> None:
        checks.number("inner.size", self.size, 0.0, 2.0)


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    name: str = "x"
    count: int = 3


def test_mappings_become_nested_objects():
    assert build(Outer, {"inner": {"size": 2.0}, "count": 4}, "outer") == Outer(Inner(2.0), "x", 4)
    motion = build(
        MotionModel, {"radius": 0.1, "odometry": {"rotation_from_rotation": 0.3}}, "motion"
    )
    assert motion == MotionModel(radius=0.1, odometry=MotionNoise(0.3))
    assert motion.actuation == MotionModel().actuation


def test_objects_and_none_pass_through():
    given = Outer(count=9)
    assert build(Outer, given, "outer") is given
    assert build(Outer, None, "outer") == Outer()
    assert build(Outer, {"inner": given.inner}, "outer").inner is given.inner


def test_mappings_are_not_written_to():
    given = {"kind": "beam", "beams": 5}
    build_kind(SENSORS, given, "sensor", "beam")
    assert given == {"kind": "beam", "beams": 5}


def test_an_unknown_name_says_the_nearest_and_where():
    with pytest.raises(
        ConfigError,
        match=r"motion\.odometry: unknown name 'rotation_from_rotatoin'; did you mean "
        r"'rotation_from_rotation'\?",
    ):
        build(MotionModel, {"odometry": {"rotation_from_rotatoin": 0.1}}, "motion")
    with pytest.raises(ConfigError, match=r"motion: unknown name 'radus'; did you mean 'radius'\?"):
        build(MotionModel, {"radus": 0.1}, "motion")
    with pytest.raises(
        ConfigError, match=r"outer: unknown name 'qqq' \(known: count, inner, name\)"
    ):
        build(Outer, {"qqq": 0.1}, "outer")
    with pytest.raises(ConfigError, match="outer: unknown name 3"):
        build(Outer, {3: 0.1}, "outer")


def test_kinds_are_chosen_by_name():
    assert build_kind(SENSORS, None, "sensor", "beam") == BeamModel()
    assert build_kind(SENSORS, "field", "sensor", "beam") == LikelihoodField()
    assert build_kind(SENSORS, {"kind": "field", "beams": 7}, "sensor", "beam") == LikelihoodField(
        7
    )
    assert build_kind(SENSORS, {"beams": 7}, "sensor", "beam") == BeamModel(7)
    given = LikelihoodField()
    assert build_kind(SENSORS, given, "sensor", "beam") is given
    with pytest.raises(ConfigError, match="sensor: unknown name 'baem'; did you mean 'beam'"):
        build_kind(SENSORS, "baem", "sensor", "beam")


@pytest.mark.parametrize("value", [3, 2.5, True, [1], ("a",)])
def test_other_types_are_refused(value):
    with pytest.raises(ConfigError, match=r"outer must be a Outer or a mapping"):
        build(Outer, value, "outer")
    with pytest.raises(ConfigError, match=r"sensor must be one of beam, field"):
        build_kind(SENSORS, value, "sensor", "beam")


def test_a_name_where_an_object_is_wanted_is_refused():
    with pytest.raises(ConfigError, match="outer must be a Outer"):
        build(Outer, "x", "outer")


# --- every setting is checked --------------------------------------------------------------------

BAD = [
    (HistogramConfig, "cell_size", 0.0),
    (HistogramConfig, "cell_size", nan),
    (HistogramConfig, "cell_size", "0.2"),
    (HistogramConfig, "headings", 0),
    (HistogramConfig, "headings", 7),
    (HistogramConfig, "headings", 72.0),
    (HistogramConfig, "headings", True),
    (HistogramConfig, "headings", 10**9),
    (HistogramConfig, "reading_bin", 0.0),
    (HistogramConfig, "sigma_factor", 0.0),
    (HistogramConfig, "likelihood_power", 0.0),
    (HistogramConfig, "likelihood_power", 1.5),
    (HistogramConfig, "repetition", -1.0),
    (HistogramConfig, "repetition", nan),
    (HistogramConfig, "repetition", -inf),
    (HistogramConfig, "sectors", 0),
    (HistogramConfig, "place_size", 0.0),
    (HistogramConfig, "cell_size", 2.5),
    (HistogramConfig, "contact_floor", 0.0),
    (HistogramConfig, "contact_floor", 1.1),
    (HistogramConfig, "odometry_floor", 0.0),
    (HistogramConfig, "odometry_floor", -0.1),
    (HistogramConfig, "leak", 2.0),
    (HistogramConfig, "novelty", 1.5),
    (HistogramConfig, "least", 0.5),
    (HistogramConfig, "precision", "float16"),
    (HistogramConfig, "slip", -0.1),
    (HistogramConfig, "widen", 0.0),
    (ParticleConfig, "n_min", 0),
    (ParticleConfig, "n_max", 10**9),
    (ParticleConfig, "n_max", 1.5),
    (ParticleConfig, "per_state", -1.0),
    (ParticleConfig, "ess_ratio", 0.0),
    (ParticleConfig, "ess_ratio", 1.5),
    (ParticleConfig, "resampling", "roulette"),
    (ParticleConfig, "sigma_factor", 0.0),
    (ParticleConfig, "likelihood_power", 2.0),
    (ParticleConfig, "roughening_xy", -0.1),
    (ParticleConfig, "roughening_theta", 4.0),
    (ParticleConfig, "reading_bin", inf),
    (ParticleConfig, "repetition", -0.5),
    (ParticleConfig, "sectors", 2.5),
    (ParticleConfig, "place_size", -1.0),
    (ParticleConfig, "contact_floor", 0.0),
    (ParticleConfig, "contact_reach", nan),
    (ParticleConfig, "odometry_floor", 0.0),
    (ParticleConfig, "leak", -0.1),
    (ParticleConfig, "novelty", nan),
    (ParticleConfig, "n_start", 0),
    (ParticleConfig, "n_elsewhere", 0),
    (ParticleConfig, "slip", 1.5),
    (ParticleConfig, "allocation", 0.0),
    (ParticleConfig, "allocation", 1.1),
    (ParticleConfig, "recovery", "sometimes"),
    (ParticleConfig, "widen", 0.0),
    (ParticleConfig, "alpha_slow", 0.2),
    (ParticleConfig, "alpha_fast", 1.5),
    (ParticleConfig, "injection", "walls"),
    (ParticleConfig, "sizing", "guess"),
    (ParticleConfig, "kld_error", 0.0),
    (ParticleConfig, "kld_confidence", 1.0),
    (ParticleConfig, "kld_size", nan),
    (ParticleConfig, "kld_angle", 0.0),
    (ParticleConfig, "directions", -1),
    (BeamModel, "beams", 0),
    (BeamModel, "beams", -1),
    (BeamModel, "beams", True),
    (BeamModel, "beams", 10**9),
    (BeamModel, "beams", 3.0),
    (BeamModel, "field_of_view", 7.0),
    (BeamModel, "field_of_view", -0.1),
    (BeamModel, "z_max", 0.0),
    (BeamModel, "z_max", inf),
    (BeamModel, "sigma_hit", 0.0),
    (BeamModel, "sigma_hit", -0.1),
    (BeamModel, "lambda_short", 0.0),
    (BeamModel, "w_hit", -0.1),
    (BeamModel, "w_rand", inf),
    (BeamModel, "w_max", None),
    (LikelihoodField, "beams", False),
    (LikelihoodField, "field_of_view", nan),
    (LikelihoodField, "z_max", -1.0),
    (LikelihoodField, "sigma_hit", 0.0),
    (LikelihoodField, "w_hit", 1.5),
    (LikelihoodField, "w_rand", "half"),
    (LikelihoodField, "reading_bin", 0.0),
    (MotionModel, "radius", -0.1),
    (MotionModel, "radius", "small"),
    (MotionModel, "contact_ratio", 1.1),
    (MotionModel, "blunder", 1.1),
    (MotionModel, "actuation", None),
    (MotionModel, "odometry", 3.0),
    (MotionModel, "odometry", {"rotation_from_rotation": 0.1}),
    (MotionNoise, "rotation_from_rotation", -0.1),
    (MotionNoise, "rotation_from_translation", nan),
    (MotionNoise, "translation_from_translation", 11.0),
    (MotionNoise, "translation_from_rotation", [0.1]),
    (Task, "kind", "lost"),
    (Task, "confidence", 0.0),
    (Task, "confidence", 1.1),
    (Task, "hold", 0),
    (Task, "let_go", -0.1),
    (Task, "leap", 0.0),
    (Task, "hold", True),
    (Task, "hold", 2.0),
    (Task, "sigma_xy", -1.0),
    (Task, "sigma_theta", 4.0),
    (Task, "kidnap", "sometimes"),
    (Task, "kidnap_rate", 0.0),
    (Task, "kidnap_distance", -1.0),
    (Task, "kidnap_first", 0),
    (Task, "kidnap_last", -3),
    (Task, "kidnap_leak", 1.5),
    (Actions, "kind", "jump"),
    (Actions, "turn", 0.0),
    (Actions, "turn", 4.0),
    (Actions, "forward", -0.5),
    (Actions, "forward", True),
    (Actions, "stay", 1),
    (Actions, "stay", "yes"),
    (RewardWeights, "information", nan),
    (RewardWeights, "step", inf),
    (RewardWeights, "success", "1"),
    (RewardWeights, "wrong", None),
    (ObservationConfig, "headings", 0),
    (ObservationConfig, "rows", 513),
    (ObservationConfig, "cols", 32.0),
    (ObservationConfig, "view", 1),
    (ObservationConfig, "radius", 0),
]


@pytest.mark.parametrize(
    ("cls", "name", "value"), BAD, ids=[f"{c.__name__}.{n}={v!r}" for c, n, v in BAD]
)
def test_bad_values_are_refused_by_name_and_value(cls, name, value):
    with pytest.raises(ConfigError) as refused:
        cls(**{name: value})
    message = str(refused.value)
    assert name in message
    assert repr(value) in message or str(value) in message


def test_every_setting_has_a_bad_value_here():
    covered = {(cls, name) for cls, name, _ in BAD}
    missing = {
        (cls.__name__, item.name)
        for cls in {cls for cls, _ in covered}
        for item in fields(cls)
        if (cls, item.name) not in covered
    }
    mixtures = {("BeamModel", "w_short"), ("LikelihoodField", "w_max")}
    assert missing == mixtures


@pytest.mark.parametrize(
    ("cls", "values", "message"),
    [
        (ParticleConfig, {"n_min": 10, "n_max": 5}, "n_min must be at most .*n_max; got 10 and 5"),
        (Task, {"kidnap_first": 9, "kidnap_last": 5}, "kidnap_first must be at most .* 9 and 5"),
        (BeamModel, {"w_hit": 1.0}, r"must be 1, got 1\.1"),
        (LikelihoodField, {"w_hit": 1.0}, r"must be 1, got 1\.1"),
        (LikelihoodField, {"z_max": 100.0, "reading_bin": 0.001}, "4096"),
    ],
)
def test_values_that_do_not_go_together_are_refused(cls, values, message):
    with pytest.raises(ConfigError, match=message):
        cls(**values)


@pytest.mark.parametrize("cls", sorted({cls for cls, _, _ in BAD}, key=lambda c: c.__name__))
def test_defaults_are_allowed_hashable_and_frozen(cls):
    default = cls()
    assert hash(default) == hash(cls())
    name = fields(cls)[0].name
    with pytest.raises(AttributeError):
        setattr(default, name, getattr(default, name))


def test_numpy_numbers_are_numbers():
    config = HistogramConfig(cell_size=np.float32(0.25), headings=np.int64(24))
    assert config.headings == 24
    assert ParticleConfig(repetition=np.float64(inf)).repetition == inf
    assert BeamModel(field_of_view=2 * pi).beams == BeamModel().beams


def test_config_errors_are_value_errors():
    assert issubclass(ConfigError, ActiveLocError)
    assert issubclass(ActiveLocError, ValueError)
