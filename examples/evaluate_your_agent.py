"""Evaluate an agent of your own: ``python examples/evaluate_your_agent.py [FOLDER]``.

Any object with ``reset(rng)`` and ``act(observation, knowledge)`` is an agent. This one drives on
and turns at walls, some number of times. It plays the same episodes as ``spin`` (maps, starts and
noise), so what is compared is the agents and not their luck. Printed is a row for each and one for
the paired difference, with 95 % bootstrap intervals; the folder (default ``out/bouncer``) gets the
episodes, the curves and a summary. Run again with more episodes, it goes on where it ended.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from activeloc.agents import AGENTS
from activeloc.agents.evaluation import Report, Sweep, evaluate
from activeloc.maps import MapSource

LEFT, FORWARD = 0, 2


@dataclass
class Bouncer:
    """Drives on; at a wall it turns left, up to ``most_turns`` times. Fields are its settings."""

    most_turns: int = 6

    def reset(self, rng: np.random.Generator) -> None:
        """An episode begins; all of the agent's chance must come from ``rng``."""
        self.rng, self.turns = rng, 0

    def act(self, observation: dict, knowledge: object) -> int:
        """Choose from what the robot sees and knows; the truth is in neither."""
        if self.turns == 0 and (knowledge.touched or np.nanmin(knowledge.scan) < 0.4):
            self.turns = int(self.rng.integers(1, self.most_turns + 1))
        if self.turns == 0:
            return FORWARD
        self.turns -= 1
        return LEFT


def main(folder: Path = Path("out/bouncer"), episodes: int = 16, steps: int = 100) -> Report:
    """Play and print; returns the report."""
    AGENTS["bouncer"] = Bouncer  # Known to this process: evaluate with jobs=1.
    maps = MapSource.parse("rooms(width=8,height=6):0-3")
    agents = {"spin": {}, "bouncer": {"most_turns": 4}}
    sweep = Sweep("activeloc/GlobalLocalization-v0", maps, agents, {}, episodes, limit=steps)
    report = evaluate(sweep, folder)
    for name, row in {**report.scores, "less spin": report.differences["bouncer"]}.items():
        for score in ("right", "wrong", "steps", "entropy_auc"):
            it = row[score]
            print(f"{name:10s} {score:12s} {it.value:7.2f} [{it.low:.2f}, {it.high:.2f}]")
    return report


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:2]))
