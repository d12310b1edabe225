"""Draw ``docs/metric_view.png``: ``python docs/figures/metric_view.py``.

A robot in a generated office after a few steps: what stands for its belief, and the view that
averages over it.
"""

from pathlib import Path

import gymnasium as gym
import numpy as np

import activeloc  # noqa: F401  registers the environments
from activeloc.beliefs.metric_view import HYPOTHESES
from activeloc.plots import plot_surroundings

SEED = 3
ACTIONS = (0, 0, 2, 2, 0, 2, 2)


def main() -> None:
    """Play the start of an episode and draw it."""
    env = gym.make(
        "activeloc/GlobalLocalization-v0",
        map="office:7", belief="particles", observation={"view": True},
    )  # fmt: skip
    observation, _ = env.reset(seed=SEED)
    for action in ACTIONS:
        observation = env.step(action)[0]
    core = env.unwrapped
    poses = core.knowledge.belief.thinned(0, HYPOTHESES)[0]
    target = Path(__file__).resolve().parent.parent / "metric_view.png"
    plot_surroundings(
        core.grid.free, core.grid.extent, np.concatenate([core.pose[None], poses]),
        observation["view"], observation["ways"], target,
    )  # fmt: skip
    print(f"{target}: {len(poses)} hypotheses")


if __name__ == "__main__":
    main()
