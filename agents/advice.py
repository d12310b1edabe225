"""What agents would do now, if they took over from here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from activeloc.agents import Agent
from activeloc.agents.imagination import plan_of
from activeloc.envs.actions import words_of
from activeloc.envs.worlds import AnyKnowledge


@dataclass(frozen=True, slots=True)
class Advice:
    """One agent's.

    Attributes:
        agent: Its name.
        action: What it would do.
        words: The same in words.
        walk: What it would go on with, in words; empty if it plans no further.
        expected_gain: Entropy that it expects the scan at the end of its walk to remove [nat];
            None if it expects nothing.
    """

    agent: str
    action: Any
    words: str
    walk: str
    expected_gain: float | None


def advise(
    agents: Mapping[str, Agent],
    observation: Mapping[str, Any],
    knowledge: AnyKnowledge,
    rng: np.random.Generator,
) -> list[Advice]:
    """Ask each agent as if its episode began here, so that it follows no plan of its own.

    Args:
        agents: By name; what they remember is forgotten.
        observation: The environment's.
        knowledge: What the robot knows.
        rng: Source of the agents' chance.

    Raises:
        ConfigError: If an agent does not go with the environment.
    """
    return [
        _advice(name, agent, stream, observation, knowledge)
        for (name, agent), stream in zip(agents.items(), rng.spawn(len(agents)), strict=True)
    ]


def _advice(
    name: str,
    agent: Agent,
    rng: np.random.Generator,
    observation: Mapping[str, Any],
    knowledge: AnyKnowledge,
) -> Advice:
    agent.reset(rng)
    action = agent.act(observation, knowledge)
    plan = plan_of(agent)
    walk = ""
    if plan is not None and sum(times for _, times in plan.walk) > 1:
        walk = ", then ".join(f"{times} x {words_of(command)}" for command, times in plan.walk)
    gain = None if plan is None else float(plan.expected_gain)
    return Advice(name, action, knowledge.actions.words(action), walk, gain)
