"""The agent that plans in the egocentric view."""

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401  (registers the ids)
from activeloc.agents import make_agent
from activeloc.agents.commands import FORWARD, LEFT, RIGHT
from activeloc.beliefs.metric_view import BEARINGS, HYPOTHESES
from activeloc.errors import ConfigError

MAP = "rooms(width=6,height=5,resolution=0.1):1"


@pytest.fixture(scope="module")
def env():
    belief = {"kind": "histogram", "cell_size": 0.25, "headings": 36}
    return gym.make("activeloc/GlobalLocalization-v0", map=MAP, belief=belief)


def imagined(told=None, p_open=None, refused=()):
    """An observation in which ways tell what a caller says: (bearing, distance) -> nats."""
    ways, place = np.ones((2, BEARINGS, 9), np.float32), np.zeros(2 * BEARINGS, np.float32)
    ways[1] = 0.0
    for at, nats in (told or {}).items():
        ways[1][at] = nats / np.log(HYPOTHESES)
    for at, p in (p_open or {}).items():
        ways[0][at] = p
    place[BEARINGS + np.array(refused, dtype=int)] = 1.0
    return {"ways": ways, "place": place}


@pytest.mark.parametrize(
    ("told", "best", "value"),
    [
        ({(0, 2): 2.0}, FORWARD, 2.0 - 0.2 * 2),
        ({(3, 2): 2.0}, LEFT, 2.0 - 0.2 * 5),
        ({(9, 4): 3.0}, RIGHT, 3.0 - 0.2 * 7),
        ({(11, 8): 3.0, (0, 2): 0.9}, RIGHT, 3.0 - 0.2 * 9),
        ({(1, 2): 1.0, (0, 2): 0.9}, FORWARD, 0.9 - 0.2 * 2),
    ],
)
def test_it_begins_the_way_that_tells_most_for_its_cost(env, told, best, value):
    env.reset(seed=0)
    knowledge = env.unwrapped.knowledge
    agent = make_agent("glance")
    values = agent.action_values(imagined(told), knowledge)
    assert values.argmax() == best == agent.act(imagined(told), knowledge)
    assert values[best] == pytest.approx(value, abs=1e-6)


def test_a_way_that_may_be_blocked_counts_less(env):
    env.reset(seed=0)
    agent = make_agent("glance", {"certainty_share": 0.5, "step_cost": 0.0})
    seen = imagined({(0, 2): 2.0}, {(0, 2): 0.5})
    assert agent.action_values(seen, env.unwrapped.knowledge)[FORWARD] == pytest.approx(1.5)


def test_a_refused_way_is_not_begun(env):
    env.reset(seed=0)
    knowledge = env.unwrapped.knowledge
    values = make_agent("glance").action_values(imagined({(0, 2): 2.0}, refused=[0]), knowledge)
    assert values[FORWARD] == -np.inf
    nothing = make_agent("glance").action_values(imagined(refused=range(12)), knowledge)
    assert nothing.argmax() == LEFT
    assert np.isfinite(nothing.max())


def test_it_draws_the_view_that_the_environment_leaves_out(env):
    shown = gym.make(env.spec.id, **{**env.spec.kwargs, "observation": {"view": True}})
    agents = make_agent("glance"), make_agent("glance")
    pairs = []
    for one, agent in zip((env, shown), agents, strict=True):
        agent.reset(np.random.default_rng(0))
        observation, _ = one.reset(seed=4)
        actions = []
        for _ in range(12):
            actions.append(agent.act(observation, one.unwrapped.knowledge))
            observation, _, over, _, _ = one.step(actions[-1])
            if over:
                break
        pairs.append(actions)
    assert "ways" not in env.observation_space.spaces
    assert pairs[0] == pairs[1]
    assert len(set(pairs[0])) > 1


@pytest.mark.parametrize(
    ("name", "value"),
    [("step_cost", -1.0), ("certainty_share", 2.0), ("distances", ()), ("distances", (5.0,))],
)
def test_settings_that_are_none_are_refused(name, value):
    with pytest.raises(ConfigError, match=rf"agent glance\.{name}"):
        make_agent("glance", {name: value})
