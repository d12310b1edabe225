"""The discrete depth sensor: how many cells to the wall ahead?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from activeloc.errors import ConfigError, ScanError


@dataclass(frozen=True, eq=False)
class DepthSensor:
    """p(z | d) from a confusion matrix over depths counted in cells.

    The depth d of a cell and heading is the number of cells from the robot's own to the wall
    ahead, at least 1. The classic maze task of Active Neural Localization (Chaplot et al., 2018)
    is the identity matrix.

    Attributes:
        confusion: ``(D, D)``; row d - 1 holds P(z = 1 ... D | d) and sums to one.

    Raises:
        ConfigError: If the matrix is not square, has a negative or non-finite entry, or a row that
            does not sum to one.
    """

    confusion: NDArray[np.float64]

    def __post_init__(self) -> None:
        matrix = np.array(self.confusion, dtype=np.float64)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.size == 0:
            raise ConfigError(f"DepthSensor.confusion must be (D, D), got shape {matrix.shape}")
        if not (np.isfinite(matrix).all() and (matrix >= 0.0).all()):
            raise ConfigError("DepthSensor.confusion must hold probabilities, got a value below 0")
        sums = matrix.sum(axis=1)
        if not np.allclose(sums, 1.0, atol=1e-9):
            worst = int(np.abs(sums - 1.0).argmax())
            raise ConfigError(
                f"DepthSensor.confusion row {worst} must sum to 1, got {sums[worst]:g}"
            )
        matrix.flags.writeable = False
        object.__setattr__(self, "confusion", matrix)

    @classmethod
    def exact(cls, depths: int) -> DepthSensor:
        """A sensor without error for depths ``1 ... depths``."""
        return cls(np.eye(depths))

    @classmethod
    def off_by_one(cls, depths: int, p_wrong: float = 0.106) -> DepthSensor:
        """Off by -1 and +1 with probability ``p_wrong`` each; what leaves the range stays inside.

        Section "noisy" of Active Neural Localization's mazes.
        """
        matrix = np.zeros((depths, depths))
        for d in range(depths):
            for error, p in ((-1, p_wrong), (0, 1.0 - 2.0 * p_wrong), (1, p_wrong)):
                matrix[d, min(max(d + error, 0), depths - 1)] += p
        return cls(matrix)

    def likelihood(self, z: int, depth: NDArray[np.int32]) -> NDArray[np.float64]:
        """P(z | depth) for depths of any shape.

        Raises:
            ScanError: If z is not in ``1 ... D``.
        """
        self._check(z)
        result: NDArray[np.float64] = self.confusion[np.asarray(depth) - 1, z - 1]
        return result

    def sample(self, depth: int, uniform: float) -> int:
        """Draw a reading of a depth from one uniform number in [0, 1)."""
        cumulative = self.confusion[depth - 1].cumsum()
        return int((uniform * cumulative[-1] >= cumulative).sum()) + 1

    def _check(self, z: int) -> None:
        if not 1 <= z <= len(self.confusion):
            raise ScanError(f"depth reading must be in 1 ... {len(self.confusion)}, got {z}")


def depths(free: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Cells to the wall from every free cell in four directions: ``(4, H, W)``; 0 in walls.

    Directions are +x, +y, -x, -y: counter-clockwise from the column axis. The outside is wall.
    """
    height, width = free.shape
    result = np.zeros((4, height, width), dtype=np.int32)
    for direction, (row_step, col_step) in enumerate(((0, 1), (1, 0), (0, -1), (-1, 0))):
        for row, col in np.argwhere(free):
            r, c = row, col
            while 0 <= r < height and 0 <= c < width and free[r, c]:
                r, c = r + row_step, c + col_step
            result[direction, row, col] = abs(r - row) + abs(c - col)
    return result
