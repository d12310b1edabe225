"""Given mazes and starts, to play those that others have played."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.envs.maze_episodes import checked_pose, free_cells
from activeloc.errors import ConfigError, MapError
from activeloc.grid import OccupancyGrid


@dataclass(frozen=True, eq=False)
class Starts:
    """Mazes, and where in each of them an episode starts.

    Attributes:
        name: Of the file.
        free: ``(N, m, m)``; whether each cell is free.
        poses: ``(N, 3)``; row, column, heading index.
    """

    name: str
    free: NDArray[np.bool_]
    poses: NDArray[np.int64]

    @classmethod
    def load(cls, path: Path) -> Starts:
        """Read a ``.npz`` file.

        ``grids`` ``(N, m, m)`` of bool, true for walls or for free cells (the rim, which is wall,
        says which); ``poses`` ``(N, 3)`` of whole numbers: row, column, and heading 0 (along the
        columns), 1 (along the rows), 2 or 3.

        Raises:
            ConfigError: If the file cannot be read, or does not hold those two arrays.
            MapError: With the number of the first start that is none.
        """
        grids, poses = _arrays(path)
        if grids.dtype != np.bool_ or grids.ndim != 3 or grids.size == 0:
            raise ConfigError(
                f"{path}: grids must be bools (N, m, m); got {grids.dtype} {grids.shape}"
            )
        if poses.dtype.kind not in "iuf" or poses.shape != (len(grids), 3):
            raise ConfigError(
                f"{path}: poses must be whole numbers ({len(grids)}, 3); "
                f"got {poses.dtype} {poses.shape}"
            )
        free = np.empty_like(grids)
        for i in range(len(grids)):
            try:
                free[i] = free_cells(grids[i])[0]
                checked_pose(poses[i], free[i : i + 1])
            except MapError as error:
                raise MapError(f"{path}: start {i}: {error}") from None
        return cls(path.name, free, poses.astype(np.int64))

    def __len__(self) -> int:
        return len(self.free)

    def options(self, episode: int) -> dict[str, Any]:
        """What the environment is reset with."""
        grid = OccupancyGrid(~self.free[episode], 1.0, name=f"{self.name}-{episode}")
        return {"grid": grid, "pose": tuple(int(value) for value in self.poses[episode])}

    @property
    def digest(self) -> str:
        """SHA-256 of mazes and poses."""
        head = repr(self.free.shape).encode()
        return sha256(head + self.free.tobytes() + self.poses.tobytes()).hexdigest()


def _arrays(path: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            if not isinstance(file, np.lib.npyio.NpzFile):
                raise ConfigError(f"{path}: expected a .npz file with grids and poses")
            for name in ("grids", "poses"):
                if name not in file:
                    raise ConfigError(f"{path}: no array {name!r} (it has {', '.join(file.files)})")
            return file["grids"], file["poses"]
    except (OSError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path}: cannot read it: {error}") from None
    except ValueError as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"{path}: cannot read it: {error}") from None
