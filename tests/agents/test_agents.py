"""What agents may look at, what they choose, and the expectation that planners choose by."""

import hashlib
import itertools
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401  (registers the ids)
from activeloc.agents import (
    AGENTS,
    GreedyAgent,
    SpinAgent,
    imagination,
    make_agent,
)
from activeloc.agents.commands import FORWARD, LEFT, RIGHT, action_for
from activeloc.agents.imagination import (
    Imagined,
    expected_entropy,
    expected_gain,
    sampled_entropy,
)
from activeloc.beliefs.common_bins import entropy
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.envs.actions import Actions
from activeloc.envs.episodes import Knowledge
from activeloc.errors import ConfigError
from activeloc.maps import from_text
from activeloc.motion import MotionModel, MotionNoise
from activeloc.sensors import BeamModel

MAP = "rooms(width=6,height=5,resolution=0.1):1"
BELIEFS = {
    "histogram": {"kind": "histogram", "cell_size": 0.25, "headings": 36},
    "particles": {"kind": "particles", "n_min": 200, "n_max": 500},
}
IDS = sorted(id for id in gym.registry if id.startswith("activeloc/") and "Maze" not in id)
GLOBAL = "activeloc/GlobalLocalization-v0"
QUICK = {
    "random": {},
    "spin": {},
    "greedy": {"samples": 60, "readings": 4},
    "lookahead": {"steps": 2, "samples": 60, "readings": 4},
    "active": {"samples": 60, "readings": 4, "bearings": 6},
    "glance": {},
}
NO_NOISE = MotionModel(MotionNoise(), MotionNoise())
BLIND = BeamModel(w_hit=0.0, w_short=0.0, w_max=1.0, w_rand=0.0)


def make(id=GLOBAL, belief="particles", **settings):
    return gym.make(id, map=MAP, belief=BELIEFS[belief], **settings).unwrapped


def quick(name, seed=0):
    agent = make_agent(name, QUICK[name])
    agent.reset(np.random.default_rng(seed))
    return agent


def state_of(env):
    return hashlib.sha256(pickle.dumps(env)).hexdigest()


def believing(grid, masses, *, sensor=None, motion=NO_NOISE, actions=None, **config):
    """What a robot knows that gives poses ``[(pose, mass), ...]`` some mass: uniform if None."""
    sensor = sensor or BeamModel(beams=3, field_of_view=np.pi / 3.0, z_max=1.5)
    config = {"cell_size": 0.5, "headings": 12, "repetition": float("inf"), **config}
    belief = HistogramBelief(1, HistogramConfig(**config), sensor, motion)
    belief.reset(0, grid)
    if masses is not None:
        prior = np.zeros(belief.probabilities(0).shape)
        for pose, mass in masses:
            cell, heading = belief.poses(0).states_of(np.array([pose], dtype=np.float64))
            prior[cell, heading] += mass
        belief.reset(0, grid, prior / prior.sum())
    scan = np.full(len(sensor.bearings), sensor.z_max)
    return Knowledge(belief, 0, actions or Actions(), motion, sensor, belief.summarise(0), scan,
                     np.zeros(3), False, 0)  # fmt: skip


# --- every agent, everywhere


def test_the_quick_settings_are_of_every_agent():
    assert QUICK.keys() == AGENTS.keys()


@pytest.mark.parametrize("name", AGENTS)
@pytest.mark.parametrize(("id", "belief"), list(itertools.product(IDS, BELIEFS)))
def test_it_acts_in_the_action_space_and_only_looks(id, belief, name):
    env, agent = make(id, belief), quick(name)
    observation, _ = env.reset(seed=1)
    quick(name).act(observation, env.knowledge)  # What the map's tables keep for later is no state.
    for _ in range(4):
        before = state_of(env)
        action = agent.act(observation, env.knowledge)
        assert state_of(env) == before
        assert env.action_space.contains(action)
        observation, _, over, _, _ = env.step(action)
        if over:
            break


@pytest.mark.parametrize("name", sorted(set(AGENTS) - {"greedy", "lookahead"}))
def test_it_acts_in_the_continuous_space(name):
    env, agent = make(actions="continuous"), quick(name)
    observation, _ = env.reset(seed=1)
    for _ in range(4):
        action = agent.act(observation, env.knowledge)
        assert env.action_space.contains(action)
        observation = env.step(action)[0]


