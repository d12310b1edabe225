"""A policy learns what a planner says, and left and right are told apart."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
import torch
from scipy.special import log_softmax, softmax
from stable_baselines3 import PPO

from activeloc.agents.commands import LEFT, RIGHT
from activeloc.agents.sb3.algorithms import build_model, training_env
from activeloc.agents.sb3.batches import Batch, can_mirror, mirrored, shuffled
from activeloc.agents.sb3.imitation import (
    ImitationConfig,
    clone,
    cross_entropy,
    gather,
    imitate,
    labels_of_agent,
    soft_targets,
)
from activeloc.agents.sb3.training import train
from activeloc.agents.sb3.value_head import fit_values, returns_to_go
from activeloc.errors import ConfigError


@pytest.fixture
def pair(make_config):
    config = make_config()
    env = training_env(config)
    model = build_model(config, env)
    assert isinstance(model, PPO)
    return model.policy, env


def entropy_rule(env, observations, starts):
    """A planner that can be learnt from the observation alone."""
    entropy = observations["scalars"][:, 0]
    values = np.full((len(entropy), 3), -np.inf, dtype=np.float32)
    values[:, 0], values[:, 2] = 0.6 - entropy, entropy - 0.6
    return values


def batch_of(policy, n, seed=0):
    rng = np.random.default_rng(seed)
    observations = {
        key: rng.random((n, *space.shape), dtype=np.float32)
        for key, space in policy.observation_space.items()
    }
    values = rng.standard_normal((n, 3)).astype(np.float32)
    return Batch(observations, values, rng.random(n).astype(np.float32))


def test_targets_are_the_softmax_of_the_values():
    values = np.array([[1.0, 0.5, -np.inf], [3.0, 3.0, 2.0]], dtype=np.float32)
    np.testing.assert_allclose(soft_targets(values, 0.3), softmax(values / 0.3, axis=1), rtol=1e-5)
    np.testing.assert_array_equal(soft_targets(values, 0.0), [[1, 0, 0], [0.5, 0.5, 0]])
    assert soft_targets(values * 1e4, 0.05).sum() == 2.0


def test_the_loss_is_the_weighted_cross_entropy(pair):
    policy, _ = pair
    batch = batch_of(policy, 5)
    tensors = {key: torch.as_tensor(array) for key, array in batch.observations.items()}
    with torch.no_grad():
        features = policy.features_extractor(tensors)
        logits = policy.action_net(features).numpy()
        loss = float(cross_entropy(policy, batch, 0.5))
    each = -(softmax(batch.values / 0.5, axis=1) * log_softmax(logits, axis=1)).sum(axis=1)
    assert loss == pytest.approx(np.average(each, weights=batch.weights), rel=1e-5)


def test_a_planner_is_learnt(pair):
    policy, env = pair
    config = ImitationConfig(labels=90, rounds=2, epochs=25, batch_size=32, tau=0.0)
    losses = imitate(policy, env, entropy_rule, config, np.random.default_rng(0))
    assert np.mean(losses[-10:]) < 0.5 * np.mean(losses[:3])
    held_out = [*gather(env, entropy_rule, config, np.random.default_rng(9))]
    right = [
        (policy.predict(b.observations, deterministic=True)[0] == b.values.argmax(1)).mean()
        for b in held_out
    ]
    assert np.mean(right) > 0.85


def test_returns_to_go_stop_at_the_ends_of_episodes():
    rewards = np.array([[1.0, 8.0], [2.0, 1.0], [4.0, 0.0], [7.0, 2.0]])
    dones = np.array([[False, True], [True, False], [False, False], [False, True]])
    returns, ended = returns_to_go(rewards, dones, 0.5)
    np.testing.assert_array_equal(returns, [[2.0, 8.0], [2.0, 1.5], [7.5, 1.0], [7.0, 2.0]])
    np.testing.assert_array_equal(ended, [[True, True], [True, True], [False, True], [False, True]])


def test_the_value_head_foretells_returns_and_nothing_else_changes(pair, monkeypatch):
    """The reward of a step is linear in the features before it."""
    policy, env = pair
    begin, step, last = env.begin, env.step_wait, []

    def noted(observations):
        tensors, _ = policy.obs_to_tensor(observations)
        last.append(policy.extract_features(tensors).detach().numpy().sum(axis=1))
        return observations

    def paid():
        rewards = 2.0 - 3.0 * last[-1]
        observations, _, dones, infos = step()
        return noted(observations), rewards, dones, infos

    monkeypatch.setattr(env, "begin", lambda seeds: noted(begin(seeds)))
    monkeypatch.setattr(env, "step_wait", paid)
    before = {name: part.clone() for name, part in policy.state_dict().items()}
    explained = fit_values(policy, env, 300, 0.0, np.random.default_rng(0))
    changed = {
        name for name, part in policy.state_dict().items() if not torch.equal(part, before[name])
    }
    assert changed == {"value_net.weight", "value_net.bias"}
    assert 0.98 < explained <= 1.0
    seen = env.begin(range(3))
    value = policy.predict_values(policy.obs_to_tensor(seen)[0]).detach().numpy()[:, 0]
    np.testing.assert_allclose(
        value, 2.0 - 3.0 * last[-1], atol=0.3 * np.std(3.0 * np.hstack(last))
    )
    assert np.isnan(fit_values(policy, env, 300, 0.0, np.random.default_rng(0), lambda: False))


def test_rows_that_the_planner_does_not_mind_are_left_out(pair):
    _, env = pair

    def undecided(env, observations, starts):
        values = entropy_rule(env, observations, starts)
        values[0] = 0.25
        return values

    config = ImitationConfig(labels=30)
    batches = [*gather(env, undecided, config, np.random.default_rng(0))]
    assert [len(batch.values) for batch in batches] == [env.num_envs - 1] * len(batches)


def test_in_later_rounds_the_learner_acts(pair):
    policy, env = pair
    config = ImitationConfig(labels=30, noise=(0.0,))

    def actions(learner):
        [*gather(env, entropy_rule, config, np.random.default_rng(0), learner)]
        return np.array(env.actions_taken)

    batches = [*gather(env, entropy_rule, config, np.random.default_rng(0), policy)]
    wanted = [policy.predict(batch.observations, deterministic=True)[0] for batch in batches]
    np.testing.assert_array_equal(wanted, env.actions_taken)
    assert (actions(None) != actions(policy)).any()


def test_an_agent_labels_what_it_does(pair):
    _, env = pair
    config = ImitationConfig(labels=9, noise=(0.0,))
    batches = [*gather(env, labels_of_agent("spin", 1), config, np.random.default_rng(0))]
    labels = np.array([batch.values.argmax(axis=1) for batch in batches])
    assert (labels == LEFT).all()  # It turns once around first.
    np.testing.assert_array_equal(env.actions_taken, labels)
    with pytest.raises(ConfigError, match="unknown name"):
        labels_of_agent("nobody")


def test_every_row_comes_once_in_an_epoch(pair):
    policy, _ = pair
    held = [batch_of(policy, 7, seed) for seed in range(3)]
    out = [*shuffled(held, 4, 2, np.random.default_rng(0))]
    for epoch in (out[:6], out[6:]):
        rows = np.sort(np.concatenate([batch.weights for batch in epoch]))
        np.testing.assert_array_equal(rows, np.sort(np.concatenate([b.weights for b in held])))
    rows = {float(w): v for batch in held for w, v in zip(batch.weights, batch.values, strict=True)}
    for batch in out:
        for weight, values in zip(batch.weights, batch.values, strict=True):
            np.testing.assert_array_equal(rows[float(weight)], values)


def views(seed):
    """What a robot sees, step by step, in a maze and in its mirror image, making mirrored turns."""
    env = gym.make("activeloc/Maze7-v0", observation={"view": True, "radius": 4})
    env.reset(seed=seed)
    knowledge = env.unwrapped.knowledge
    free, cell = knowledge.lattice.free[0].copy(), knowledge.lattice.cells[0, 0]
    pose = (int(cell[0]), int(cell[1]), 0)  # Looks along +column; its image along -column.
    image = (pose[0], 6 - pose[1], 2)
    actions = np.random.default_rng(seed).integers(3, size=8)
    seen = []
    for grid, start, moves in (
        (free, pose, actions),
        (free[:, ::-1], image, np.array([RIGHT, LEFT, 2])[actions]),
    ):
        observation, _ = env.reset(seed=0, options={"grid": grid.copy(), "pose": start})
        seen.append([observation] + [env.step(int(a))[0] for a in moves])
    return seen


@pytest.mark.parametrize("seed", range(4))
def test_the_mirror_shows_what_the_mirrored_robot_sees(seed):
    values = np.array([[0.1, 0.2, 0.3]], dtype=np.float32)
    changed = 0
    for one, image in zip(*views(seed), strict=True):
        keys = ("view", "depth", "time")
        batch = Batch({key: one[key][None] for key in keys}, values, np.ones(1, dtype=np.float32))
        assert can_mirror(batch)
        seen = mirrored(batch)
        for key in keys:
            np.testing.assert_allclose(seen.observations[key][0], image[key], atol=1e-6)
        np.testing.assert_array_equal(seen.values, values[:, [RIGHT, LEFT, 2]])
        back = mirrored(seen)
        np.testing.assert_array_equal(back.observations["view"], batch.observations["view"])
        changed += (seen.observations["view"] != batch.observations["view"]).any()
    assert changed > 0


def test_a_world_view_is_not_mirrored(pair):
    policy, _ = pair
    assert not can_mirror(batch_of(policy, 2))


def test_the_learning_rate_falls_to_zero(pair):
    """With as many batches as said, the last changes next to nothing."""
    policy, _ = pair
    batches = [batch_of(policy, 8, seed) for seed in range(20)]
    before = []

    def watched():
        for batch in batches:
            before.append(policy.action_net.weight.detach().clone())
            yield batch

    clone(policy, watched(), 20, ImitationConfig(), np.random.default_rng(0))
    before.append(policy.action_net.weight.detach().clone())
    moved = [float((b - a).abs().max()) for a, b in pairwise(before)]
    assert 0.0 < moved[-1] < 0.2 * moved[0]


def test_a_run_may_begin_with_imitation(make_config, tmp_path):
    small = ImitationConfig(labels=12, rounds=1, epochs=1, values=12)
    config = make_config(imitate="spin", total_timesteps=30, imitation=small)
    row = config.hyperparameters
    assert (row.learning_rate, row.ent_coef, row.clip_range) == (3e-4, 1e-3, 0.1)
    one = train(config, tmp_path / "a")
    other = train(config, tmp_path / "b")
    assert (one / "manifest.json").read_bytes() == (other / "manifest.json").read_bytes()


def test_refusals(make_config):
    with pytest.raises(ConfigError, match="goes with ppo only"):
        make_config("dqn", imitate="spin")
    observations = {"a": np.zeros((2, 1), dtype=np.float32)}
    weights = np.ones(2, dtype=np.float32)
    with pytest.raises(ConfigError, match="one length"):
        Batch(observations, np.zeros((3, 2), dtype=np.float32), weights)
    for bad in (np.nan, -np.inf):
        with pytest.raises(ConfigError, match="finite"):
            Batch(observations, np.full((2, 2), bad, dtype=np.float32), weights)
    with pytest.raises(ConfigError, match=r"imitation\.noise"):
        ImitationConfig(noise=(2.0,))
