"""Where an environment's maps come from: one map, or a distribution over maps.

A building is a generator, its parameters and a number, the *seed*: the building with seed s is
``generator.generate(np.random.default_rng(s))``, wherever and whenever it is drawn.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from activeloc.errors import ConfigError
from activeloc.grid import OccupancyGrid
from activeloc.maps.cave import Cave
from activeloc.maps.formats import SUFFIXES, load_map
from activeloc.maps.maze import Maze
from activeloc.maps.office import Office
from activeloc.maps.rooms import Rooms


class MapGenerator(Protocol):
    """What draws maps: a frozen dataclass of parameters, equal and hashable by them."""

    def generate(self, rng: np.random.Generator) -> OccupancyGrid:
        """Draw a map; the same state of ``rng`` gives the same map."""
        ...

    def __hash__(self) -> int:
        """By the parameters; buildings are kept by generator and seed."""
        ...


GENERATORS: dict[str, type[Any]] = {
    "cave": Cave,
    "maze": Maze,
    "office": Office,
    "rooms": Rooms,
}
MAX_SEED = 2**62

_SPEC = re.compile(r"(?P<name>[^():]*)(\((?P<parameters>[^()]*)\)\s*)?(:(?P<seeds>.*))?", re.ASCII)
_SEEDS = re.compile(r"(\d{1,19})(?:-(\d{1,19}))?", re.ASCII)
_INT = re.compile(r"[-+]?\d{1,18}", re.ASCII)
_FLOAT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True)
class MapSource:
    """One map, some maps with numbers, or maps without end.

    Attributes:
        spec: What to call the source.
        grid: The map, if the source is one map that was given or read.
        generator: What draws the maps otherwise.
        seeds: Of the buildings that the source holds; ``None`` for all there are.
    """

    spec: str
    grid: OccupancyGrid | None = None
    generator: MapGenerator | None = None
    seeds: range | None = None

    def __post_init__(self) -> None:
        """Refuse a source of nothing, or of two things."""
        if (self.grid is None) == (self.generator is None):
            raise ConfigError(f"map {self.spec!r}: give either a grid or a generator")
        if self.seeds is not None and not self.seeds:
            raise ConfigError(f"map {self.spec!r}: the range of seeds is empty")

    @classmethod
    def parse(cls, spec: str | os.PathLike[str] | OccupancyGrid | MapSource) -> MapSource:
        """Understand what a user wrote for ``map``.

        Args:
            spec: A map; or the path of a map file; or a generator's name, with parameters in
                brackets or without, then a colon and seeds or nothing, which means seed 0::

                    office                        the office with seed 0
                    office:7                      the office with seed 7
                    office:0-3                    the offices with seeds 0, 1, 2 and 3
                    office:*                      a new office whenever one is drawn
                    office(rooms=6,door=0.8):2    an office of other measures

        Raises:
            ConfigError: If a generator, a parameter or a value is none that there is.
            MapError: If a map file is absent or cannot be used.
        """
        if isinstance(spec, MapSource):
            return spec
        if isinstance(spec, OccupancyGrid):
            return cls(spec.name, grid=spec)
        if not isinstance(spec, str | os.PathLike):
            raise ConfigError(f"map must be a string, a path or a map, got {spec!r}")
        if not isinstance(spec, str) or _is_path(spec):
            path = Path(spec)
            return cls(str(path), grid=load_map(path))
        return _parse_generator(spec)

    @property
    def n_maps(self) -> int | None:
        """How many maps there are; ``None`` if there is no end to them."""
        if self.grid is not None:
            return 1
        return None if self.seeds is None else len(self.seeds)

    @property
    def is_fixed(self) -> bool:
        """Whether there is one map only."""
        return self.n_maps == 1

    def draw(self, rng: np.random.Generator) -> OccupancyGrid:
        """One of the maps, each as likely as the others; a fixed map leaves ``rng`` as it was."""
        if self.is_fixed:
            return self.number(0)
        if self.n_maps is None:
            return self.number(int(rng.integers(2**32)))
        return self.number(int(rng.integers(self.n_maps)))

    def number(self, i: int) -> OccupancyGrid:
        """The i-th map, counted from zero and round again; of maps without end, that of seed i.

        Raises:
            ConfigError: If i is negative.
        """
        if i < 0:
            raise ConfigError(f"map {self.spec!r}: a map's number must be at least 0, got {i}")
        if self.grid is not None:
            return self.grid
        assert self.generator is not None
        if self.seeds is None:
            return _build(self.generator, i)
        return _build_cached(self.generator, self.seeds[i % len(self.seeds)])


def _build(generator: MapGenerator, seed: int) -> OccupancyGrid:
    """The building with a seed, named after both."""
    grid = generator.generate(np.random.default_rng(seed))
    return grid.renamed(f"{grid.name}-{seed}")


@lru_cache(maxsize=64)
def _build_cached(generator: MapGenerator, seed: int) -> OccupancyGrid:
    return _build(generator, seed)


def _is_path(spec: str) -> bool:
    """Whether a spec means a file: it has a folder in it, or the suffix of a map."""
    return "/" in spec or os.sep in spec or Path(spec).suffix.lower() in SUFFIXES


def _parse_generator(spec: str) -> MapSource:
    match = _SPEC.fullmatch(spec.strip())
    if match is None:
        raise ConfigError(f"map {spec!r}: expected NAME, NAME(PARAMETER=VALUE,...) or NAME:SEEDS")
    name, parameters, seeds = match["name"].strip(), match["parameters"], match["seeds"]
    if name not in GENERATORS:
        known = f"{', '.join(GENERATORS)}, or a file that ends in {', '.join(SUFFIXES)}"
        raise ConfigError(
            f"map {spec!r}: no generator {name!r}{_nearest(name, GENERATORS)}; there are {known}"
        )
    generator = GENERATORS[name](**_parse_parameters(spec, name, parameters or ""))
    return MapSource(spec, generator=generator, seeds=_parse_seeds(spec, seeds))


def _parse_parameters(spec: str, name: str, text: str) -> dict[str, int | float]:
    """The generator's arguments from ``a=1,b=2.5``."""
    types = {field.name: str(field.type) for field in fields(GENERATORS[name])}
    arguments: dict[str, int | float] = {}
    for item in text.split(",") if text.strip() else []:
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals or not value:
            raise ConfigError(f"map {spec!r}: parameter {item!r}; expected NAME=VALUE")
        if key not in types:
            raise ConfigError(
                f"map {spec!r}: {name} has no parameter {key!r}{_nearest(key, types)}; "
                f"there are {', '.join(types)}"
            )
        if key in arguments:
            raise ConfigError(f"map {spec!r}: {key} is given twice")
        whole = types[key] == "int"
        if not (_INT if whole else _FLOAT).fullmatch(value):
            noun = "a whole number" if whole else "a number"
            raise ConfigError(f"map {spec!r}: {key} must be {noun}, got {value!r}")
        arguments[key] = int(value) if whole else float(value)
    return arguments


def _parse_seeds(spec: str, text: str | None) -> range | None:
    """The seeds from ``7``, ``0-3`` or ``*``."""
    if text is None:
        return range(1)
    if text.strip() == "*":
        return None
    match = _SEEDS.fullmatch(text.strip())
    if match is None:
        raise ConfigError(
            f"map {spec!r}: seeds must be a whole number, FIRST-LAST or *, got {text!r}"
        )
    first = int(match[1])
    last = first if match[2] is None else int(match[2])
    if not first <= last <= MAX_SEED:
        raise ConfigError(
            f"map {spec!r}: seeds must run upwards and to {MAX_SEED} at most, got {text!r}"
        )
    return range(first, last + 1)


def _nearest(name: str, known: Iterable[str]) -> str:
    near = get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""
