"""One agent plays one episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import fsum
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeloc.agents.evaluation.gains import GainMeter
from activeloc.agents.evaluation.records import Record, penalised_area
from activeloc.agents.evaluation.sweep import Sweep
from activeloc.agents.imagination import plan_of
from activeloc.beliefs.particles import ParticleBelief
from activeloc.envs.episodes import Knowledge
from activeloc.envs.localization import LocalizationEnv
from activeloc.envs.recorder import Recorder
from activeloc.envs.rendering import Recording

Watch = Callable[[LocalizationEnv, int, dict[str, Any]], None]


@dataclass(slots=True)
class _Tally:
    """What is noted while an episode is played: at the start and step by step."""

    entropy: list[float]
    n_particles: list[int | None]
    start: NDArray[np.float64]
    rewards: list[float] = field(default_factory=list)
    gains: tuple[tuple[float, float], ...] = ()
    act_s: float = 0.0
    step_s: float = 0.0


class Player:
    """The environment and the agents of a sweep, built once, to play any of its episodes.

    Args:
        sweep: What may be played.
    """

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        self.env: gym.Env[Any, Any] = gym.make(
            sweep.env,
            max_episode_steps=sweep.limit,
            disable_env_checker=True,
            **{**sweep.settings, "map": sweep.map},
        )
        self.agents = {name: sweep.agent(name) for name in sweep.agents}
        core = self.env.unwrapped
        assert isinstance(core, LocalizationEnv)
        self.core = core

    def reset(self, agent: str, episode: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """Put robot and agent at the start of an episode; returns observation and info."""
        options = self.sweep.options(episode)
        observation, info = self.env.reset(seed=self.sweep.env_seed(episode), options=options)
        self.agents[agent].reset(self.sweep.agent_rng(episode))
        return observation, info

    def rehearse(self, episode: int) -> None:
        """Take each agent's first step of an episode, so that nothing is refused later.

        Raises:
            ActiveLocError: If the map, the environment or an agent does not go with the others.
        """
        for name, agent in self.agents.items():
            observation, _ = self.reset(name, episode)
            self.env.step(agent.act(observation, self.core.knowledge))

    def play(self, agent: str, episode: int, watch: Watch | None = None) -> Record:
        """Play an episode to its end.

        Args:
            agent: Its name in the sweep.
            episode: Which one.
            watch: Called with the environment, the steps taken and ``info``: at the start and
                after every step.
        """
        observation, info = self.reset(agent, episode)
        tally = _Tally([info["entropy_fraction"]], [self._n_particles()], self.core.pose)
        meter = GainMeter()
        over = False
        while not over:
            if watch is not None:
                watch(self.core, len(tally.rewards), info)
            knowledge = self.core.knowledge
            begun = perf_counter()
            action = self.agents[agent].act(observation, knowledge)
            acted = perf_counter()
            if self.sweep.gains and isinstance(knowledge, Knowledge):
                meter.decided(knowledge, plan_of(self.agents[agent]))
            chosen = perf_counter()
            observation, reward, terminated, truncated, info = self.env.step(action)
            tally.act_s += acted - begun
            tally.step_s += perf_counter() - chosen
            moved = self.core.knowledge
            if isinstance(moved, Knowledge):
                meter.moved(moved)
            tally.rewards.append(float(reward))
            tally.entropy.append(info["entropy_fraction"])
            tally.n_particles.append(self._n_particles())
            over = terminated or truncated
        if watch is not None:
            watch(self.core, len(tally.rewards), info)
        tally.gains = tuple(meter.gains)
        return self._record(agent, episode, tally, info)

    def record(
        self, agent: str, episode: int, watch: Watch | None = None
    ) -> tuple[Record, Recording]:
        """:meth:`play`, taken down to be shown; durations are those of taking it down besides."""
        recorder = Recorder(self.env)
        self.env = recorder
        try:
            return self.play(agent, episode, watch), recorder.recording(agent)
        finally:
            self.env = recorder.env

    def _n_particles(self) -> int | None:
        belief = self.core.knowledge.belief
        return belief.n_particles(0) if isinstance(belief, ParticleBelief) else None

    def _record(self, agent: str, episode: int, tally: _Tally, info: Mapping[str, Any]) -> Record:
        """What is kept of an episode that has just ended."""
        sweep = self.sweep
        success, wrong = bool(info["is_success"]), bool(info["wrong"])
        played = len(tally.rewards)
        n_particles = [n for n in tally.n_particles if n is not None]
        return Record(
            agent=agent,
            map=self.core.grid.name,
            seed=sweep.seed,
            episode=episode,
            steps=int(info.get("success_step", played)) if success else sweep.limit,
            success=success,
            wrong=wrong,
            entropy_auc=penalised_area(tally.entropy, wrong, sweep.limit),
            final_entropy=float(info["entropy"]),
            error_m=float(info["error_m"]),
            error_rad=float(info["error_rad"]),
            total_reward=fsum(tally.rewards),
            played=played,
            entropy=tuple(float(value) for value in tally.entropy),
            start=(float(tally.start[0]), float(tally.start[1]), float(tally.start[2])),
            mass_at_truth=self.core.probability_at_truth,
            n_particles=fsum(n_particles) / len(n_particles) if n_particles else None,
            act_ms=1e3 * tally.act_s / played,
            step_ms=1e3 * tally.step_s / played,
            kidnapped=bool(info.get("kidnapped", False)),
            notice_steps=int(info.get("notice_steps", -1)),
            recover_steps=int(info.get("recover_steps", -1)),
            false_alarm=bool(info.get("false_alarm", False)),
            likeliest=bool(info.get("likeliest_is_true", False)),
            gains=tally.gains,
        )
