"""Expected against realised gains: the meter on given plans, and a world where both are known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activeloc.agents import make_agent
from activeloc.agents.evaluation import Player, Record, Sweep, evaluate
from activeloc.agents.evaluation.gains import GainMeter, blind_entropy
from activeloc.agents.evaluation.records import FILE_NAME, read_records
from activeloc.agents.evaluation.statistics import GAIN_SCORES, estimates, gain_columns
from activeloc.agents.imagination import Imagined, Plan, expected_gain, law_of, plan_of
from activeloc.cli.tables import gains_table
from activeloc.envs.localization import LocalizationEnv
from activeloc.errors import ConfigError
from activeloc.maps import MapSource, from_text
from activeloc.sensors import ReadingBins

HUT = from_text(
    """
##########
#...#....#
#........#
###.##...#
##########
""",
    name="hut",
)
COARSE = {"kind": "histogram", "cell_size": 0.5, "headings": 12}
RECORD = Record(agent="spin", map="hut", seed=3, episode=0, steps=5, success=False, wrong=False,
                entropy_auc=0.5, final_entropy=1.0, error_m=2.0, error_rad=0.1, total_reward=0.0,
                played=5, entropy=(1.0, 0.5), start=(1.0, 2.0, 3.0), mass_at_truth=0.5,
                n_particles=None, act_ms=1.0, step_ms=1.0)  # fmt: skip
LEFT, AHEAD = np.array([np.pi / 6, 0.0, 0.0]), np.array([0.0, 0.5, 0.0])
PARTICLES = {"kind": "particles", "n_min": 2000, "n_max": 4000}


def env_of(belief=COARSE, seed=0, **settings):
    env = LocalizationEnv(map=HUT, belief=belief, **settings)
    env.reset(seed=seed)
    return env


@pytest.mark.parametrize("belief", [COARSE, PARTICLES], ids=["histogram", "particles"])
def test_after_one_step_the_twin_is_the_belief(belief):
    """What is realised is the blind entropy less the entropy that the environment says."""
    env, meter = env_of(belief), GainMeter()
    for action, command in ((0, LEFT), (2, AHEAD), (2, AHEAD), (0, LEFT)):
        plan = Plan(((command, 1),), 0.25)
        before = blind_entropy(env.knowledge, plan)
        meter.decided(env.knowledge, plan)
        env.step(action)
        meter.moved(env.knowledge)
        expected, realised = meter.gains[-1]
        assert expected == 0.25
        assert realised == pytest.approx(before - env.knowledge.summary.entropy, abs=1e-9)
    assert len(meter.gains) == 4


def test_on_a_walk_the_twin_looks_only_at_the_end():
    env, meter = env_of(), GainMeter()
    twin = env.knowledge.belief.copy()
    plan = Plan(((LEFT, 2), (AHEAD, 1)), 1.0)
    meter.decided(env.knowledge, plan)
    before = blind_entropy(env.knowledge, plan)
    for action in (0, 0, 2):
        assert meter.gains == []
        env.step(action)
        twin.predict(0, env.knowledge.u, env.knowledge.touched)
        meter.moved(env.knowledge)
        meter.decided(env.knowledge, None)
    twin.correct(0, env.knowledge.scan)
    assert meter.gains == [(1.0, pytest.approx(before - twin.summarise(0).entropy))]


def test_an_obstacle_ends_a_walk_and_the_episode_s_end_drops_it():
    env, meter = env_of(), GainMeter()
    plan = Plan(((AHEAD, 50),), 1.0)
    meter.decided(env.knowledge, plan)
    while not env.knowledge.touched:
        assert meter.gains == []
        env.step(2)
        meter.moved(env.knowledge)
    assert len(meter.gains) == 1
    env.step(0)
    meter.moved(env.knowledge)
    assert len(meter.gains) == 1
    meter.decided(env.knowledge, plan)
    assert len(meter.gains) == 1


@pytest.mark.parametrize("command", [LEFT, AHEAD], ids=["turn", "drive"])
@pytest.mark.parametrize("belief", [COARSE, PARTICLES], ids=["histogram", "particles"])
def test_blind_is_the_filter_that_asks_nothing_of_the_odometry(belief, command):
    """No way is thought less likely for the wall on it; where there is no way, it is the filter."""
    credulous = env_of({**belief, "odometry_floor": 1.0}).knowledge.belief
    credulous.predict(0, command, False)
    knowledge = env_of(belief).knowledge
    blind = blind_entropy(knowledge, Plan(((command, 1),), 0.0))
    assert blind == pytest.approx(credulous.summarise(0).entropy, abs=1e-6)
    plain = knowledge.belief.copy()
    plain.predict(0, command, False)
    assert (abs(blind - plain.summarise(0).entropy) < 1e-6) == (command is LEFT)
    assert knowledge.belief.config.odometry_floor < 1.0


@pytest.mark.parametrize("name", ["random", "spin"])
def test_who_does_not_plan_expects_nothing(name):
    env, agent = env_of(), make_agent(name)
    agent.act({}, env.knowledge)
    assert plan_of(agent) is None


def test_greedy_says_the_gain_it_chose_by():
    env, agent = env_of(), make_agent("greedy", {"samples": 50, "readings": 4})
    for seed in range(5):
        agent.reset(np.random.default_rng(seed))
        gains = agent.expected_gains(env.knowledge)
        agent.reset(np.random.default_rng(seed))
        assert agent.plan is None
        action = agent.act({}, env.knowledge)
        assert agent.plan.expected_gain == max(gains)
        np.testing.assert_array_equal(agent.plan.walk[0][0], env.knowledge.actions.commands[action])


def test_active_says_its_walk_once():
    """As long as every command is carried out, and nothing in the way is seen."""
    env, agent = env_of(), make_agent("active", {"samples": 50, "readings": 4})
    agent.reset(np.random.default_rng(0))
    clear = replace(env.knowledge, scan=np.full_like(env.knowledge.scan, np.inf))
    first = agent.act({}, clear)
    commands = [command for command, times in agent.plan.walk for _ in range(times)]
    actions = [0 if c[0] > 0 else 1 if c[0] < 0 else 2 for c in commands]
    assert actions[0] == first
    for action, done in zip(actions[1:], commands, strict=False):
        assert agent.act({}, replace(clear, u=done)) == action
        assert agent.plan is None
    agent.act({}, replace(clear, u=commands[-1]))
    assert agent.plan is not None


def bins_of(belief):
    return ReadingBins(belief.sensor.z_max, belief.config.reading_bin)


def one_reading(belief):
    """A scan with one reading, and which bin that is in."""
    scan = np.full(len(belief.sensor.bearings), np.nan)
    scan[0] = 0.73
    return scan, int(bins_of(belief).index(scan)[0])


@pytest.mark.parametrize("belief", [COARSE, PARTICLES], ids=["histogram", "particles"])
def test_what_is_forecast_is_a_law(belief):
    knowledge = env_of({**belief, "likelihood_power": 0.6}).knowledge
    poses = knowledge.belief.sample(0, 200, np.random.default_rng(0))
    _, log_p, power = law_of(knowledge, poses)
    assert power == 0.6
    np.testing.assert_allclose(np.exp(log_p).sum(axis=0), 1.0, atol=1e-4)


def test_a_reading_counts_in_a_histogram_as_in_imagination():
    """Each state's mass grows by its law to the filter's power."""
    knowledge = env_of({**COARSE, "likelihood_power": 0.6, "leak": 0.0}).knowledge
    belief = knowledge.belief
    poses = belief.sample(0, 200, np.random.default_rng(0))
    rows, log_p, power = law_of(knowledge, poses)
    scan, z = one_reading(belief)
    cell, heading = belief.poses(0).states_of(poses)
    before = belief.probabilities(0)[cell, heading].astype(np.float64)
    belief.place(0).clear()
    belief.correct(0, scan)
    grown = np.log(belief.probabilities(0)[cell, heading] / before)
    expected = power * log_p[z, rows[:, 0]]
    np.testing.assert_allclose(grown - grown[0], expected - expected[0], atol=1e-3)
    assert np.ptp(expected) > 0.5


def test_a_reading_counts_in_particles_as_in_imagination():
    """What the filter adds to a particle's log weight is the law's logarithm times the power."""
    knowledge = env_of({**PARTICLES, "likelihood_power": 0.6}).knowledge
    poses = knowledge.belief.particles(0)[0][:200]
    _, log_p, power = law_of(knowledge, poses)
    law = knowledge.belief.sensor.masses(np.linspace(0.1, 1.4, 9), bins_of(knowledge.belief))
    added = knowledge.belief.forecast(0, poses)[1]
    np.testing.assert_allclose(added, power * log_p, rtol=1e-5)
    nearest = [np.abs(np.exp(log_p).T - row).sum(axis=1).min() for row in law]
    assert max(nearest) < 0.1


@pytest.mark.parametrize("power", [1.0, 0.5])
def test_in_the_filter_s_own_world_planners_earn_what_they_expect(power):
    """Truth drawn from the belief, readings from its law: many turns, one expectation."""
    env = env_of({**COARSE, "likelihood_power": power, "sigma_factor": 1.0}, world="discrete")
    knowledge, rng = env.knowledge, np.random.default_rng(0)
    plan = Plan(((LEFT, 1),), 0.0)
    here = Imagined.here(knowledge, 6000, rng)
    expected = expected_gain(knowledge, here.after(knowledge, LEFT, rng), 400, rng)
    before, start, gains = blind_entropy(knowledge, plan), knowledge.belief.copy(), []
    simulator = env._episodes.simulator
    for pose in start.sample(0, 400, rng):
        simulator.poses[0] = pose
        u = simulator.step(0, LEFT, rng)
        twin = start.copy()
        twin.predict(0, u, False)
        twin.correct(0, simulator.scan(0, rng))
        gains.append(before - twin.summarise(0).entropy)
    error = np.std(gains) / 20.0
    assert expected > 0.1
    assert np.mean(gains) == pytest.approx(expected, abs=4 * error + 0.03)


def test_scores_by_hand():
    gains = [((1.0, 0.5), (0.5, 0.5)), (), ((0.5, 0.6),)]
    records = [replace(RECORD, episode=i, gains=pairs) for i, pairs in enumerate(gains)]
    scores = estimates(gain_columns(records), GAIN_SCORES)
    assert scores["expected_gain"].value == pytest.approx(2.0 / 3)
    assert scores["realised_gain"].value == pytest.approx(1.6 / 3)
    assert scores["earned"].value == pytest.approx(0.8)


def test_the_ratio_s_interval_is_over_episodes():
    """Walks of one episode stand or fall together: the interval is that of the episodes' sums."""
    rng = np.random.default_rng(0)
    luck = rng.normal(1.0, 0.4, 400)
    records = [replace(RECORD, episode=i, gains=((0.5, 0.5 * x),) * 9) for i, x in enumerate(luck)]
    earned = estimates(gain_columns(records), GAIN_SCORES)["earned"]
    half = 1.96 * luck.std() / 20.0
    assert earned.high - earned.low == pytest.approx(2 * half, rel=0.1)


