"""People in the way: the law they cut beams by, what it leaves alone, and the filters' answer."""

from math import sqrt

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from activeloc.cli.settings import make_sweep
from activeloc.envs.episodes import EpisodeConfig
from activeloc.envs.localization import LocalizationEnv
from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps import from_text
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel, LikelihoodField, ProximityModel, ReadingBins, Sonar
from activeloc.sensors.readings import expected_range, rays_of
from activeloc.simulator import Simulator

GRID = from_text("########\n#..#...#\n#......#\n#..#.###\n########", resolution=0.5, name="hut")
COARSE = {"kind": "histogram", "cell_size": 0.25, "headings": 24}
FEW = {"kind": "particles", "n_min": 200, "n_max": 400}
POSE = np.array([1.7, 0.1, 1.2])


def hall():
    cells = np.zeros((40, 56), dtype=np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    cells[10:14, 30:34] = 1
    return OccupancyGrid(cells, 0.05, (0.4, -1.0))


def placed(sensor, people, redraw=None, pose=POSE):
    simulator = Simulator(1, sensor, MotionModel(radius=0.1), redraw, people)
    simulator.place(0, hall(), np.random.default_rng(0), pose)
    return simulator


def exact(beams):
    return BeamModel(beams=beams, z_max=4.0, sigma_hit=1e-6, w_hit=1, w_short=0, w_max=0, w_rand=0)


# --- the law


@pytest.mark.parametrize("people", [0.05, 0.3, 1.0])
def test_their_share_of_the_beams_is_what_is_asked_for(people):
    beams, n = 400, 20
    sensor = exact(beams)
    simulator, rng = placed(sensor, people), np.random.default_rng(1)
    z_expected = sensor.expected(hall(), rays_of(POSE, sensor.bearings))
    scans = np.array([simulator.scan(0, rng) for _ in range(n)])
    short = scans < z_expected - 1e-5
    sigma = sqrt(people * (1.0 - people) / (beams * n))
    assert short.mean() == pytest.approx(people, abs=5 * sigma + 2e-4)
    assert kstest((scans / z_expected)[short], "uniform").pvalue > 1e-6
    error = np.abs(scans - z_expected)[~short]
    assert (error < 1e-5).all()
    if people < 1.0:
        # Neither a beam's neighbour nor its own last scan says whether somebody is there.
        for one, other in ((short[:, 1:], short[:, :-1]), (short[1:], short[:-1])):
            together = np.corrcoef(one.ravel(), other.ravel())[0, 1]
            assert abs(together) < 5 / sqrt(one.size)


@pytest.mark.parametrize("heading", [0.3, 1.2, -2.0])
@pytest.mark.parametrize("kind", [BeamModel, ProximityModel, Sonar, LikelihoodField])
def test_every_sensor_is_cut_by_the_same_law(kind, heading):
    """(1 - people) p(z | x, m) + people uniform(0, z*)."""
    people, n, bins = 0.4, 4000, ReadingBins(1.5, 0.1)
    sensor, pose = kind(beams=n, field_of_view=0.0), np.array([1.7, 0.1, heading])
    simulator = placed(sensor, people, pose=pose)
    scan = simulator.scan(0, np.random.default_rng(2))
    seen = np.bincount(bins.index(scan), minlength=len(bins))
    z_expected = expected_range(sensor, hall(), pose)
    law = (1.0 - people) * sensor.bin_probabilities(hall(), pose, bins).reshape(-1)
    law[:-1] += people * np.diff(np.minimum(z_expected, bins.edges)) / z_expected
    assert law.sum() == pytest.approx(1.0, abs=1e-9)
    often = n * law > 20
    seen, p = np.append(seen[often], seen[~often].sum()), np.append(law[often], law[~often].sum())
    told = p > 0
    assert seen[~told].sum() == 0
    assert chisquare(seen[told], n * p[told] / p[told].sum()).pvalue > 1e-6


@pytest.mark.parametrize("redraw", [None, (0.2, 24)])
def test_without_people_a_scan_draws_what_it_drew_before_there_were_any(redraw):
    """Two blocks of numbers for the readings and for the discrete world's places, and no third."""
    simulator, rng = placed(BeamModel(), 0.0, redraw), np.random.default_rng(4)
    twin = np.random.default_rng(4)
    scan = simulator.scan(0, rng)
    uniforms, places = twin.random((5, 2)), twin.random((5, 4))
    assert rng.bit_generator.state == twin.bit_generator.state
    rays = rays_of(simulator.poses[0], BeamModel().bearings)
    if redraw is not None:
        rays = simulator._redrawn(np.array([0]), places[None])[0]
        rays[:, 2] += BeamModel().bearings
    np.testing.assert_array_equal(scan, BeamModel().read(hall(), rays, uniforms))


def test_people_leave_the_other_beams_as_they_were():
    with_people, without = placed(BeamModel(), 0.3), placed(BeamModel(), 0.0)
    scans = [s.scan(0, np.random.default_rng(9)) for s in (with_people, without)]
    same = scans[0] == scans[1]
    assert 0 < same.sum() < 5


# --- episodes


def env(**settings):
    return LocalizationEnv(**{"map": GRID, "belief": COARSE, **settings})


def play(environment, steps=12, seed=3):
    """Scans, poses and info of an episode that turns and drives."""
    environment.reset(seed=seed)
    scans, poses, info = [environment.knowledge.scan], [environment.pose], {}
    for step in range(steps):
        _, _, terminated, _, info = environment.step((2, 0, 2, 1)[step % 4])
        scans.append(environment.knowledge.scan)
        poses.append(environment.pose)
        if terminated:
            break
    return np.array(scans), np.array(poses), info


@pytest.mark.parametrize("belief", [COARSE, FEW], ids=lambda belief: belief["kind"])
@pytest.mark.parametrize("sensor", ["proximity", "sonar"])
def test_episodes_with_every_sensor(sensor, belief):
    environment = env(
        sensor={"kind": sensor, "beams": 3}, belief=belief, people=0.2, task="tracking"
    )
    observation, _ = environment.reset(seed=0)
    assert environment.observation_space.contains(observation)
    for action in (2, 0, 2, 1):
        observation, reward, _, _, info = environment.step(action)
        assert environment.observation_space.contains(observation)
        assert np.isfinite(reward)
        assert np.isfinite(info["entropy"])
        assert info["impossible"] == 0


def test_no_people_is_the_default():
    assert EpisodeConfig().people == 0.0
    ours, theirs = play(env(people=0)), play(env())
    np.testing.assert_array_equal(ours[0], theirs[0])
    np.testing.assert_array_equal(ours[1], theirs[1])
    assert ours[2] == theirs[2]
    assert ours[2]["dropped"] == 0


@pytest.mark.parametrize("belief", [COARSE, FEW], ids=lambda belief: belief["kind"])
def test_the_novelty_filter_changes_no_luck_and_drops_people(belief):
    """The same scans and poses, whether the filter uses them or not."""
    # Where repeated readings count for nothing, dropping them would be no loss.
    belief = {**belief, "repetition": np.inf}
    settings = {"people": 0.5, "task": "tracking", "belief": belief}
    plain = play(env(**settings))
    settings["belief"] = {**belief, "novelty": 0.99}
    careful = play(env(**settings))
    np.testing.assert_array_equal(plain[0], careful[0])
    np.testing.assert_array_equal(plain[1], careful[1])
    assert plain[2]["dropped"] == 0
    # 13 scans of 5 beams, half of them cut; those that were cut by little are not too short.
    assert 10 <= careful[2]["dropped"] <= 45
    assert careful[2]["entropy"] != plain[2]["entropy"]


def test_hardly_a_beam_is_dropped_where_nobody_is():
    dropped = 0
    for seed in range(3):
        quiet = env(task="tracking", belief={**COARSE, "novelty": 0.99},
                    sensor={"w_hit": 1.0, "w_short": 0.0, "w_max": 0.0, "w_rand": 0.0})  # fmt: skip
        dropped += play(quiet, seed=seed)[2]["dropped"]
    assert dropped <= 0.05 * 3 * 13 * 5


def test_people_and_novelty_are_settings_of_the_command():
    given = ["people=0.3", "belief.novelty=0.99", "sensor.kind=sonar"]
    sweep = make_sweep("PositionTracking-v0", "rooms:0", "particles", ["random"], given, 0, None)
    config = EpisodeConfig.build({**sweep.settings, "map": GRID})
    assert config.people == 0.3
    assert config.belief.novelty == 0.99
    assert isinstance(config.sensor, Sonar)


@pytest.mark.parametrize("people", [-0.1, 1.5, np.nan, "many", True])
def test_shares_that_are_none_are_refused(people):
    with pytest.raises(ConfigError, match=r"people must be a number in \[0, 1\]; got"):
        EpisodeConfig.build({"people": people})
    with pytest.raises(ConfigError, match=r"people must be a number in \[0, 1\]; got"):
        Simulator(1, BeamModel(), MotionModel(), None, people)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"belief": {"novelty": 1.5}}, r"belief\.novelty must be a number in \[0, 1\]; got 1\.5"),
        ({"sensor": "sonra"}, "did you mean 'sonar'"),
        ({"sensor": {"kind": "sonar", "opning": 0.1}}, "did you mean 'opening'"),
        ({"sensor": {"kind": "proximity", "opening": 0.1}}, "unknown name 'opening'"),
        ({"peple": 0.3}, "did you mean 'people'"),
    ],
)
def test_settings_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        env(**settings)
