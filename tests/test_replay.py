"""Filters over recorded runs: a simulated drive with known truth, and the real log."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from activeloc import replay
from activeloc.beliefs.settings import HistogramConfig, ParticleConfig
from activeloc.errors import ConfigError, MapError
from activeloc.grid import OccupancyGrid
from activeloc.logs import Recording, read_log
from activeloc.maps import load_map
from activeloc.motion import MotionModel, MotionNoise, wrap
from activeloc.replay import Replay, ReplayConfig, Row, Run, after, fan, localize, score
from activeloc.sensors import BeamModel, LikelihoodField
from activeloc.simulator import Simulator

DATA = Path(os.environ.get("ACTIVELOC_DATA", Path(__file__).parents[2] / "shared" / "data"))
HUT = """\
############
#....#.....#
#....#.....#
#..........#
#....#.....#
###..####..#
#..........#
############
"""
QUICK = {
    "histogram": {"belief": {"cell_size": 0.4}},
    "particles": {"belief": {"n_min": 2000, "n_max": 20_000}},
}


def hut():
    rows = [[int(letter == "#") for letter in line] for line in HUT.splitlines()]
    cells = np.repeat(np.repeat(np.array(rows[::-1], dtype=np.uint8), 10, axis=0), 10, axis=1)
    return OccupancyGrid(cells, 0.1, name="hut")


def simulated(n_scans=40, seed=0):
    """A drive through the hut: 37 beams over half a turn, odometry that slips and is elsewhere."""
    grid, rng = hut(), np.random.default_rng(seed)
    noise = MotionNoise(0.05, 0.02, 0.03, 0.0)
    sensor = BeamModel(37, np.pi, 20.0, 0.03, 1.0, 0.94, 0.02, 0.02, 0.02)
    robot = Simulator(1, sensor, MotionModel(MotionNoise(), noise, 0.2))
    robot.place(0, grid, rng, np.array([2.0, 1.5, 0.0]))
    reading = np.array([7.0, -3.0, 2.0])
    poses, odometry, scans = [], [], []
    for i in range(n_scans):
        scan = robot.scan(0, rng)
        poses.append(robot.poses[0].copy())
        odometry.append(reading)
        scans.append(np.where(scan >= 20.0, np.inf, scan))
        ahead = scan[16:21].min()
        command = [0.0, 0.4, 0.0] if ahead > 1.0 else [0.4 + 0.1 * (i % 3), 0.0, 0.0]
        u = robot.step(0, np.array(command), rng)
        heading = reading[2] + u[0]
        travel = u[1] * np.array([np.cos(heading), np.sin(heading), 0.0])
        reading = reading + travel + [0.0, 0.0, u[0] + u[2]]
    reference, odometry = np.array(poses), np.array(odometry)
    bearings = np.linspace(-np.pi / 2, np.pi / 2, 37)
    times = 100.0 + 3.0 * np.arange(n_scans)
    return grid, Recording(np.array(scans), bearings, reference, odometry, times, "drive")


@pytest.fixture(scope="module")
def drive():
    return simulated()


@pytest.mark.parametrize("kind", ["histogram", "particles"])
def test_finds_the_robot_from_anywhere(drive, kind):
    grid, recording = drive
    config = ReplayConfig.of(kind, QUICK[kind])
    rows = list(localize(recording, grid, config, 3))
    verdict = score(rows)
    assert verdict.right
    assert verdict.median_m < 0.25
    assert verdict.localized_at < 15
    assert rows[0].entropy > rows[-1].entropy + 1.0
    for row, pose in zip(rows, recording.reference, strict=True):
        offset = row.estimate - pose
        assert row.error_m == pytest.approx(np.hypot(*offset[:2]))
        assert row.error_rad == pytest.approx(abs(float(wrap(offset[2]))))
    assert [row.time for row in rows] == recording.times.tolist()


@pytest.mark.parametrize("kind", ["histogram", "particles"])
def test_the_reference_is_never_looked_at(drive, kind):
    grid, recording = drive
    recording = recording.until(8)
    elsewhere = replace(recording, reference=recording.reference[::-1] + 50.0)
    config = ReplayConfig.of(kind, QUICK[kind])
    for one, other in zip(
        localize(recording, grid, config, 0), localize(elsewhere, grid, config, 0), strict=True
    ):
        np.testing.assert_array_equal(one.estimate, other.estimate)
        assert one.entropy == other.entropy


def test_chance_follows_from_the_seed(drive):
    grid, recording = drive
    config = ReplayConfig.of("particles", QUICK["particles"])

    def estimates(seed):
        rows = localize(recording.until(6), grid, config, seed)
        return np.array([row.estimate for row in rows])

    np.testing.assert_array_equal(estimates(1), estimates(1))
    assert (estimates(1) != estimates(2)).any()


def test_a_kidnapped_robot_is_found_again_and_without_recovery_it_is_not(drive):
    grid, recording = drive
    place = recording.reference[:, :2]
    end = 12 + int(np.hypot(*(place[12:30] - place[9]).T).argmax())
    assert np.hypot(*(place[end] - place[9])) > 3.0
    cut = recording.cut(10, end).until(20)
    config = ReplayConfig.of("histogram", QUICK["histogram"])
    lost = replace(config, belief=replace(config.belief, leak=0.0))
    near = {}
    for name, one in {"recovery": config, "none": lost}.items():
        rows = list(localize(cut, grid, one, 0))
        assert rows[9].is_near
        near[name] = sum(row.is_near for row in after(rows, end))
    assert near["recovery"] >= 8
    assert near["none"] <= 2


def test_the_filter_sees_the_beams_that_its_sensor_says(drive):
    grid, recording = drive
    prepared = Replay(recording, grid, ReplayConfig.of("histogram", {"beams": 13}))
    chosen, _ = fan(recording.bearings, 13)
    np.testing.assert_allclose(prepared.sensor.bearings, recording.bearings[chosen], atol=1e-12)
    expected = recording.scans[:, chosen]
    far = expected >= 8.0
    assert far.any()
    assert np.isposinf(prepared.scans[far]).all()
    np.testing.assert_array_equal(prepared.scans[~far], expected[~far])
    np.testing.assert_array_equal(prepared.controls, recording.controls())


@pytest.mark.parametrize("n", [1, 2, 37, 180, 181, 361, 541])
@pytest.mark.parametrize("beams", [1, 2, 3, 17, 30, 4096])
def test_a_fan_is_even_and_about_straight_ahead(n, beams):
    spacing = np.pi / max(1, n - n % 2)
    bearings = (np.arange(n) - n // 2) * spacing
    chosen, width = fan(bearings, beams)
    used = bearings[chosen]
    assert len(used) <= beams
    assert len(used) % 2 == 1
    np.testing.assert_allclose(used, -used[::-1], atol=1e-9)
    assert width == pytest.approx(used[-1] - used[0])
    steps = np.diff(chosen)
    assert (steps == (steps[0] if len(steps) else 0)).all()
    # One beam a side more, at the next narrower stride, would be too many or is not there.
    if len(steps) and steps[0] > 1:
        assert 2 * ((n // 2 - (n % 2 == 0)) // (steps[0] - 1)) + 1 > beams


def test_a_fan_of_half_steps_is_off_by_no_more_than_half_a_step():
    bearings = np.deg2rad(np.arange(180) - 89.5)
    chosen, width = fan(bearings, 17)
    even = (np.arange(17) / 16 - 0.5) * width
    assert np.abs(bearings[chosen] - even).max() <= np.deg2rad(0.5) + 1e-12


def test_a_laser_that_looks_backwards_is_refused():
    with pytest.raises(ConfigError, match="expected a fan that holds straight ahead"):
        fan(np.linspace(2.0, 4.0, 9), 5)


def rows_of(errors_m, errors_deg=None, first=0):
    errors_deg = np.zeros(len(errors_m)) if errors_deg is None else errors_deg
    return [
        Row(first + i, float(i), np.zeros(3), 1.0, float(m), float(np.deg2rad(d)))
        for i, (m, d) in enumerate(zip(errors_m, errors_deg, strict=True))
    ]


def test_only_the_last_quarter_counts():
    verdict = score(rows_of([9.0] * 75 + [0.2] * 25))
    assert verdict.right
    assert verdict.median_m == 0.2
    assert score(rows_of([9.0] * 3 + [0.2])).right
    assert not score(rows_of([0.2] * 75 + [0.2] * 12 + [9.0] * 13)).right
    assert score(rows_of([0.2] * 75 + [0.2] * 13 + [9.0] * 12)).right
    assert score(rows_of([0.2])).right


@pytest.mark.parametrize(
    ("m", "deg", "right"),
    [(0.49, 9.9, True), (0.51, 0.0, False), (0.0, 10.1, False), (0.51, 11, False)],
)
def test_right_is_near_in_place_and_in_heading(m, deg, right):
    assert score(rows_of([m] * 20, [deg] * 20)).right is right
    assert rows_of([m], [deg])[0].is_near is right


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([0.1] * 10, 0),
        ([0.1] * 9, None),
        ([9.0] * 4 + [0.1] * 10, 4),
        ([0.1] * 9 + [9.0] + [0.1] * 12, 10),
        ([9.0] * 30, None),
        ([0.1] * 10 + [9.0] * 30, 0),
    ],
)
def test_localized_is_ten_scans_running(errors, expected):
    assert score(rows_of(errors)).localized_at == expected


def test_recovery_is_judged_from_where_the_robot_was_set_down(drive):
    grid, recording = drive
    cut = recording.cut(5, 20)
    prepared = Replay(cut, grid, ReplayConfig())
    rows = rows_of([0.1] * 5) + rows_of([9.0] * 6 + [0.1] * 14, first=20)
    run = Run(prepared, rows, 0, (2.0, 1.0), 20)
    assert run.recovery.localized_at == 6
    assert run.score.localized_at == 11
    expected = np.hypot(*(recording.reference[20] - recording.reference[4])[:2])
    assert run.carried_m == pytest.approx(expected)
    assert run.times_faster == pytest.approx(cut.seconds / 2.0)
    assert Run(prepared, rows, 0, (2.0, 1.0)).recovery is None


def test_the_share_on_open_ground_is_counted(drive):
    grid, recording = drive
    outside = replace(recording, reference=recording.reference + [[100.0, 0, 0]] * len(recording))
    assert Replay(recording, grid, ReplayConfig()).on_open_ground() == 1.0
    assert Replay(outside, grid, ReplayConfig()).on_open_ground() == 0.0


def test_settings_are_laid_over_the_defaults():
    config = ReplayConfig.of(
        "particles",
        {
            "beams": 9,
            "sensor": {"kind": "field", "z_max": 6},
            "belief": {"n_min": 77},
            "odometry": {"translation_from_rotation": 0.5},
        },
    )
    assert config.beams == 9
    assert isinstance(config.sensor, LikelihoodField)
    assert (config.sensor.z_max, config.sensor.sigma_hit) == (6, 0.2)
    assert isinstance(config.belief, ParticleConfig)
    assert (config.belief.n_min, config.belief.likelihood_power) == (77, 0.5)
    assert config.odometry.translation_from_rotation == 0.5
    assert config.odometry.rotation_from_rotation == 0.13
    assert ReplayConfig.of("histogram") == ReplayConfig()
    assert isinstance(ReplayConfig().belief, HistogramConfig)
    assert ReplayConfig.of("histogram", {"sensor": "field"}).sensor.w_hit == 0.85


@pytest.mark.parametrize(
    ("belief", "settings", "message"),
    [
        ("histogramm", {}, "did you mean 'histogram'"),
        ("histogram", {"beam": 3}, "did you mean 'beams'"),
        ("histogram", {"beams": 0}, r"beams must be an integer in \[1, 4096\]; got 0"),
        ("histogram", {"radius": -1}, "radius must be a number"),
        ("histogram", {"sensor": "laser"}, "unknown name 'laser'"),
        ("histogram", {"sensor": 3}, "sensor must be one of"),
        ("histogram", {"sensor": {"beams": 3}}, "sensor.beams is the recording's"),
        ("histogram", {"sensor": {"field_of_view": 3}}, "sensor.field_of_view is the recording's"),
        ("histogram", {"sensor": {"zmax": 3}}, "did you mean 'z_max'"),
        ("histogram", {"sensor": {"kind": []}}, r"unknown name \[\]"),
        ("histogram", {"belief": {"n_min": 3}}, "unknown name 'n_min'"),
        ("histogram", {"belief": 3}, "belief must be a HistogramConfig"),
        ("particles", {"belief": {"cell_size": 3}}, "unknown name 'cell_size'"),
        ("particles", {"odometry": {"noise": 3}}, "unknown name 'noise'"),
        ("particles", {"odometry": 3}, "odometry must be a MotionNoise"),
    ],
)
def test_settings_that_cannot_be_are_refused(belief, settings, message):
    with pytest.raises(ConfigError, match=message):
        ReplayConfig.of(belief, settings)


def test_what_cannot_be_run_is_refused(drive):
    grid, recording = drive
    with pytest.raises(MapError, match="fits nowhere"):
        next(localize(recording, grid, ReplayConfig(radius=9.0), 0))
    with pytest.raises(ConfigError, match="seed must be an integer"):
        next(localize(recording, grid, ReplayConfig(), -1))
    with pytest.raises(ConfigError, match="cannot be judged"):
        score([])


@pytest.mark.skipif(
    not (DATA / "logs" / "intel.log").is_file(),
    reason=f"the recorded run is not in {DATA}; set ACTIVELOC_DATA",
)
def test_the_recorded_run_from_its_middle():
    recording = read_log(DATA / "logs" / "intel.log")
    assert (len(recording), round(recording.seconds)) == (910, 2651)
    assert np.isinf(recording.scans).mean() == pytest.approx(0.0255, abs=1e-4)
    grid = load_map(DATA / "maps" / "intel.yaml")
    config = ReplayConfig.of("particles", {"belief": {"n_start": 60_000, "n_max": 60_000}})
    prepared = Replay(recording.from_scan(300).until(60), grid, config)
    assert prepared.on_open_ground() == 1.0
    verdict = replay.score(list(prepared.rows(0)))
    assert verdict.right
    assert verdict.median_m <= 0.15
    assert verdict.localized_at <= 20
