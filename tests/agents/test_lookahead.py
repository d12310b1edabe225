"""The lookahead agent: its tree of posteriors, and that looking further helps."""

import gymnasium as gym
import numpy as np
import pytest

from activeloc.agents import make_agent
from activeloc.agents.lookahead import weigh_draws
from activeloc.errors import ConfigError


def test_draws_follow_bayes_rule_step_after_step():
    """Two readings of one beam: posteriors and entropies by hand, in plain numpy."""
    rng = np.random.default_rng(0)
    m, readings, draws = 6, 4, 5
    p = rng.dirichlet(np.ones(readings), 3).T
    log_p = np.log(p).astype(np.float32)
    bins, stopped = np.array([0, 1, 1, 2, 0, 2]), np.array([0, 1, 0, 0, 1, 0], dtype=bool)
    chosen, log_w = rng.integers(m, size=draws), np.zeros((draws, m))
    expected, weights = np.full((draws, m), 1 / m), np.array([[0.7], [0.3]])
    for log_contact in (np.log(0.05), 0.0):
        rows, uniforms = rng.integers(3, size=(m, 1)).astype(np.int32), rng.random((draws, 1))
        after = np.empty_like(log_w)
        mean = weigh_draws(
            rows, log_p, stopped, weights, log_contact, bins, 3, chosen, uniforms, log_w, after
        )
        entropies = []
        for j, truth in enumerate(chosen):
            z = int((p[:, rows[truth, 0]].cumsum() <= uniforms[j, 0]).sum())
            power = weights[int(stopped[truth]), 0]
            likelihood = p[z, rows[:, 0]] ** power
            agrees = np.where(stopped == stopped[truth], 1.0, np.exp(log_contact))
            expected[j] *= likelihood * agrees
            posterior = expected[j] / expected[j].sum()
            np.testing.assert_allclose(
                np.exp(after[j] - after[j].max()), posterior / posterior.max(), rtol=1e-5
            )
            mass = np.bincount(bins, posterior)
            entropies.append(-(mass[mass > 0] * np.log(mass[mass > 0])).sum())
        assert mean == pytest.approx(np.mean(entropies), rel=1e-5)
        log_w = after


def play(agent, seed, steps=25, **settings):
    env = gym.make(
        "activeloc/GlobalLocalization-v0", map="rooms:0", disable_env_checker=True, **settings
    )
    observation, _ = env.reset(seed=seed)
    agent.reset(np.random.default_rng(seed))
    fractions, actions = [], []
    for _ in range(steps):
        action = agent.act(observation, env.unwrapped.knowledge)
        observation, _, over, _, info = env.step(action)
        fractions.append(info["entropy_fraction"])
        actions.append(action)
        if over:
            break
    return np.array(fractions), actions


def test_the_same_seed_gives_the_same_plan():
    one, two = (play(make_agent("lookahead", {"steps": 2}), 1, 6)[1] for _ in range(2))
    assert one == two


def test_it_says_what_it_expects():
    agent = make_agent("lookahead", {"steps": 2})
    play(agent, 2, 1)
    assert agent.plan is not None
    assert np.isfinite(agent.plan.expected_gain)


def test_a_clock_that_has_run_out_still_gives_an_action():
    _, actions = play(make_agent("lookahead", {"steps": 4, "seconds": 1e-6}), 3, 2)
    assert all(action in (0, 1, 2) for action in actions)


@pytest.mark.parametrize(
    "settings", [{"steps": 0}, {"steps": 13}, {"samples": 1}, {"readings": 0}, {"seconds": -1.0}]
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ConfigError, match=f"agent lookahead.{next(iter(settings))}"):
        make_agent("lookahead", settings)


def test_continuous_actions_are_refused():
    with pytest.raises(ConfigError, match="needs discrete actions"):
        play(make_agent("lookahead"), 0, 1, actions="continuous")
