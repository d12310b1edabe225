"""Features extractors read what the observation holds, whatever its shape."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from activeloc.agents.sb3.features import (
    EgocentricFeatures,
    WorldFeatures,
    extractor_for,
    keys_for,
)
from activeloc.errors import ConfigError


def box(*shape):
    return gym.spaces.Box(0.0, 1.0, shape, np.float32)


METRIC = gym.spaces.Dict({"belief": box(8, 12, 20), "map": box(12, 20), "scan": box(3)})
MAZE = gym.spaces.Dict(
    {"view": box(5, 7, 7), "belief": box(4, 9, 9), "map": box(9, 9), "time": box(1)}
)


def batch(space, n, seed=0):
    rng = np.random.default_rng(seed)
    return {
        key: torch.as_tensor(rng.random((n, *part.shape), dtype=np.float32))
        for key, part in space.items()
    }


@pytest.mark.parametrize(
    ("space", "reader", "extractor", "keys"),
    [
        (METRIC, "auto", WorldFeatures, {"belief", "map", "scan"}),
        (MAZE, "auto", EgocentricFeatures, {"view", "time"}),
        (MAZE, "world", WorldFeatures, {"belief", "map", "time"}),
    ],
)
def test_the_keys_choose_the_extractor(space, reader, extractor, keys):
    chosen = keys_for(space, reader)
    assert set(chosen) == keys
    cut = gym.spaces.Dict({key: space[key] for key in chosen})
    assert extractor_for(cut) is extractor
    features = extractor(cut, hidden=(24, 10))(batch(cut, 6))
    assert features.shape == (6, 10)


@pytest.mark.parametrize("space", [METRIC, gym.spaces.Dict({"view": box(5, 7, 7), "t": box(2)})])
def test_every_key_and_every_pixel_counts(space):
    torch.manual_seed(0)
    extractor = extractor_for(space)(space, hidden=(32, 16))
    given = {key: tensor.requires_grad_() for key, tensor in batch(space, 3).items()}
    extractor(given).square().sum().backward()
    for key, tensor in given.items():
        assert tensor.grad is not None
        assert (tensor.grad != 0.0).float().mean() > 0.9, key


def test_the_first_convolution_is_at_full_resolution():
    first = WorldFeatures(METRIC).convolutions[0]
    out = first(torch.zeros(1, 9, 12, 20))
    assert out.shape[2:] == (12, 20)


def test_refusals():
    with pytest.raises(ConfigError, match="no key 'view'"):
        keys_for(METRIC, "egocentric")
    with pytest.raises(ConfigError, match="reader"):
        keys_for(METRIC, "polar")
    with pytest.raises(ConfigError, match="one resolution"):
        WorldFeatures(gym.spaces.Dict({"belief": box(4, 9, 9), "map": box(8, 9)}))
    with pytest.raises(ConfigError, match="must be a Box"):
        keys_for(gym.spaces.Dict({"view": box(5, 7, 7), "a": gym.spaces.Discrete(3)}))