def test_greedy_says_that_it_needs_a_table_of_actions():
    env = make(actions="continuous")
    observation, _ = env.reset(seed=1)
    with pytest.raises(ConfigError, match="greedy needs discrete actions"):
        quick("greedy").act(observation, env.knowledge)


@pytest.mark.parametrize("belief", BELIEFS)
@pytest.mark.parametrize("name", AGENTS)
def test_it_does_not_see_the_truth(name, belief):
    """The true poses are made NaN, then somebody else's, while it chooses."""
    env, agents = make(belief=belief, task={"hold": 1000}), [quick(name, 5) for _ in range(3)]
    observation, _ = env.reset(seed=2)
    poses = env._episodes.simulator.poses
    for _ in range(18 if name == "spin" else 5):
        truth, choices = poses.copy(), []
        for agent, shown in zip(agents, (truth, np.full((1, 3), np.nan), truth + 1.0), strict=True):
            poses[...] = shown
            choices.append(agent.act(observation, env.knowledge))
        poses[...] = truth
        assert choices[0] == choices[1] == choices[2]
        observation = env.step(choices[0])[0]


def test_planners_plan_with_what_the_filter_assumes():
    """Not with what is true."""
    env = make(
        sensor={"sigma_hit": 0.1},
        filter_sensor={"sigma_hit": 0.3},
        motion={"radius": 0.2},
        filter_motion={"radius": 0.1},
    )
    env.reset(seed=0)
    assert env.knowledge.sensor.sigma_hit == 0.3
    assert env.knowledge.motion.radius == env.knowledge.belief.terrain(0).radius == 0.1
    assert env._episodes.simulator.sensor.sigma_hit == 0.1
    assert env._episodes.simulator.terrain(0).radius == 0.2


@pytest.mark.parametrize("name", AGENTS)
def test_one_seed_one_episode(name):
    def episode(seed):
        env, agent = make(), quick(name, seed)
        observation, _ = env.reset(seed=3)
        actions = []
        for _ in range(25):
            actions.append(agent.act(observation, env.knowledge))
            observation, _, over, _, _ = env.step(actions[-1])
            if over:
                break
        return actions

    assert episode(1) == episode(1)
    if name == "random":
        assert episode(1) != episode(2)


@pytest.mark.parametrize("name", AGENTS)
def test_a_reset_agent_remembers_nothing(name):
    env, agent, fresh = make(), quick(name), quick(name, seed=7)
    observation, _ = env.reset(seed=4)
    for _ in range(5):
        agent.act(observation, env.knowledge)
    agent.reset(np.random.default_rng(7))
    for _ in range(14):
        assert agent.act(observation, env.knowledge) == fresh.act(observation, env.knowledge)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("gredy", {}, "did you mean 'greedy'"),
        ("", {}, "unknown name ''"),
        ("greedy", {"sample": 3}, "agent greedy: unknown name 'sample'; did you mean 'samples'"),
        ("active", {"bearing": 3}, "did you mean 'bearings'"),
        ("random", {"rng": 3}, "agent random: unknown name 'rng'"),
        ("spin", {"_turned": 1.0}, "unknown name '_turned'"),
        ("greedy", {"samples": 1}, r"samples must be an integer in \[2, 1000000\]; got 1"),
        ("greedy", {"samples": 2.5}, "samples must be an integer"),
        ("greedy", {"readings": 0}, "readings must be an integer"),
        ("greedy", {"readings": True}, "readings must be an integer"),
        ("active", {"samples": "800"}, "samples must be an integer"),
        ("active", {"bearings": 0}, "bearings must be an integer"),
        ("active", {"step_cost": -0.1}, "step_cost must be a number"),
        ("active", {"step_cost": np.nan}, "step_cost must be a number"),
        ("active", {"certainty_share": 1.5}, "certainty_share must be a number"),
        ("active", {"distances": (1.0, -2.0)}, "distances must be a number"),
        ("active", {"distances": 2.0}, "distances must"),
        ("active", {"distances": ()}, "distances must"),
        ("spin", {"clearance": "far"}, "clearance must be a number"),
        ("spin", {"clearance": -1.0}, "clearance must be a number"),
    ],
    ids=str,
)
def test_names_and_settings_that_are_none_are_refused(name, settings, message):
    with pytest.raises(ConfigError, match=message):
        make_agent(name, settings)


