"""Draw ``docs/egocentric.png``: ``python docs/figures/egocentric.py``.

A robot in a maze of 15 x 15 cells after a first reading and a turn: where it may be, and the view
that averages over those places.
"""

from pathlib import Path

import gymnasium as gym
import numpy as np

import activeloc  # noqa: F401  registers the environments
from activeloc.plots import plot_egocentric

SEED = 3
ACTIONS = (0, 2)


def main() -> None:
    """Play the start of an episode and draw it."""
    env = gym.make("activeloc/Maze15-v0", observation={"view": True})
    observation, _ = env.reset(seed=SEED)
    for action in ACTIONS:
        observation = env.step(action)[0]
    core = env.unwrapped
    knowledge = core.knowledge
    candidates = knowledge.belief.candidates()
    places = [
        knowledge.lattice.pose_of(0, int(state))
        for state in candidates.states[0, : candidates.n[0]]
    ]
    places.sort(key=lambda place: not np.array_equal(place, core.pose))
    target = Path(__file__).resolve().parent.parent / "egocentric.png"
    plot_egocentric(
        knowledge.lattice.free[0], np.array(places).astype(int), observation["view"], target
    )
    print(f"{target}: {len(places)} candidates")


if __name__ == "__main__":
    main()