def sweep(**changes):
    agents = {"spin": {}, "greedy": {"samples": 30, "readings": 2}}
    given = {"env": "activeloc/GlobalLocalization-v0", "map": MapSource.parse(HUT), "limit": 8,
             "settings": {"belief": COARSE}, "agents": agents, "episodes": 2}  # fmt: skip
    return Sweep(**{**given, **changes})


def test_a_sweep_keeps_gains_where_it_is_asked_to(tmp_path):
    report = evaluate(sweep(gains=True), tmp_path)
    kept = read_records(tmp_path / FILE_NAME).records
    assert [len(r.gains) for r in kept] == [r.played * (r.agent == "greedy") for r in kept]
    assert report.gains.keys() == {"greedy"}
    said = json.loads((tmp_path / "summary.json").read_text())["gains"]["greedy"]
    assert said["earned"]["value"] == report.gains["greedy"]["earned"].value
    assert len(gains_table(report).columns) == 4
    with pytest.raises(ConfigError, match="gains was True and is now False"):
        evaluate(sweep(), tmp_path)


def test_measuring_changes_no_episode():
    with_gains, without = (Player(sweep(gains=g)).play("greedy", 1) for g in (True, False))
    assert without.gains == ()
    same = replace(with_gains, gains=(), act_ms=without.act_ms, step_ms=without.step_ms)
    assert same == without


def test_gains_are_a_matter_of_yes_or_no():
    with pytest.raises(ConfigError, match="gains must be true or false; got 1"):
        sweep(gains=1)
