"""An episode that is driven by keys: what each key does, and what is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.agents.advice import Advice, advise
from activeloc.agents.commands import FORWARD, LEFT, RIGHT, action_for
from activeloc.agents.evaluation import Player, Sweep
from activeloc.envs.recorder import Recorder
from activeloc.envs.rendering import Block, Recording, draw, layout, outcome_of, with_sidebar

MOVES = {
    "left": LEFT,
    "a": LEFT,
    "right": RIGHT,
    "d": RIGHT,
    "up": FORWARD,
    "w": FORWARD,
}
STAY = ("down", "s", "space")
KEYS = (
    "arrows or W A D: drive and turn",
    "S: stay, where the robot can",
    "T: show where it really is",
    "R: the same episode again",
    "N: the next episode",
    "Esc: leave",
)


@dataclass(frozen=True, slots=True)
class Result:
    """How an episode ended.

    Attributes:
        episode: Its number.
        map: The map's name.
        outcome: In words.
        steps: That were taken.
    """

    episode: int
    map: str
    outcome: str
    steps: int

    def __str__(self) -> str:
        return f"episode {self.episode} on {self.map}: {self.outcome} after {self.steps} steps"


class Game:
    """The episodes of a sweep, one after another, played by hand.

    Args:
        sweep: What is played; its agents give advice.
        episode: The first one's number.
        size: Longer side of the picture [px], without the column beside it.

    Raises:
        ActiveLocError: If an agent or the map does not go with the environment.
    """

    def __init__(self, sweep: Sweep, episode: int = 0, size: int = 800) -> None:
        player = Player(sweep)
        player.rehearse(episode)
        self.sweep = sweep
        self.size = size
        self.agents = player.agents
        self.core = player.core
        self.env = Recorder(player.env)
        self.results: list[Result] = []
        self._advice: list[Advice] | None = None
        self.shows_truth = False
        self.over = False
        self._start(episode)

    def press(self, key: str) -> bool:
        """Do what a key stands for; whether there is something new to see.

        Args:
            key: Its name, as pygame has it: ``left``, ``w``, ``space`` ...
        """
        if key == "t":
            self.shows_truth = not self.shows_truth
        elif key == "n":
            self._start(self.episode + 1)
        elif key == "r":
            self._start(self.episode)
        else:
            action = self._action(key)
            if action is None or self.over:
                return False
            self._step(action)
        return True

    def frame(self) -> NDArray[np.uint8]:
        """What there is to see: ``(H, W, 3)``; of one shape while the map is the same."""
        scene = self.core.scene
        if not (self.shows_truth or self.over):
            scene = replace(scene, pose=None)
        text = layout(scene.grid, self.size).text
        return with_sidebar(draw(scene, self.size), self._blocks(), text)

    @property
    def advice(self) -> list[Advice]:
        """What each agent would do now; nothing once the episode is over.

        They are asked when somebody looks, so that keys in a row do not wait for planners.
        """
        if self._advice is None:
            rng = np.random.default_rng([self.episode, self.steps])
            asked = {} if self.over else self.agents
            self._advice = advise(asked, self.observation, self.core.knowledge, rng)
        return self._advice

    def recording(self) -> Recording:
        """The episode so far."""
        return self.env.recording("you")

    def _start(self, episode: int) -> None:
        self.episode, self.over = episode, False
        sweep = self.sweep
        self.observation, self.info = self.env.reset(
            seed=sweep.env_seed(episode), options=sweep.options(episode)
        )
        self.steps = 0
        self._advice = None

    def _step(self, action: object) -> None:
        self.observation, _, terminated, truncated, self.info = self.env.step(action)
        self.steps += 1
        self.over = terminated or truncated
        if self.over:
            outcome = outcome_of(self.info)
            self.results.append(Result(self.episode, self.core.grid.name, outcome, self.steps))
        self._advice = None

    def _action(self, key: str) -> Any:
        """The action of a key; None if it has none here."""
        actions = self.core.knowledge.actions
        if key in MOVES:
            return action_for(actions, MOVES[key])
        if key in STAY and actions.kind == "continuous":
            return np.array([0.0, -1.0], dtype=np.float32)
        if key in STAY and actions.stay:
            return len(actions.commands) - 1
        return None

    def _blocks(self) -> Sequence[Block]:
        info = self.info
        known = [(f"{info['mass']:.0%} near the estimate", False)]
        if self.shows_truth or self.over:
            error = f"error {info['error_m']:.2f} m, {degrees(info['error_rad']):.0f} deg"
            known.append((error, False))
        share = float(np.clip(info["entropy_fraction"], 0.0, 1.0))
        blocks = [Block(f"entropy {info['entropy']:.2f} nat", known, share)]
        if self.over:
            again = [("N: next episode, R: again", False)]
            blocks.append(Block(f"{outcome_of(info)}, {self.steps} steps", again))
        elif self.advice:
            lines = [line for advice in self.advice for line in _lines(advice)]
            blocks.append(Block("what each would do now", lines))
        return [*blocks, Block("keys", [(line, True) for line in KEYS])]


def _lines(advice: Advice) -> list[tuple[str, bool]]:
    lines = [(f"{advice.agent}: {advice.words}", False)]
    if advice.expected_gain is not None:
        walk = f"{advice.walk}: " if advice.walk else ""
        lines.append((f"{walk}expects {advice.expected_gain:.2f} nat", True))
    return lines