@pytest.mark.parametrize("kind", ["discrete", "continuous"])
def test_moves_are_the_full_step_of_either_space(kind):
    actions = Actions(kind, turn=0.4, forward=0.7)
    commands = [actions.command(action_for(actions, move)) for move in (LEFT, RIGHT, FORWARD)]
    np.testing.assert_allclose(commands, [[0.4, 0, 0], [-0.4, 0, 0], [0, 0.7, 0]], atol=1e-7)


def test_random_is_uniform():
    env, agent = make(actions="discrete+stay"), quick("random")
    observation, _ = env.reset(seed=1)
    count = np.bincount([agent.act(observation, env.knowledge) for _ in range(2000)])
    assert np.abs(count - 500).max() < 4 * np.sqrt(2000 * 0.25 * 0.75)


# --- spin


HALL = from_text("########\n#......#\n#......#\n#...##.#\n########", resolution=0.5, name="hall")


def spun(**seen):
    """A spin agent that has turned once around, and what it knows."""
    agent, knowledge = SpinAgent(), replace(believing(HALL, None), **seen)
    agent.reset(np.random.default_rng(3))
    assert [agent.act({}, knowledge) for _ in range(12)] == [LEFT] * 12
    return agent, knowledge


@pytest.mark.parametrize(("turn", "n"), [(30.0, 12), (45.0, 8), (50.0, 8), (180.0, 2)])
def test_spin_turns_once_around_then_drives(turn, n):
    knowledge = believing(HALL, None, actions=Actions(turn=float(np.deg2rad(turn))))
    agent = SpinAgent()
    agent.reset(np.random.default_rng(0))
    moves = [agent.act({}, knowledge) for _ in range(n + 3)]
    assert moves == [LEFT] * n + [FORWARD] * 3


@pytest.mark.parametrize("ahead", [np.nan, 0.46, 1.5, np.inf])
def test_spin_drives_where_the_way_ahead_is_clear(ahead):
    """The beams to the sides may read what they want."""
    agent, knowledge = spun(scan=np.array([0.1, ahead, 0.1]))
    assert agent.act({}, knowledge) == FORWARD


@pytest.mark.parametrize(
    "seen", [{"scan": np.array([1.5, 0.44, 1.5])}, {"touched": True}], ids=["near", "touched"]
)
def test_spin_turns_at_a_wall_to_one_side_until_the_way_is_clear(seen):
    agent, clear = spun()
    sides = set()
    for _ in range(20):
        moves = {agent.act({}, replace(clear, **seen)) for _ in range(4)}
        assert len(moves) == 1
        sides |= moves
        assert agent.act({}, clear) == FORWARD
    assert sides == {LEFT, RIGHT}


# --- the expectation, against exact enumeration

# Three by two free cells of half a metre, and a niche: no two look alike in all directions.
TINY = from_text("#####\n#..##\n#...#\n#####", resolution=0.5, name="tiny")


def tiny(beams, seed=0, motion=NO_NOISE, **config):
    """A random belief over few poses, with readings in four bins: (knowledge, states' masses)."""
    sensor = BeamModel(beams=beams, field_of_view=np.pi / 2, z_max=1.2, w_hit=0.7, w_rand=0.22)
    knowledge = believing(TINY, None, sensor=sensor, motion=motion,
                          **{"reading_bin": 0.4, **config})  # fmt: skip
    belief = knowledge.belief
    p = np.random.default_rng(seed).dirichlet(np.full(belief.probabilities(0).size, 0.3))
    belief.reset(0, TINY, p.reshape(belief.probabilities(0).shape))
    return replace(knowledge, summary=belief.summarise(0)), p


def states(knowledge):
    """``(S, 3)``: a pose in the middle of each state, in the order of the masses."""
    grid = knowledge.belief.poses(0)
    xy = np.repeat(grid.centres, grid.headings, axis=0)
    return np.column_stack([xy, np.tile(grid.thetas, len(grid.centres))])


