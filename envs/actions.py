"""What a robot can be told to do: a table of commands, or a continuous pair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from activeloc import checks
from activeloc.errors import ActionError


@lru_cache(maxsize=64)
def _table(turn: float, forward: float, stay: bool) -> NDArray[np.float64]:
    """``(A, 3)``; not to be written into, for it is kept."""
    table = [[turn, 0.0, 0.0], [-turn, 0.0, 0.0], [0.0, forward, 0.0]]
    result = np.array([*table, [0.0, 0.0, 0.0]] if stay else table)
    result.flags.writeable = False
    return result


@dataclass(frozen=True, slots=True)
class Actions:
    """The action space and the commands that its actions stand for.

    Attributes:
        kind: ``discrete`` (0 turn left, 1 turn right, 2 drive forward, and 3 stay if there is one)
            or ``continuous`` (a pair in [-1, 1]: turn from right to left, then drive from nothing
            to all of ``forward``).
        turn: Angle of a turn [rad].
        forward: Length of a drive [m].
        stay: Whether there is an action that does nothing but read the sensor.

    Raises:
        ConfigError: If a value is out of its range.
    """

    kind: str = "discrete"
    turn: float = float(np.pi / 6.0)
    forward: float = 0.5
    stay: bool = False

    def __post_init__(self) -> None:
        checks.choice("actions.kind", self.kind, ("discrete", "continuous"))
        checks.number("actions.turn", self.turn, 0.0, np.pi, above_low=True)
        checks.number("actions.forward", self.forward, 0.0, 100.0, above_low=True)
        checks.boolean("actions.stay", self.stay)

    @property
    def space(self) -> gym.spaces.Space[Any]:
        """The action space of one robot."""
        if self.kind == "continuous":
            return gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
        return gym.spaces.Discrete(len(self.commands))

    @property
    def commands(self) -> NDArray[np.float64]:
        """``(A, 3)``; the command of each discrete action: rotation, translation, rotation."""
        return _table(self.turn, self.forward, self.stay).copy()

    def command(self, action: object) -> NDArray[np.float64]:
        """The command ``(3,)`` that an action stands for.

        Raises:
            ActionError: If the action is not in the space.
        """
        if self.kind == "continuous":
            return self._continuous(action)
        table = _table(self.turn, self.forward, self.stay)
        if type(action) is int or isinstance(action, np.integer):
            which = int(action)
        else:
            given = _as_array(action)
            which = int(given) if given.dtype.kind in "iu" and given.ndim == 0 else -1
        if not 0 <= which < len(table):
            raise ActionError(f"action must be an integer in [0, {len(table) - 1}]; got {action!r}")
        return table[which].copy()

    def words(self, action: object) -> str:
        """:func:`words_of` the command that an action stands for.

        Raises:
            ActionError: If the action is not in the space.
        """
        return words_of(self.command(action))

    def _continuous(self, action: object) -> NDArray[np.float64]:
        given = _as_array(action)
        if given.dtype.kind not in "iuf" or given.shape != (2,):
            raise ActionError(f"action must be two numbers in [-1, 1]; got {action!r}")
        if not (np.abs(given) <= 1.0 + 1e-6).all():
            raise ActionError(f"action must be two numbers in [-1, 1]; got {action!r}")
        turn, drive = np.clip(given.astype(np.float64), -1.0, 1.0)
        return np.array([turn * self.turn, 0.5 * (drive + 1.0) * self.forward, 0.0])


def words_of(command: NDArray[np.float64]) -> str:
    """A command for people to read: ``turn left 30 deg``, ``drive 0.5 m``, both, or ``stay``."""
    turn, drive, _ = (float(value) for value in command)
    parts = []
    if turn != 0.0:
        side = "left" if turn > 0.0 else "right"
        parts.append(f"turn {side} {np.rad2deg(abs(turn)):.3g} deg")
    if drive != 0.0:
        parts.append(f"drive {drive:.3g} m")
    return ", ".join(parts) or "stay"


def _as_array(action: object) -> NDArray[Any]:
    """The action as an array; what can be none becomes words, which no space holds."""
    try:
        return np.asarray(action)
    except ValueError:
        return np.array("ragged")
