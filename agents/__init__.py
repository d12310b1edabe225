"""Agents: what chooses the actions.

==========  ========================================================================================
name        what it is
==========  ========================================================================================
random      Any action, equally likely: the floor.
spin        Turns once around, then wanders: what a lost robot does today.
greedy      Least expected entropy after one action.
active      Least expected entropy at the end of a walk, less what the walk costs.
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
from activeloc.agents.greedy import GreedyAgent
from activeloc.agents.random_walk import RandomAgent
from activeloc.agents.spin import SpinAgent
from activeloc.configuration import unknown
from activeloc.envs.episodes import Knowledge


class Agent(Protocol):
    """What evaluation needs of an agent."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode; ``rng`` is the agent's own source of chance for it."""
        ...

    def act(self, observation: Mapping[str, Any], knowledge: Knowledge) -> Any:
        """Choose an action."""
        ...


AGENTS: dict[str, type[Any]] = {
    "random": RandomAgent,
    "spin": SpinAgent,
    "greedy": GreedyAgent,
    "active": ActiveMarkovAgent,
}


def make_agent(name: str, settings: Mapping[str, Any] | None = None) -> Agent:
    """An agent by name.

    Args:
        name: As in the table above.
        settings: Fields of the agent's class.

    Raises:
        ConfigError: If the name or a setting is unknown.
    """
    if name not in AGENTS:
        raise unknown("agent", name, AGENTS)
    names = [item.name for item in fields(AGENTS[name]) if item.init]
    for key in settings or {}:
        if key not in names:
            raise unknown(f"agent {name}", key, names)
    agent: Agent = AGENTS[name](**dict(settings or {}))
    return agent


__all__ = [
    "AGENTS",
    "ActiveMarkovAgent",
    "Agent",
    "GreedyAgent",
    "RandomAgent",
    "SpinAgent",
    "make_agent",
]