def exact_entropy(knowledge, poses, p, weights=None):
    """Expected entropy of the posterior over the bins: a sum over every scan there can be."""
    rows, log_p = knowledge.belief.forecast(0, poses)
    bins = np.unique(knowledge.belief.bins(0).index(poses), return_inverse=True)[1]
    weights = np.ones(rows.shape[1]) if weights is None else weights
    weights = knowledge.belief.config.likelihood_power * weights
    expected = 0.0
    for scan in itertools.product(range(len(log_p)), repeat=rows.shape[1]):
        log_lik = np.array([log_p[z, rows[:, b]] for b, z in enumerate(scan)], dtype=np.float64)
        evidence = p * np.exp(log_lik.sum(axis=0))
        posterior = np.bincount(bins, p * np.exp(weights @ log_lik))
        expected += evidence.sum() * entropy(posterior / posterior.sum())
    return expected


def test_the_tiny_world_has_one_state_a_bin():
    knowledge, p = tiny(2)
    poses = states(knowledge)
    assert len(set(knowledge.belief.bins(0).index(poses))) == len(poses) == len(p) == 60
    assert len(knowledge.belief.forecast(0, poses)[1]) == 4
    assert exact_entropy(knowledge, poses, p) < entropy(p)


@pytest.mark.parametrize("beams", [1, 2])
def test_the_expected_entropy_is_that_of_all_scans(beams, monkeypatch):
    """Given the hypotheses, the sum over readings is exact and the draws are unbiased."""
    knowledge, _ = tiny(beams)
    rng = np.random.default_rng(1)
    here = Imagined.here(knowledge, 150, rng)
    exact = exact_entropy(knowledge, here.poses, np.full(150, 1 / 150))
    assert expected_entropy(knowledge, here, 1, rng) == pytest.approx(exact, abs=1e-9)
    monkeypatch.setattr(imagination, "EXACT_UP_TO", 0)
    drawn = [expected_entropy(knowledge, here, 200, rng) for _ in range(200)]
    error = np.std(drawn) / np.sqrt(len(drawn))
    assert error < 0.004
    assert np.mean(drawn) == pytest.approx(exact, abs=4 * error)


@pytest.mark.parametrize("beams", [1, 2])
def test_with_many_samples_the_gain_is_that_of_the_belief(beams):
    knowledge, p = tiny(beams, seed=beams)
    exact = entropy(p) - exact_entropy(knowledge, states(knowledge), p)
    here = Imagined.here(knowledge, 6000, np.random.default_rng(1))
    gain = expected_gain(knowledge, here, 3000, np.random.default_rng(2))
    assert gain == pytest.approx(exact, abs=0.04)
    assert exact > 0.05


def test_the_error_falls_like_the_root_of_the_readings(monkeypatch):
    monkeypatch.setattr(imagination, "EXACT_UP_TO", 0)
    knowledge, _ = tiny(2)
    here = Imagined.here(knowledge, 100, np.random.default_rng(1))
    exact = exact_entropy(knowledge, here.poses, np.full(100, 0.01))
    sizes, rng = np.array([8, 32, 128, 512]), np.random.default_rng(2)
    errors = [
        np.sqrt(np.mean([(expected_entropy(knowledge, here, n, rng) - exact) ** 2
                         for _ in range(80)]))
        for n in sizes.tolist()
    ]  # fmt: skip
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.1)


def test_the_error_falls_at_least_like_the_root_of_both_numbers_of_samples():
    """The grid's samples are systematic over its states: on so few, they are sooner exact."""
    knowledge, p = tiny(2)
    exact = entropy(p) - exact_entropy(knowledge, states(knowledge), p)
    errors, rng = [], np.random.default_rng(3)
    for samples, readings in ((200, 8), (800, 32), (3200, 128)):
        gains = [
            expected_gain(knowledge, Imagined.here(knowledge, samples, rng), readings, rng)
            for _ in range(30)
        ]
        errors.append(np.sqrt(np.mean((np.array(gains) - exact) ** 2)))
    slope = np.polyfit(np.log([1, 4, 16]), np.log(errors), 1)[0]
    assert slope < -0.35


@pytest.mark.parametrize("seed", range(8))
def test_a_scan_is_never_expected_to_tell_less_than_nothing(seed):
    knowledge, _ = tiny(2, seed=seed)
    rng = np.random.default_rng(seed)
    here = Imagined.here(knowledge, 400, rng)
    gains = [expected_gain(knowledge, here, 200, rng) for _ in range(5)]
    assert min(gains) > -4 * np.std(gains) - 0.02


