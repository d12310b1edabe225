"""Agents: what chooses the actions.

==========  ========================================================================================
name        what it is
==========  ========================================================================================
random      Any action, equally likely: the floor.
spin        Turns once around, then wanders: what a lost robot does today.
greedy      Least expected entropy after one action.
lookahead   Least expected entropy summed over the steps of a plan.
active      Least expected entropy at the end of a walk, less what the walk costs.
glance      The straight way that the egocentric view promises most of; quick.
onnx:FILE   The trained policy in a file (:mod:`activeloc.agents.onnx_policy`).
ppo         The trained policy that comes with the package for the environment, if one does.
==========  ========================================================================================

An agent sees the observation and what the robot knows (:class:`Knowledge`: belief, models, scan,
odometry), never the truth. Importing this package imports no torch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Protocol

import numpy as np

from activeloc.agents.active_markov import ActiveMarkovAgent
from activeloc.agents.glance import GlanceAgent
from activeloc.agents.greedy import GreedyAgent
from activeloc.agents.lookahead import LookaheadAgent
from activeloc.agents.onnx_policy import PACKAGED, PREFIX, OnnxAgent, packaged_policy
from activeloc.agents.random_walk import RandomAgent
from activeloc.agents.spin import SpinAgent
from activeloc.configuration import unknown
from activeloc.envs.worlds import AnyKnowledge


class Agent(Protocol):
    """What evaluation needs of an agent."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode; ``rng`` is the agent's own source of chance for it."""
        ...

    def act(self, observation: Mapping[str, Any], knowledge: AnyKnowledge) -> Any:
        """Choose an action."""
        ...


AGENTS: dict[str, type[Any]] = {
    "random": RandomAgent,
    "spin": SpinAgent,
    "greedy": GreedyAgent,
    "lookahead": LookaheadAgent,
    "active": ActiveMarkovAgent,
    "glance": GlanceAgent,
}


def make_agent(
    name: str, settings: Mapping[str, Any] | None = None, env: str | None = None
) -> Agent:
    """An agent by name.

    Args:
        name: As in the table above.
        settings: Fields of the agent's class.
        env: Registered id of the environment it is for; a packaged policy is found by it.

    Raises:
        ConfigError: If the name or a setting is unknown, or there is no packaged policy.
        CheckpointError: If a policy's file is refused.
    """
    check_name(name)
    given = dict(settings or {})
    agent_class = AGENTS.get(name, OnnxAgent)
    names = [item.name for item in fields(agent_class) if item.init]
    for key in given:
        if key not in names:
            raise unknown(f"agent {name}", key, names)
    if name in PACKAGED:
        given["file"] = str(packaged_policy(name, env))
    elif name.startswith(PREFIX):
        given["file"] = name.removeprefix(PREFIX)
    agent: Agent = agent_class(**given)
    return agent


def check_name(name: str) -> None:
    """Refuse what is no agent's name.

    Raises:
        ConfigError: With the nearest name that is one.
    """
    if name not in AGENTS and name not in PACKAGED and not name.startswith(PREFIX):
        raise unknown("agent", name, [*AGENTS, *PACKAGED, f"{PREFIX}FILE"])


__all__ = [
    "AGENTS",
    "ActiveMarkovAgent",
    "Agent",
    "GlanceAgent",
    "GreedyAgent",
    "LookaheadAgent",
    "OnnxAgent",
    "RandomAgent",
    "SpinAgent",
    "check_name",
    "make_agent",
]
