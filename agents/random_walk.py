"""Any action, equally likely."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from activeloc.envs.worlds import AnyKnowledge


@dataclass
class RandomAgent:
    """Uniform over the action space: the floor under every other agent."""

    rng: np.random.Generator = field(default_factory=np.random.default_rng, init=False)

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`."""
        self.rng = rng

    def act(self, observation: Mapping[str, Any], knowledge: AnyKnowledge) -> Any:
        """See :class:`Agent`."""
        if knowledge.actions.kind == "continuous":
            return self.rng.uniform(-1.0, 1.0, 2).astype(np.float32)
        return int(self.rng.integers(len(knowledge.actions.commands)))
