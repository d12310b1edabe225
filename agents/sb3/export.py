"""A trained policy as one ONNX file, which runs where there is no torch.

Inputs are the observation's keys, each ``(N, ...)`` of float32 as the environment gives it: what
the network does to them first is in the graph. The output ``logits`` ``(N, A)`` ranks the actions
(Q-values for DQN). A policy with a memory also takes and gives ``memory_h`` and ``memory_c``
``(layers, N, width)``, zeros at the start of an episode.
"""

from __future__ import annotations

import logging
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.dqn.policies import DQNPolicy
from torch import Tensor, nn

from activeloc.agents.onnx_policy import MEMORY, Network
from activeloc.agents.sb3.checkpoint import find_checkpoint
from activeloc.agents.sb3.training import load_policy
from activeloc.errors import CheckpointError
from activeloc.files import write_atomically

TOLERANCE = 1e-5
OBSERVED = "observed_"
"""Before an input's name while the graph is made, where torch calls values after its functions."""


class Logits(nn.Module):
    """From observations, in the space's order of keys, to what ranks the actions."""

    def __init__(self, policy: ActorCriticPolicy | DQNPolicy, keys: list[str]) -> None:
        super().__init__()
        self.policy, self.keys = policy, keys

    def forward(self, *given: Tensor) -> Any:
        """Logits ``(N, A)``; behind them the memory, for a policy that has one."""
        observations = dict(zip(self.keys, given, strict=False))
        policy = self.policy
        if isinstance(policy, DQNPolicy):
            return policy.q_net.q_net(policy.q_net.features_extractor(observations))
        features = policy.features_extractor(observations)
        if not isinstance(policy, RecurrentActorCriticPolicy):
            return policy.action_net(policy.mlp_extractor.forward_actor(features))
        out, memory = policy.lstm_actor(features.unsqueeze(0), given[len(self.keys) :])
        return policy.action_net(policy.mlp_extractor.forward_actor(out.squeeze(0))), *memory


def export_checkpoint(path: Path, out: Path) -> int:
    """Write the policy of a checkpoint, or of a run's best one, as ONNX.

    Args:
        path: Of a checkpoint or a run.
        out: File to write.

    Returns:
        Its size [byte].

    Raises:
        ActiveLocError: If the checkpoint is refused.
        OSError: If the file cannot be written.
    """
    _, model = load_policy(find_checkpoint(path))
    content = onnx_of(model)
    write_atomically(out, content)
    return len(content)


def onnx_of(model: BaseAlgorithm) -> bytes:
    """The policy as ONNX, found equal to torch's on random observations.

    Raises:
        CheckpointError: If the two differ by more than 1e-5.
    """
    space = model.observation_space
    assert isinstance(space, gym.spaces.Dict)
    policy = model.policy
    assert isinstance(policy, ActorCriticPolicy | DQNPolicy)
    policy.set_training_mode(False)
    module = Logits(policy, list(space.spaces)).eval()
    example = _example(module, space, 3, np.random.default_rng(0))
    names = [*example]
    outputs = ["logits", *(f"next_{name}" for name in names if name in MEMORY)]
    axes = tuple({1 if name in MEMORY else 0: "batch"} for name in names)
    log = logging.getLogger("torch.onnx")
    level = log.level
    log.setLevel(logging.ERROR)  # It says what else could be installed.
    try:
        with warnings.catch_warnings(), torch.no_grad():
            warnings.simplefilter("ignore")  # Deprecations inside torch.
            program = torch.onnx.export(
                module,
                tuple(torch.as_tensor(array) for array in example.values()),
                input_names=[f"{OBSERVED}{name}" for name in names],
                output_names=outputs,
                dynamic_shapes=(axes,),
                dynamo=True,
                verbose=False,
            )
    finally:
        log.setLevel(level)
    assert program is not None
    network = _bare(program.model_proto)
    _name_inputs(network.graph, names)
    content = network.SerializeToString()
    check_equal(module, content, space)
    return content


def _bare(network: Any) -> Any:
    """The network without notes on where in the source each node comes from."""
    graph = network.graph
    for part in (network, graph, *network.functions):
        del part.metadata_props[:]
        part.doc_string = ""
    nodes = [*graph.node, *(node for function in network.functions for node in function.node)]
    for part in (*nodes, *graph.value_info, *graph.input, *graph.output, *graph.initializer):
        del part.metadata_props[:]
        part.doc_string = ""
    return network


def _name_inputs(graph: Any, names: list[str]) -> None:
    """Give the inputs their own names; values that happen to bear one get another."""
    new = {name: f"{name}_inside" for name in names}
    new |= {f"{OBSERVED}{name}": name for name in names}
    for node in graph.node:
        node.input[:] = [new.get(name, name) for name in node.input]
        node.output[:] = [new.get(name, name) for name in node.output]
    for part in (*graph.input, *graph.value_info, *graph.initializer):
        part.name = new.get(part.name, part.name)


def _example(
    module: Logits, space: gym.spaces.Dict, n: int, rng: np.random.Generator
) -> dict[str, np.ndarray[Any, Any]]:
    """Inputs of ``n`` random observations."""
    example = {
        key: rng.uniform(0.0, 1.0, (n, *(part.shape or ()))).astype(np.float32)
        for key, part in space.items()
    }
    if isinstance(module.policy, RecurrentActorCriticPolicy):
        lstm = module.policy.lstm_actor
        for name in MEMORY:
            shape = (lstm.num_layers, n, lstm.hidden_size)
            example[name] = rng.standard_normal(shape).astype(np.float32)
    return example


def check_equal(module: Logits, content: bytes, space: gym.spaces.Dict) -> None:
    """Refuse a network whose logits are not torch's.

    Raises:
        CheckpointError: If they differ by more than 1e-5 of the largest, or of one.
    """
    network = Network(content)
    for n, seed in ((1, 1), (7, 2)):
        example = _example(module, space, n, np.random.default_rng(seed))
        with torch.no_grad():
            torchs = module(*(torch.as_tensor(array) for array in example.values()))
        logits = torchs[0] if isinstance(torchs, tuple) else torchs
        scale = max(1.0, float(np.abs(logits.numpy()).max()))
        worst = float(np.abs(network.run(example)[0] - logits.numpy()).max()) / scale
        if not worst <= TOLERANCE:
            raise CheckpointError(f"the exported network differs from torch's by {worst:g}")
