"""What is kept of an episode, and the file that it is kept in.

``.episodes.jsonl`` holds the configuration on its first line and one record on each line after it,
in the order in which episodes ended; where a later run adds agents, its configuration follows. A
line is written at once; one that was cut off at the end of the file (the process died, the disk was
full) is forgotten.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from activeloc.errors import ConfigError

FILE_NAME = ".episodes.jsonl"
LOST = 1e-3
"""A belief with less than this near the truth has lost it."""


@dataclass(frozen=True, slots=True)
class Record:
    """One agent's episode.

    Attributes:
        agent: Its name.
        map: The map's name.
        seed: Of the sweep.
        episode: Number of the episode, from zero.
        steps: Until a right declaration, in a maze until the belief was right to stay; the limit
            for every other episode.
        success: Declared, and right; in tracking, near the truth at the limit; in a maze the strict
            accuracy.
        wrong: Declared, and wrong; in tracking, sure at the limit but not near the truth.
        entropy_auc: Penalised area under the entropy curve, in [0, 1]: :func:`penalised_area`.
        final_entropy: Of the last belief [nat].
        error_m: Distance of the last estimate from the truth [m]; in a maze [cell].
        error_rad: Angle between them [rad].
        total_reward: The undiscounted return.
        played: Steps that were played, to the declaration or the limit.
        entropy: Fractions of the uniform belief's entropy: at the start, then after each step.
        start: True pose x [m], y [m], theta [rad] at the start; in a maze row, column, heading.
        mass_at_truth: How much of the last belief lies near the truth, as for a declaration.
        n_particles: Mean over the steps; None if the belief is not made of particles.
        act_ms: Mean duration of a decision [ms].
        step_ms: Mean duration of a step of the environment [ms].
        kidnapped: Whether the robot was carried off; this and the next three are a kidnapped
            robot's, in the words of :mod:`activeloc.envs.tasks`.
        notice_steps: From then until the belief let go; -1 if it did not.
        recover_steps: From then until a right declaration; -1 if there was none.
        false_alarm: Whether the belief gave up a right pose with nobody having touched the robot.
        likeliest: In a maze, whether the most likely state was the true one at the end.
        gains: What the agent expected of each scan it planned for and what that scan gave,
            ``(expected, realised)`` [nat] each: :mod:`activeloc.agents.evaluation.gains`. Empty
            if it was not asked for.
    """

    agent: str
    map: str
    seed: int
    episode: int
    steps: int
    success: bool
    wrong: bool
    entropy_auc: float
    final_entropy: float
    error_m: float
    error_rad: float
    total_reward: float
    played: int
    entropy: tuple[float, ...]
    start: tuple[float, float, float]
    mass_at_truth: float
    n_particles: float | None
    act_ms: float
    step_ms: float
    kidnapped: bool = False
    notice_steps: int = -1
    recover_steps: int = -1
    false_alarm: bool = False
    likeliest: bool = False
    gains: tuple[tuple[float, float], ...] = ()

    @property
    def key(self) -> tuple[str, int]:
        """Agent and episode."""
        return self.agent, self.episode

    @property
    def truth_lost(self) -> bool:
        """Whether next to nothing of the last belief lies near the truth."""
        return self.mass_at_truth < LOST

    def curve(self, limit: int) -> list[float]:
        """:func:`scored_curve` of the episode."""
        return scored_curve(self.entropy, self.wrong, limit)


def scored_curve(entropy: Sequence[float], wrong: bool, limit: int) -> list[float]:
    """Entropy fractions at steps 0 to ``limit``, in [0, 1], as an episode is scored.

    After a right declaration they are 0, after a wrong one 1. The declaring step itself keeps what
    was measured.

    Args:
        entropy: At the start and after each step that was played.
        wrong: Whether the declaration that ended the episode was wrong.
        limit: Step to which the curve goes on.
    """
    measured = [min(1.0, max(0.0, value)) for value in entropy]
    return measured + [1.0 if wrong else 0.0] * (limit + 1 - len(measured))


def penalised_area(entropy: Sequence[float], wrong: bool, limit: int) -> float:
    """Mean of :func:`scored_curve` over steps 1 to ``limit``."""
    return math.fsum(scored_curve(entropy, wrong, limit)[1:]) / limit


@dataclass(frozen=True, slots=True)
class Stored:
    """What a file holds.

    Attributes:
        configurations: Those that its records belong to; they agree but for the agents they name.
        records: In the order in which they were written.
        length: Of its whole lines [byte].
    """

    configurations: list[Mapping[str, Any]]
    records: list[Record]
    length: int

    def demand(self, folder: Path, configuration: Mapping[str, Any]) -> None:
        """Refuse to go on with another configuration than the records have.

        Agents that only one of the two names are no matter.

        Raises:
            ConfigError: With the first setting that differs.
        """
        for known in self.configurations:
            difference = _difference(known, json.loads(json.dumps(configuration)))
            if difference is not None:
                name, old, new = difference
                raise ConfigError(
                    f"{folder} holds episodes of another configuration: {name} was {old!r} and is "
                    f"now {new!r}; choose another folder or start with --overwrite"
                )


def read_records(path: Path) -> Stored:
    """Read a file of records; nothing where there is none.

    Raises:
        ConfigError: If it is damaged before its last line.
        OSError: If it cannot be read.
    """
    content = path.read_bytes() if path.exists() else b""
    whole = content[: content.rfind(b"\n") + 1]
    stored = Stored([], [], len(whole))
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            entry = json.loads(line)
            if number == 1 or "configuration" in entry:
                stored.configurations.append(dict(entry["configuration"]))
            else:
                stored.records.append(_record(entry))
        except (ValueError, TypeError, KeyError):
            raise ConfigError(f"{path}: line {number} is damaged; start with --overwrite") from None
    return stored


class RecordFile:
    """The records of a folder, appended to one by one.

    Args:
        path: Of the file; made if there is none.
        configuration: What further records belong to: plain data.

    Raises:
        ConfigError: If the file holds episodes of another configuration, or is damaged before its
            last line.
        OSError: If it cannot be read or written.
    """

    def __init__(self, path: Path, configuration: Mapping[str, Any]) -> None:
        stored = read_records(path)
        stored.demand(path.parent, configuration)
        self.records = stored.records
        self._file = path.open("ab")
        self._file.truncate(stored.length)
        if json.loads(json.dumps(configuration)) not in stored.configurations:
            self._write({"configuration": configuration})

    def append(self, record: Record) -> None:
        """Keep a record: it is in the file when this returns."""
        self._write(asdict(record))
        self.records.append(record)

    def close(self) -> None:
        """No more records."""
        self._file.close()

    def _write(self, entry: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(entry, allow_nan=False).encode() + b"\n")
        self._file.flush()


def _record(entry: Mapping[str, Any]) -> Record:
    """A record from its line.

    Fields with a default may be missing: a file of an older version is told from ours by its
    configuration, which says more than a line that cannot be read.

    Raises:
        TypeError: If another name is missing, or one is foreign.
        ValueError: If a gain is no pair.
    """
    sequences = {"entropy": (*entry["entropy"],), "start": (*entry["start"],)}
    gains = tuple((expected, realised) for expected, realised in entry.get("gains", ()))
    return Record(**{**entry, **sequences, "gains": gains})


def _difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> tuple[str, Any, Any] | None:
    """The first setting that differs: its dotted name and both values."""
    agents = set(old.get("agents", {})) & set(new.get("agents", {}))
    olds, news = _flat(old), _flat(new)
    for name in sorted({*olds, *news}):
        if name.startswith("agents.") and name.split(".")[1] not in agents:
            continue
        if olds.get(name) != news.get(name):
            return name, olds.get(name), news.get(name)
    return None


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings to one, with dotted names."""
    flat: dict[str, Any] = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat
