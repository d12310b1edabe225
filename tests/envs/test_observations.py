"""What stands where in an observation: by hand, on a map that is neither square nor symmetric."""

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from activeloc.beliefs import Summary
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.metric_view import MetricView
from activeloc.beliefs.particles import ParticleBelief, ParticleConfig
from activeloc.envs.localization import LocalizationEnv
from activeloc.envs.observations import ObservationConfig, observe
from activeloc.errors import ConfigError
from activeloc.maps import from_text
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel

# 6 m x 3 m from (-1, 2) to (5, 5). The view is the square of 6 m around it, from (-1, 0.5) to
# (5, 6.5): with 6 x 6 pixels each is a metre wide, and pixel row 0 lies between y = 0.5 and 1.5.
GRID = from_text(
    """
############
#..........#
#.......##.#
#..#....##.#
#..#......?#
############
""",
    resolution=0.5,
    origin=(-1.0, 2.0),
    name="yard",
)
# Free cells of each pixel, top row of pixels (y from 5.5 to 6.5) first; a pixel has four cells.
# The map's lowest half metre is the upper half of pixel row 1, its highest the lower half of row 4.
FREE_CELLS = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0],
        [2, 4, 4, 4, 2, 2],
        [2, 2, 4, 4, 2, 1],
        [0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0],
    ]
)
CONFIG = ObservationConfig(headings=8, rows=6, cols=6)
SENSOR, MOTION = BeamModel(), MotionModel()
# Poses in the middle of cells of half a metre and of 16 heading bins, and the pixel of each:
# heading bin floor((theta + pi) / (pi / 4)), row floor(y - 0.5), column floor(x + 1).
PLACES = {
    "lower left": ((-0.25, 2.75, -np.pi + np.pi / 16), (0, 2, 0)),
    "upper left": ((-0.25, 4.25, -np.pi / 2 + np.pi / 16), (2, 3, 0)),
    "upper right": ((4.25, 4.25, np.pi / 16), (4, 3, 5)),
    "below the pillar": ((2.75, 2.75, np.pi / 2 - np.pi / 16), (5, 2, 3)),
    "just under pi": ((1.25, 3.75, np.pi - np.pi / 16), (7, 3, 2)),
}


def histogram(masses):
    """A belief with the given masses at the given poses."""
    belief = HistogramBelief(1, HistogramConfig(cell_size=0.5, headings=16), SENSOR, MOTION)
    belief.reset(0, GRID)
    prior = np.zeros_like(belief.probabilities(0))
    for pose, mass in masses:
        cell, heading = belief.poses(0).states_of(np.array([pose]))
        prior[cell, heading] += mass
    belief.reset(0, GRID, prior)
    return belief


def particles(masses):
    """As many particles at each pose as its mass says, of a hundred."""
    belief = ParticleBelief(1, ParticleConfig(), SENSOR, MOTION)
    poses = np.concatenate([np.tile(pose, (round(100 * mass), 1)) for pose, mass in masses])
    belief.reset(0, GRID, np.random.default_rng(0), poses)
    return belief


def seen(belief, *, scan=(1.0, 1.0, 1.0), u=(0.0, 0.0, 0.0), touched=False, summary=None):
    summary = summary or Summary(1.0, 4.0, np.zeros(3), 0.5)
    return only(CONFIG, belief, summary, scan, u, touched)


def only(config, belief, summary, scan, u, touched):
    """What the only robot observes."""
    result = observe(config, belief, np.array([0]), [summary], np.array([scan]), 1.5,
                     np.array([u]), np.array([touched]))  # fmt: skip
    return {name: value[0] for name, value in result.items()}


both = pytest.mark.parametrize("make", [histogram, particles])


@both
@pytest.mark.parametrize("name", PLACES)
def test_mass_is_seen_where_it_is(make, name):
    pose, pixel = PLACES[name]
    planes = seen(make([(pose, 1.0)]))["belief"]
    expected = np.zeros((8, 6, 6))
    expected[pixel] = 1.0
    np.testing.assert_array_equal(planes, expected)