def test_a_blind_scan_tells_nothing():
    knowledge = believing(HALL, None, sensor=BLIND)
    here = Imagined.here(knowledge, 300, np.random.default_rng(0))
    gain = expected_gain(knowledge, here, 20, np.random.default_rng(1))
    assert gain == pytest.approx(0.0, abs=1e-9)


def test_a_reading_that_was_taken_before_tells_as_much_as_the_filter_lets_it():
    """With repetition 0 a direction read twice says nothing; with 1 less than with infinity."""
    gains = {}
    for repetition in (0.0, 1.0, float("inf")):
        knowledge, _ = tiny(2, repetition=repetition)
        knowledge.belief.place(0).read(knowledge.sensor.bearings)
        here = Imagined.here(knowledge, 300, np.random.default_rng(1))
        weights = here.place_if_free.weigh(knowledge.sensor.bearings)
        gains[repetition] = expected_gain(knowledge, here, 4000, np.random.default_rng(2))
        before = sampled_entropy(knowledge, here.poses)
        exact = before - exact_entropy(knowledge, here.poses, np.full(300, 1 / 300), weights)
        assert gains[repetition] == pytest.approx(exact, abs=0.03)
    assert gains[0.0] == pytest.approx(0.0, abs=1e-6)
    assert 0.02 < gains[1.0] < gains[float("inf")] - 0.02


@pytest.mark.parametrize(
    ("news", "expected"), [(False, np.log(2.0)), (True, entropy(np.array([1.0, 0.05]) / 1.05))]
)
def test_being_stopped_tells_the_stopped_from_the_free(news, expected):
    """Two poses, a blind sensor: a touch that is news leaves a twentieth of doubt."""
    knowledge = believing(HALL, None, sensor=BLIND)
    place = knowledge.belief.place(0)
    poses = np.array([[0.75, 0.75, 0.0], [2.75, 1.75, 0.0]])
    imagined = Imagined(poses, np.array([True, False]), place, place, news)
    rng = np.random.default_rng(0)
    assert expected_entropy(knowledge, imagined, 10, rng) == pytest.approx(expected)


# --- hypotheses that walk


def test_hypotheses_walk_until_a_wall_stops_them():
    """The first stands a quarter of a metre from a wall; stopped, it stays there, but it turns."""
    poses = [(1.75, 0.75, np.pi / 12), (0.75, 1.75, np.pi / 12)]
    knowledge = believing(HALL, [(pose, 0.5) for pose in poses])
    rng, east = np.random.default_rng(0), np.array([0.0, 0.5, 0.0])
    here = Imagined.here(knowledge, 2, rng)
    at = np.array([[1.75, 0.75, 0.0], [0.75, 1.75, 0.0]])
    here = replace(here, poses=at)
    once = here.after(knowledge, east, rng)
    np.testing.assert_allclose(once.poses, [[2.0, 0.75, 0.0], [1.25, 1.75, 0.0]], atol=1e-5)
    assert once.stopped.tolist() == [True, False]
    assert once.news
    twice = once.after(knowledge, east, rng, times=2)
    np.testing.assert_allclose(twice.poses, [[2.0, 0.75, 0.0], [2.25, 1.75, 0.0]], atol=1e-5)
    turned = twice.after(knowledge, np.array([np.pi / 6, 0.0, 0.0]), rng, times=3)
    np.testing.assert_allclose(turned.poses[:, 2], np.pi / 2, atol=1e-9)
    np.testing.assert_allclose(turned.poses[:, :2], twice.poses[:, :2], atol=1e-9)
    further = turned.after(knowledge, 0.5 * east, rng)
    np.testing.assert_allclose(further.poses[0], turned.poses[0])  # Its walk has ended.
    np.testing.assert_allclose(further.poses[1, :2], [2.25, 2.0], atol=1e-5)
    np.testing.assert_array_equal(here.poses, at)
    assert not here.stopped.any()
    assert twice.after(knowledge, east, rng, times=0) is twice


