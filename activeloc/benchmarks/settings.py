"""How thoroughly, with how many threads, on which maps."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from activeloc import checks
from activeloc.errors import ConfigError

MAPS_VARIABLE = "ACTIVELOC_MAPS"


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of a run of the benchmarks.

    Attributes:
        quick: Small sizes and few rounds: seconds a subject, to see that all of it works.
        threads: Most threads that rows about threads use.
        maps: Folder with ``basement_hallways.png``; without it a map of the like is generated.

    Raises:
        ConfigError: If a number is out of its range, or the folder is none.
    """

    quick: bool = False
    threads: int = 2
    maps: Path | None = None

    def __post_init__(self) -> None:
        checks.integer("threads", self.threads, 1, 256)
        if self.maps is not None and not self.maps.is_dir():
            raise ConfigError(f"maps: {self.maps} is no folder")

    @property
    def budget(self) -> float:
        """About how long the rounds of one comparison take [s]."""
        return 0.05 if self.quick else 2.0

    @property
    def rounds(self) -> tuple[int, int]:
        """Fewest and most rounds."""
        return (2, 3) if self.quick else (7, 41)

    def plain(self) -> dict[str, object]:
        """As they are kept with the results."""
        return {
            "quick": self.quick,
            "threads": self.threads,
            "maps": None if self.maps is None else self.maps.name,
        }

    def size(self, full: int, quick: int) -> int:
        """One of two sizes."""
        return quick if self.quick else full


def maps_from_environment() -> Path | None:
    """The folder that the environment names, if it names one."""
    given = os.environ.get(MAPS_VARIABLE)
    return Path(given) if given else None