@both
def test_a_quarter_of_the_peak_is_seen_as_a_half(make):
    masses = dict(zip(PLACES, [0.2, 0.05, 0.5, 0.2, 0.05], strict=True))
    planes = seen(make([(PLACES[name][0], mass) for name, mass in masses.items()]))["belief"]
    expected = np.zeros((8, 6, 6))
    for name, mass in masses.items():
        expected[PLACES[name][1]] = np.sqrt(mass / 0.5)
    np.testing.assert_allclose(planes, expected, atol=1e-6)


@both
def test_masses_of_one_pixel_add_up(make):
    """Two cells, two heading bins, one pixel; and another pixel with half of their mass."""
    poses = [(1.25, 3.75, 0.1), (1.75, 4.25, 0.7), (2.25, 4.25, 0.1)]
    planes = seen(make([(pose, mass) for pose, mass in zip(poses, (0.4, 0.2, 0.3), strict=True)]))
    assert planes["belief"][4, 3, 2] == 1.0
    assert planes["belief"][4, 3, 3] == pytest.approx(np.sqrt(0.5), abs=1e-6)
    assert (planes["belief"] > 0).sum() == 2


@both
def test_the_map_is_the_share_of_free_ground(make):
    """Row 0 is the lowest: y grows with the rows, x with the columns. Unknown is not free."""
    shares = seen(make([(PLACES["lower left"][0], 1.0)]))["map"]
    np.testing.assert_allclose(shares, FREE_CELLS[::-1] / 4.0)


def test_other_numbers_of_pixels_keep_the_shapes_undistorted():
    """3 rows and 12 columns: pixels of a metre, and the 12 m x 3 m they cover lie centrally."""
    belief = histogram([(PLACES["upper right"][0], 1.0)])
    config = ObservationConfig(headings=4, rows=3, cols=12)
    summary = Summary(1.0, 4.0, np.zeros(3), 0.5)
    result = only(config, belief, summary, np.ones(3), np.zeros(3), False)
    assert np.argwhere(result["belief"]).tolist() == [[2, 2, 8]]
    assert result["map"].sum() * 1.0 == pytest.approx(GRID.free.sum() * 0.25)
    assert not result["map"][:, :3].any()
    assert not result["map"][:, 9:].any()


@both
def test_a_scan_is_a_share_of_the_longest_range(make):
    scan = seen(make([(PLACES["lower left"][0], 1.0)]), scan=[0.75, np.nan, np.inf])["scan"]
    np.testing.assert_array_equal(scan, np.array([0.5, -1.0, 1.0], np.float32))
    scan = seen(make([(PLACES["lower left"][0], 1.0)]), scan=[0.0, 1.5, 0.3])["scan"]
    np.testing.assert_allclose(scan, [0.0, 1.0, 0.2], atol=1e-7)


def test_the_scalars():
    belief = histogram([(PLACES["lower left"][0], 1.0)])
    summary = Summary(1.2, 4.8, np.zeros(3), 0.625)
    values = seen(belief, u=[np.pi / 6, 0.4, -np.pi / 12], touched=True, summary=summary)
    np.testing.assert_allclose(values["scalars"], [0.25, 0.625, 1.0, 1 / 12, 0.4], atol=1e-7)
    values = seen(belief, u=[-4.0, 2.5, 0.0], summary=Summary(4.9, 4.8, np.zeros(3), 0.0))
    np.testing.assert_allclose(values["scalars"], [1.0, 0.0, 0.0, -1.0, 1.0])
    values = seen(belief, u=[0.0, -0.02, 0.0], summary=Summary(0.0, 0.0, np.zeros(3), 1.0))
    np.testing.assert_allclose(values["scalars"], [0.0, 1.0, 0.0, 0.0, -0.02], atol=1e-7)