def test_walks_of_several_steps_stray_as_far_as_their_steps_together():
    motion = MotionModel(MotionNoise(), MotionNoise(0.1, 0.0, 0.1, 0.0))
    knowledge = believing(HALL, [((0.75, 1.75, 0.0), 1.0)], motion=motion)
    rng = np.random.default_rng(0)
    here = Imagined.here(knowledge, 20_000, rng)
    turned = here.after(knowledge, np.array([0.5, 0.0, 0.0]), rng, times=4)
    assert np.std(turned.poses[:, 2] - here.poses[:, 2]) == pytest.approx(0.1, rel=0.03)
    assert np.mean(turned.poses[:, 2] - here.poses[:, 2]) == pytest.approx(2.0, abs=0.005)
    at = replace(here, poses=np.tile([0.75, 1.75, 0.0], (20_000, 1)))
    driven = at.after(knowledge, np.array([0.0, 0.3, 0.0]), rng, times=4)
    assert np.std(driven.poses[:, 0]) == pytest.approx(0.06, rel=0.03)
    assert np.mean(driven.poses[:, 0]) == pytest.approx(1.95, abs=0.005)


def test_imagination_leaves_the_place_s_memory_alone():
    knowledge = believing(HALL, None)
    place = knowledge.belief.place(0)
    place.read(knowledge.sensor.bearings)
    before = pickle.dumps(place)
    here = Imagined.here(knowledge, 50, np.random.default_rng(0))
    there = here.after(knowledge, np.array([0.0, 0.5, 0.0]), np.random.default_rng(0))
    there.place_if_free.refuse()
    there.place_if_stopped.refuse()
    assert pickle.dumps(place) == before
    assert there.place_if_free.readings.sum() == 0  # It is elsewhere then,
    assert there.place_if_stopped.readings.sum() == 3  # or still here.


# --- greedy


@pytest.mark.parametrize("beams", [1, 2])
def test_greedy_expects_of_each_turn_what_enumeration_says(beams):
    """Turns of one heading bin without noise: the masses move by one heading."""
    knowledge, p = tiny(beams, seed=4)
    agent = GreedyAgent(samples=6000, readings=3000)
    agent.reset(np.random.default_rng(0))
    gains = agent.expected_gains(knowledge)
    masses = p.reshape(-1, 12)
    for action, shift in ((LEFT, 1), (RIGHT, -1)):
        turned = np.roll(masses, shift, axis=1).ravel()
        exact = entropy(p) - exact_entropy(knowledge, states(knowledge), turned)
        assert gains[action] == pytest.approx(exact, abs=0.04)


@pytest.mark.parametrize(("towards", "expected"), [(LEFT, LEFT), (RIGHT, RIGHT)])
def test_greedy_looks_where_the_hypotheses_differ(towards, expected):
    """South of one a wall is near, south of the other it is farther; west, east, north are alike.

    A robot that looks west must turn left to look south, one that looks east right.
    """
    sensor = BeamModel(beams=1, z_max=1.0)
    actions = Actions(turn=np.pi / 2, forward=0.5)
    lines = ["############", "#..........#", "#..........#", "######.....#", "############"]
    grid = from_text("\n".join(lines), resolution=0.5)
    heading = np.pi if towards is LEFT else 0.0
    poses = [(2.25, 1.25, heading + 0.1), (3.25, 1.25, heading + 0.1)]
    knowledge = believing(grid, [(pose, 0.5) for pose in poses], sensor=sensor, actions=actions)
    agent = GreedyAgent(samples=200, readings=50)
    agent.reset(np.random.default_rng(0))
    assert agent.act({}, knowledge) == expected


def test_greedy_does_not_repeat_a_drive_that_was_refused():
    knowledge, _ = tiny(2)
    agent = GreedyAgent(samples=200, readings=16)
    agent.reset(np.random.default_rng(0))
    assert np.isfinite(agent.expected_gains(knowledge)).all()
    assert knowledge.belief.place(0).refuse()
    gains = agent.expected_gains(knowledge)
    assert gains[FORWARD] == -np.inf
    assert np.isfinite(gains[:2]).all()
    assert agent.act({}, knowledge) != FORWARD
    here = Imagined.here(knowledge, 50, np.random.default_rng(0))
    assert here.after(knowledge, np.array([0.0, 0.5, 0.0]), np.random.default_rng(0)) is here


def test_greedy_may_stay_where_staying_tells_most():
    knowledge, _ = tiny(2)
    knowledge = replace(knowledge, actions=Actions(stay=True))
    agent = GreedyAgent(samples=100, readings=8)
    agent.reset(np.random.default_rng(0))
    assert len(agent.expected_gains(knowledge)) == 4
