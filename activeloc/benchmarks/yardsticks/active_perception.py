"""PyPI ``ap-gym``: its task of finding oneself with a LIDAR, maps drawn anew (MIT, not ours).

Robots of eight beams on 32 x 32 cells; positions are exact and no belief is kept.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import Any

NAME = "ap_gym"
ID = "LIDARLocRooms-v0"
STEPS = 100
"""Of an episode."""


class Rooms:
    """The vector environment with random actions.

    Args:
        n: Environments.
        patience: Longest wait for the maps it draws in the background [s].
    """

    def __init__(self, n: int, patience: float) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import ap_gym

            self.env: Any = ap_gym.make_vec(ID, num_envs=n)
            self.env.reset(seed=0)
        self.actions = [self.env.action_space.sample() for _ in range(16)]
        self._settle(patience)

    def _settle(self, patience: float) -> None:
        """Wait until nothing runs in the background."""
        until = time.monotonic() + patience
        while time.monotonic() < until:
            before = time.process_time()
            time.sleep(0.25)
            if time.process_time() - before < 0.02:
                return

    def stepping(self, steps: int) -> Callable[[], None]:
        """So many steps of all environments."""

        def run() -> None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                for step in range(steps):
                    self.env.step(self.actions[step % 16])

        return run

    def close(self) -> None:
        """Stop its threads."""
        self.env.close()
