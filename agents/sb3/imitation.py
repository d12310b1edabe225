"""Behaviour cloning of a planner, with DAgger rounds.

A planner that searches is right more often than a policy that learnt from rewards, and too slow to
ask at every step for ever. So it is asked first: its action values become targets
``softmax(Q / tau)`` of a cross-entropy; then it labels what the learner itself runs into (DAgger:
Ross, Gordon and Bagnell, 2011). What comes out is where PPO goes on.

The plug for a planner is a :class:`Labeller`: a function from a vector environment to the action
values of each of its robots, now. :func:`labels_of_agent` makes one of any agent by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from torch.nn import functional

from activeloc import checks
from activeloc.agents import make_agent
from activeloc.agents.sb3.batches import Batch, Floats, can_mirror, mirrored, shuffled
from activeloc.agents.sb3.vec_env import NativeVecEnv, Observation
from activeloc.errors import ConfigError


class Labeller(Protocol):
    """Says what a planner thinks of each action of each robot, now."""

    def __call__(self, env: NativeVecEnv, observations: Observation, starts: Any) -> Floats:
        """Action values ``(B, A)``; -inf for an action never to be taken.

        Args:
            env: ``env.env_method("knowledge")`` is what each robot knows.
            observations: Of all robots.
            starts: ``(B,)`` of bool: whose episode has just begun.
        """
        ...


@dataclass(frozen=True, slots=True)
class ImitationConfig:
    """How a planner is imitated.

    Attributes:
        tau: Of the targets ``softmax(Q / tau)``; 0 for the best action alone.
        labels: Observations labelled in the first round.
        rounds: Rounds in all: in the first the planner acts, with noise; then the learner.
        epochs: Passes over all labels, in each round.
        batch_size: Rows of a minibatch.
        learning_rate: At the start of a round; falls linearly to zero.
        weight_decay: Of AdamW.
        values: Steps from whose returns the value head is fitted at the end; 0 to leave it.
        noise: Shares of random actions; robots take them in turn.
        mirror: Whether each minibatch is mirrored half of the time, where the view allows it.

    Raises:
        ConfigError: If a value is out of its range.
    """

    tau: float = 0.05
    labels: int = 20_000
    rounds: int = 2
    epochs: int = 4
    batch_size: int = 256
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    values: int = 5_000
    noise: Sequence[float] = (0.0, 0.15, 0.4)
    mirror: bool = True

    def __post_init__(self) -> None:
        checks.number("imitation.tau", self.tau, 0.0, 1e6)
        for name in ("labels", "rounds", "epochs", "batch_size"):
            checks.integer(f"imitation.{name}", getattr(self, name), 1, 10**9)
        checks.integer("imitation.values", self.values, 0, 10**9)
        checks.number("imitation.learning_rate", self.learning_rate, 0.0, 1.0, above_low=True)
        checks.number("imitation.weight_decay", self.weight_decay, 0.0, 1.0)
        if not isinstance(self.noise, list | tuple) or not self.noise:
            raise ConfigError(f"imitation.noise must be one share or more; got {self.noise!r}")
        for share in self.noise:
            checks.number("imitation.noise", share, 0.0, 1.0)
        object.__setattr__(self, "noise", tuple(self.noise))
        checks.boolean("imitation.mirror", self.mirror)


def labels_of_agent(name: str, seed: int = 0, env_id: str | None = None) -> Labeller:
    """A labeller that asks an agent, by the richest of these methods that it has.

    ``action_values_all(knowledge)`` ``(n, A)`` and ``act_all(knowledge)`` ``(n,)`` are asked once
    for all robots, where the environment's ``batch_knowledge`` says what they know;
    ``action_values(observation, knowledge)`` ``(A,)`` and ``act`` robot by robot. An agent that
    only acts labels its action with 1, all others with 0.

    Raises:
        ConfigError: If there is no such agent.
    """
    first: Any = make_agent(name, env=env_id)
    agents: list[Any] = [first]
    rng = np.random.default_rng([seed, 2])

    def label(env: NativeVecEnv, observations: Observation, starts: NDArray[np.bool_]) -> Floats:
        space = env.action_space
        assert isinstance(space, gym.spaces.Discrete)
        shape = (env.num_envs, int(space.n))
        if hasattr(first, "action_values_all") and _knows_all(env):
            return np.asarray(first.action_values_all(env.envs.batch_knowledge), dtype=np.float32)  # type: ignore[attr-defined]
        if hasattr(first, "act_all") and _knows_all(env):
            return _chosen(first.act_all(env.envs.batch_knowledge), shape)  # type: ignore[attr-defined]
        while len(agents) < env.num_envs:
            agents.append(make_agent(name, env=env_id))
        values = np.zeros(shape, dtype=np.float32)
        for robot, knowledge in enumerate(env.env_method("knowledge")):
            agent = agents[robot]
            if starts[robot]:
                agent.reset(rng.spawn(1)[0])
            own = {key: part[robot] for key, part in observations.items()}
            if hasattr(agent, "action_values"):
                values[robot] = agent.action_values(own, knowledge)
            else:
                values[robot, int(agent.act(own, knowledge))] = 1.0
        return values

    return label


def _knows_all(env: NativeVecEnv) -> bool:
    """Whether what all robots know can be had at once."""
    try:
        return hasattr(env.envs, "batch_knowledge")
    except ConfigError:
        return False


def _chosen(actions: NDArray[np.int64], shape: tuple[int, int]) -> Floats:
    """1 for the action taken, 0 for others."""
    values = np.zeros(shape, dtype=np.float32)
    values[np.arange(shape[0]), actions] = 1.0
    return values


def imitate(
    policy: ActorCriticPolicy,
    env: NativeVecEnv,
    labeller: Labeller,
    config: ImitationConfig,
    rng: np.random.Generator,
    go_on: Callable[[], bool] = lambda: True,
) -> list[float]:
    """Teach a policy what a planner does, in rounds; the mean loss of each epoch.

    Args:
        policy: Of PPO; its weights are changed.
        env: Where labels are gathered.
        labeller: The planner.
        config: How.
        rng: Source of all that is random here.
        go_on: Asked before each step; once it says no, this returns.
    """
    held: list[Batch] = []
    losses: list[float] = []
    for number in range(config.rounds):
        learner = policy if number > 0 else None
        held += gather(env, labeller, config, rng, learner, go_on)
        batches = shuffled(held, config.batch_size, config.epochs, rng)
        n_rows = sum(len(batch.values) for batch in held)
        total = config.epochs * -(-n_rows // config.batch_size)
        losses += clone(policy, batches, total, config, rng, go_on)
        if not go_on():
            break
    return losses


def gather(
    env: NativeVecEnv,
    labeller: Labeller,
    config: ImitationConfig,
    rng: np.random.Generator,
    learner: ActorCriticPolicy | None = None,
    go_on: Callable[[], bool] = lambda: True,
) -> Iterator[Batch]:
    """Labelled observations, a batch a step, along what planner or learner runs into.

    Rows of equal values, where the planner does not mind, are left out.

    Args:
        env: Stepped; its robots begin new episodes.
        labeller: Asked at each step.
        config: How many, and how noisy the behaviour.
        rng: Source of the noise.
        learner: Who acts; the planner if None.
        go_on: Asked before each step.
    """
    observations = env.begin(int(word) for word in rng.integers(2**62, size=env.num_envs))
    starts = np.ones(env.num_envs, dtype=np.bool_)
    noise = np.resize(np.asarray(config.noise), env.num_envs)
    for _ in range(-(-config.labels // env.num_envs)):
        if not go_on():
            return
        values = labeller(env, observations, starts)
        # What makes no difference to the planner teaches nothing.
        matters = (values != values[:, :1]).any(axis=1)
        if matters.any():
            rows = {key: part[matters] for key, part in observations.items()}
            yield Batch(rows, values[matters], np.ones(matters.sum(), dtype=np.float32))
        actions = _best(values, rng)
        if learner is not None:
            actions = learner.predict(observations, deterministic=True)[0]
        anything = rng.integers(values.shape[1], size=env.num_envs)
        actions = np.where(rng.random(env.num_envs) < noise, anything, actions)
        env.step_async(actions)
        observations, _, starts, _ = env.step_wait()


def _best(values: Floats, rng: np.random.Generator) -> NDArray[np.int64]:
    """Of each row an action that is best, drawn among equals."""
    best = values >= values.max(axis=1, keepdims=True)
    return (best * rng.random(values.shape)).argmax(axis=1)


def clone(
    policy: ActorCriticPolicy,
    batches: Iterable[Batch],
    n_batches: int,
    config: ImitationConfig,
    rng: np.random.Generator,
    go_on: Callable[[], bool] = lambda: True,
) -> list[float]:
    """Fit the policy's choices to action values; the loss of each batch.

    The loss is the cross-entropy between ``softmax(Q / tau)`` and the policy, weighted by row. The
    value head learns nothing here.

    Args:
        policy: Its weights are changed.
        batches: What a planner said: any iterable, such as a planner's own generator.
        n_batches: How many there will be, for the learning rate's fall to zero.
        config: Temperature, learning rate, weight decay, mirroring.
        rng: Decides which batches are mirrored.
        go_on: Asked before each batch.
    """
    optimizer = torch.optim.AdamW(
        policy.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
    )
    policy.set_training_mode(True)
    losses: list[float] = []
    for number, given in enumerate(batches):
        if not go_on():
            break
        batch = given
        if config.mirror and can_mirror(batch) and rng.random() < 0.5:
            batch = mirrored(batch)
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * max(0.0, 1.0 - number / n_batches)
        loss = cross_entropy(policy, batch, config.tau)
        optimizer.zero_grad()
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
        optimizer.step()
        losses.append(float(loss.detach()))
    policy.set_training_mode(False)
    return losses


def cross_entropy(policy: ActorCriticPolicy, batch: Batch, tau: float) -> torch.Tensor:
    """Weighted mean of ``-sum_a softmax(Q / tau)_a log pi(a)`` [nat]."""
    tensors = {key: torch.as_tensor(array) for key, array in batch.observations.items()}
    distribution: Any = policy.get_distribution(tensors).distribution
    logits = distribution.logits
    targets = torch.as_tensor(soft_targets(batch.values, tau))
    weights = torch.as_tensor(batch.weights)
    each = -(targets * functional.log_softmax(logits, dim=1)).sum(dim=1)
    return (weights * each).sum() / weights.sum().clamp(min=1e-9)


def soft_targets(values: Floats, tau: float) -> Floats:
    """``softmax(Q / tau)`` of each row ``(N, A)``; for tau 0 the best actions share all."""
    shifted = values.astype(np.float64) - values.max(axis=1, keepdims=True)
    odds = (shifted >= 0.0).astype(np.float64) if tau == 0.0 else np.exp(shifted / tau)
    return (odds / odds.sum(axis=1, keepdims=True)).astype(np.float32)
