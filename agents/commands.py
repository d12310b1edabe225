"""How an agent says "turn left" or "drive" in the action space at hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from activeloc.envs.actions import Actions

LEFT, RIGHT, FORWARD = 0, 1, 2


def action_for(actions: Actions, move: int) -> Any:
    """The action that turns left, turns right or drives by the full step of either space."""
    if actions.kind == "discrete":
        return move
    pair = {LEFT: (1.0, -1.0), RIGHT: (-1.0, -1.0), FORWARD: (0.0, 1.0)}[move]
    return np.array(pair, dtype=np.float32)
