"""Trained policies as agents, without torch: ``onnx:FILE``, and ``ppo`` for the packaged ones.

A file has the observation's keys as inputs and ``logits`` ``(N, A)`` as output;
:mod:`activeloc.agents.sb3.export` writes such. onnxruntime runs it, in one thread, and is imported
when the first policy is loaded (``pip install activeloc[onnx]``).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activeloc.agents.commands import LEFT, RIGHT
from activeloc.beliefs.egocentric import EgocentricView
from activeloc.beliefs.metric_view import MetricView
from activeloc.envs.maze_episodes import MazeKnowledge
from activeloc.envs.worlds import AnyKnowledge
from activeloc.errors import CheckpointError, ConfigError

MEMORY = ("memory_h", "memory_c")
LARGEST = 256 * 2**20
"""Largest file that is read [byte]."""

PREFIX = "onnx:"
PACKAGED = ("ppo",)
"""Names of packaged policies: one for each environment that has one."""


class Network:
    """A network that onnxruntime runs.

    Attributes:
        inputs: Shape of each input but for the batch's axis; None where any length goes.

    Raises:
        ConfigError: If onnxruntime is not installed.
        CheckpointError: If the content is no ONNX network, or gives no ``logits``.
    """

    def __init__(self, content: bytes, name: str = "network") -> None:
        try:
            import onnxruntime
        except ImportError:
            raise ConfigError(
                "trained policies need onnxruntime: pip install 'activeloc[onnx]'"
            ) from None
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            # onnxruntime's errors share no class but this.
            reason = " ".join(str(error).split())[:120]
            raise CheckpointError(f"{name}: is no ONNX network: {reason}") from None
        outputs = [output.name for output in self._session.get_outputs()]
        if outputs[:1] != ["logits"]:
            raise CheckpointError(f"{name}: the first output must be logits; got {outputs}")
        self.name = name
        self.inputs = {
            item.name: [n if isinstance(n, int) else None for n in item.shape]
            for item in self._session.get_inputs()
        }

    def run(self, inputs: Mapping[str, NDArray[np.float32]]) -> list[NDArray[Any]]:
        """Logits ``(N, A)``, and the memory behind them, if there is one."""
        return list(self._session.run(None, {name: inputs[name] for name in self.inputs}))

    def memory(self) -> dict[str, NDArray[np.float32]]:
        """Memory of one robot at the start of an episode; empty if the network has none."""
        return {
            name: np.zeros([1 if n is None else n for n in shape], dtype=np.float32)
            for name, shape in self.inputs.items()
            if name in MEMORY
        }


@dataclass
class OnnxAgent:
    """Takes the action that a trained network ranks highest.

    At an observation that has come before in the episode, to the bit, it takes the highest of those
    that it has not taken there, until all have been: a robot that chooses by what it sees would
    go in a circle otherwise. A network with a memory or a clock sees to that itself.

    On a metric map no observation comes twice. There it takes no turn back, and none after a full
    circle, before it has driven: the two turns are often worth the same, and it would look to and
    fro for ever.

    Attributes:
        file: The network's.
        sha256: Of the file, found when it is read: two files are two agents.

    Raises:
        ConfigError: If onnxruntime is not installed.
        CheckpointError: If the file cannot be read or holds no such network.
    """

    file: str
    sha256: str = ""
    _network: Network = field(init=False, repr=False)
    _view: EgocentricView | None = field(default=None, init=False, repr=False)
    _metric_view: MetricView | None = field(default=None, init=False, repr=False)
    _memory: dict[str, NDArray[np.float32]] = field(default_factory=dict, init=False, repr=False)
    _taken: dict[bytes, set[int]] = field(default_factory=dict, init=False, repr=False)
    _turns: int = field(default=0, init=False, repr=False)

    def __post_init__(self) -> None:
        content = _read(Path(self.file))
        digest = hashlib.sha256(content).hexdigest()
        if self.sha256 not in ("", digest):
            raise CheckpointError(f"{self.file}: its sha256 is not {self.sha256}")
        self.sha256 = digest
        self._network = Network(content, self.file)

    def reset(self, rng: np.random.Generator) -> None:
        """See :class:`Agent`; nothing here is left to chance."""
        self._memory = self._network.memory()
        self._view, self._metric_view = None, None
        self._taken, self._turns = {}, 0

    def act(self, observation: Mapping[str, Any], knowledge: AnyKnowledge) -> Any:
        """See :class:`Agent`.

        Raises:
            ConfigError: If the network was trained for another observation or other actions.
        """
        observed = self._observed(self._drawn(observation, knowledge))
        logits, *memory = self._network.run({**observed, **self._memory})
        self._memory = dict(zip(MEMORY, memory, strict=False))
        space = knowledge.actions.space
        if logits.shape[1] != getattr(space, "n", None):
            raise ConfigError(f"{self.file}: knows {logits.shape[1]} actions; there are {space}")
        if memory:
            return int(logits[0].argmax())
        if isinstance(knowledge, MazeKnowledge):
            return self._next_best(observed, logits[0])
        return self._without_turning_back(logits[0], knowledge.actions.turn)

    def _next_best(
        self, observed: Mapping[str, NDArray[np.float32]], logits: NDArray[np.float32]
    ) -> int:
        """The highest-ranked action that has not been taken at this observation."""
        key = hashlib.sha256(b"".join(part.tobytes() for part in observed.values())).digest()
        taken = self._taken.setdefault(key, set())
        if len(taken) == len(logits):
            taken.clear()
        ranked = np.argsort(-logits, kind="stable")
        action = next(int(a) for a in ranked if int(a) not in taken)
        taken.add(action)
        return action

    def _without_turning_back(self, logits: NDArray[np.float32], turn: float) -> int:
        """The highest-ranked action that neither turns back nor goes on after a full circle."""
        allowed = logits.copy()
        if self._turns:
            allowed[LEFT if self._turns < 0 else RIGHT] = -np.inf
        if abs(self._turns) * turn >= 2.0 * np.pi - 1e-9:
            allowed[[LEFT, RIGHT]] = -np.inf
        action = int(allowed.argmax())
        if action in (LEFT, RIGHT):
            self._turns += 1 if action == LEFT else -1
        else:
            self._turns = 0
        return action

    def _drawn(self, observation: Mapping[str, Any], knowledge: AnyKnowledge) -> Mapping[str, Any]:
        """The observation, with the egocentric view that was left out of it for its cost."""
        shape = self._network.inputs.get("view")
        if shape is None or "view" in observation:
            return observation
        radius = ((shape[-1] or 1) - 1) // 2
        if not isinstance(knowledge, MazeKnowledge):
            if self._metric_view is None:
                self._metric_view = MetricView(knowledge.belief, knowledge.sensor, radius)
            return {**observation, **self._metric_view.draw(knowledge.robot)}
        if self._view is None:
            self._view = EgocentricView(knowledge.belief, radius)
            self._view.place(np.arange(knowledge.lattice.n_robots))
        return {**observation, "view": self._view.draw()[int(knowledge.robots[0])]}

    def _observed(self, observation: Mapping[str, Any]) -> dict[str, NDArray[np.float32]]:
        """The observation as a batch of one, its shapes checked."""
        inputs = {}
        for name, shape in self._network.inputs.items():
            if name in MEMORY:
                continue
            if name not in observation:
                known = ", ".join(observation)
                raise ConfigError(f"{self.file}: needs {name!r} observed; there are {known}")
            part = np.asarray(observation[name], dtype=np.float32)[None]
            if list(part.shape[1:]) != shape[1:]:
                raise ConfigError(
                    f"{self.file}: was trained for {name} of {shape[1:]}; "
                    f"here it is {list(part.shape[1:])}"
                )
            inputs[name] = part
        return inputs


def packaged_policy(name: str, env: str | None) -> Path:
    """File of the policy that comes with the package for an environment.

    Args:
        name: ``ppo``.
        env: Registered id.

    Raises:
        ConfigError: If there is none.
    """
    folder = Path(str(resources.files("activeloc.agents") / "policies"))
    files = {path.stem: path for path in sorted(folder.glob(f"*.{name}.onnx"))}
    known = ", ".join(stem.removesuffix(f".{name}") for stem in files) or "none yet"
    stem = f"{(env or '').removeprefix('activeloc/')}.{name}"
    if stem not in files:
        raise ConfigError(
            f"agent {name}: no trained policy comes with the package for {env} (there are: "
            f"{known}); train one with train.py, export it, and name it as {PREFIX}FILE"
        )
    return files[stem]


def _read(path: Path) -> bytes:
    try:
        if not path.is_file():
            raise CheckpointError(f"{path}: there is no such file")
        if path.stat().st_size > LARGEST:
            raise CheckpointError(f"{path}: is larger than {LARGEST} bytes")
        return path.read_bytes()
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror}") from None