@both
def test_an_observation_is_a_new_object(make):
    belief = make([(PLACES["lower left"][0], 1.0)])
    before = seen(belief)
    for value in seen(belief).values():
        value[...] = 9.0
    for key, value in seen(belief).items():
        np.testing.assert_array_equal(value, before[key])


@pytest.mark.parametrize("kind", ["histogram", "particles"])
@pytest.mark.parametrize("name", PLACES)
def test_the_environment_shows_a_robot_that_knows_its_place_there(kind, name):
    pose, pixel = PLACES[name]
    env = LocalizationEnv(
        map=GRID,
        task={"kind": "tracking", "sigma_xy": 1e-3, "sigma_theta": 1e-3},
        belief={"kind": kind, **({"cell_size": 0.1} if kind == "histogram" else {"n_min": 200})},
        observation={"headings": 8, "rows": 6, "cols": 6},
    )
    observation, info = env.reset(seed=0, options={"pose": pose})
    peak = np.unravel_index(observation["belief"].argmax(), (8, 6, 6))
    assert tuple(int(i) for i in peak) == pixel
    assert info["error_m"] < 0.15
    np.testing.assert_allclose(observation["map"], FREE_CELLS[::-1] / 4.0)


def test_the_environment_says_what_it_touched_and_how_far_it_went():
    quiet = {"actuation": {}, "odometry": {}}
    env = LocalizationEnv(map=GRID, belief={"kind": "particles", "n_min": 200, "n_max": 500},
                          motion=quiet)  # fmt: skip
    observation, _ = env.reset(seed=0, options={"pose": (1.25, 3.75, 0.0)})
    np.testing.assert_array_equal(observation["scalars"][2:], [0.0, 0.0, 0.0])
    np.testing.assert_allclose(env.step(2)[0]["scalars"][2:], [0.0, 0.0, 0.5], atol=1e-6)
    np.testing.assert_allclose(env.step(0)[0]["scalars"][2:], [0.0, 1 / 6, 0.0], atol=1e-6)
    np.testing.assert_allclose(env.step(1)[0]["scalars"][2:], [0.0, -1 / 6, 0.0], atol=1e-6)
    # The free cells end at x = 3, where the pillar begins.
    env.reset(options={"pose": (2.75, 3.75, 0.0)})
    observation, _, _, _, info = env.step(2)
    np.testing.assert_allclose(observation["scalars"][2:], [1.0, 0.0, 0.25], atol=1e-5)
    assert info["touched"]


@pytest.mark.parametrize("name", ["headings", "rows", "cols"])
@pytest.mark.parametrize("value", [0, -1, 2.0, True, None, 100_000])
def test_a_resolution_that_is_none_is_refused(name, value):
    with pytest.raises(ConfigError, match=rf"observation\.{name} must be an integer"):
        ObservationConfig(**{name: value})


@pytest.mark.parametrize("kind", ["histogram", "particles"])
def test_the_egocentric_view_is_there_for_the_asking(kind):
    grid, cloud = {"cell_size": 0.25, "headings": 36}, {"n_min": 2_000, "n_max": 6_000}
    settings = grid if kind == "histogram" else cloud
    env = LocalizationEnv(
        map=GRID, belief={"kind": kind, **settings}, observation={"view": True, "radius": 3}
    )
    check_env(env, skip_render_check=True)
    observation, _ = env.reset(seed=3)
    shapes = {key: observation[key].shape for key in ("view", "ways", "place")}
    assert shapes == {"view": (5, 7, 7), "ways": (2, 12, 9), "place": (24,)}
    # After a step it is the view of the belief as it is then, and of a new object.
    after = env.step(0)[0]
    knows = env.knowledge
    again = MetricView(knows.belief, knows.sensor, 3).draw(0)
    for key, part in again.items():
        np.testing.assert_array_equal(after[key], part)
        assert not np.array_equal(after[key], observation[key])
    for name, value in (("view", 1), ("radius", 0), ("radius", 4.0)):
        with pytest.raises(ConfigError, match=rf"observation\.{name} must be"):
            ObservationConfig(**{name: value})
