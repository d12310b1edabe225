"""What a network makes of an observation: features extractors, chosen by its keys.

SB3's own extractor flattens everything that is no image of bytes, belief grids too. Two views of
the belief need two readers: the *egocentric* one is small and always turned the same way, so that
a multi-layer perceptron reads it; the *world* one keeps its rows and columns, so that a convolution
does.
"""

from __future__ import annotations

from collections.abc import Sequence

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from activeloc import checks
from activeloc.errors import ConfigError

EGOCENTRIC = "view"
"""The key whose presence says that there is an egocentric view."""
SEEN_FROM_THE_ROBOT = (EGOCENTRIC, "ways")
"""Keys of all that is turned with the robot, and more than a vector."""

READERS = ("auto", "egocentric", "world")


def keys_for(space: gym.spaces.Dict, reader: str = "auto") -> list[str]:
    """The keys of the observation that a reader uses, in the space's order.

    Args:
        space: Of one robot's observation.
        reader: ``egocentric``: the view and all vectors; ``world``: all but the view; ``auto``:
            egocentric where there is a view.

    Raises:
        ConfigError: If the reader is unknown or there is no view to read.
    """
    checks.choice("reader", reader, READERS)
    if reader == "auto":
        reader = "egocentric" if EGOCENTRIC in space.spaces else "world"
    if reader == "world":
        return [key for key in space.spaces if key not in SEEN_FROM_THE_ROBOT]
    if EGOCENTRIC not in space.spaces:
        raise ConfigError(f"there is no key {EGOCENTRIC!r} to read (only {', '.join(space)})")
    return [
        key for key, part in space.items() if key in SEEN_FROM_THE_ROBOT or _rank(key, part) <= 1
    ]


def extractor_for(space: gym.spaces.Dict) -> type[EgocentricFeatures | WorldFeatures]:
    """The extractor that reads these keys."""
    return EgocentricFeatures if EGOCENTRIC in space.spaces else WorldFeatures


class EgocentricFeatures(BaseFeaturesExtractor):
    """A multi-layer perceptron on the flattened ``view``, the ``ways`` if any, and the vectors.

    Args:
        observation_space: ``view`` ``(C, h, w)``, ``ways`` ``(C, bearings, distances)``, vectors.
        hidden: Widths of the layers; the last is the number of features.

    Raises:
        ConfigError: If a part is of no known shape.
    """

    def __init__(
        self, observation_space: gym.spaces.Dict, hidden: Sequence[int] = (192, 192)
    ) -> None:
        super().__init__(observation_space, hidden[-1])
        self.keys = list(observation_space.spaces)
        width = sum(_size(key, part) for key, part in observation_space.items())
        self.mlp = _mlp(width, hidden)

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Features ``(N, hidden[-1])``."""
        flat = [torch.flatten(observations[key], 1) for key in self.keys]
        return self.mlp(torch.cat(flat, dim=1))


class WorldFeatures(BaseFeaturesExtractor):
    """A small convolutional network on belief and map, with the vectors joined behind it.

    Every stack of planes ``(C, rows, cols)`` and every plane ``(rows, cols)`` of one resolution
    goes in beside the others. The first convolution is at full resolution.

    Args:
        observation_space: ``belief`` ``(headings, rows, cols)``, ``map`` ``(rows, cols)``, vectors.
        channels: Of the convolutions; each but the first halves rows and columns.
        hidden: Widths of the layers behind; the last is the number of features.

    Raises:
        ConfigError: If there is no plane, planes differ in resolution, or a part is of no known
            shape.
    """

    def __init__(
        self,
        observation_space: gym.spaces.Dict,
        hidden: Sequence[int] = (128, 128),
        channels: Sequence[int] = (32, 32, 32),
    ) -> None:
        super().__init__(observation_space, hidden[-1])
        ranks = {key: _rank(key, part) for key, part in observation_space.items()}
        self.planes = [key for key, rank in ranks.items() if rank >= 2]
        self.vectors = [key for key, rank in ranks.items() if rank <= 1]
        shapes = [_planes(observation_space[key]) for key in self.planes]
        if len({shape[1:] for shape in shapes}) != 1:
            raise ConfigError(f"the planes must have one resolution; got {shapes}")
        layers: list[nn.Module] = []
        width = sum(shape[0] for shape in shapes)
        for layer, n_channels in enumerate(channels):
            layers += [nn.Conv2d(width, n_channels, 3, 1 if layer == 0 else 2, 1), nn.ReLU()]
            width = n_channels
        self.convolutions = nn.Sequential(*layers, nn.Flatten())
        with torch.no_grad():
            n_planes = sum(shape[0] for shape in shapes)
            flat = self.convolutions(torch.zeros(1, n_planes, *shapes[0][1:])).shape[1]
        n_scalars = sum(_size(key, observation_space[key]) for key in self.vectors)
        self.mlp = _mlp(flat + n_scalars, hidden)

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Features ``(N, hidden[-1])``."""
        planes = [observations[key] for key in self.planes]
        stacked = torch.cat([p if p.dim() == 4 else p.unsqueeze(1) for p in planes], dim=1)
        vectors = [torch.flatten(observations[key], 1) for key in self.vectors]
        return self.mlp(torch.cat([self.convolutions(stacked), *vectors], dim=1))


def _mlp(width: int, hidden: Sequence[int]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for n_units in hidden:
        layers += [nn.Linear(width, n_units), nn.ReLU()]
        width = n_units
    return nn.Sequential(*layers)


def _rank(key: str, space: gym.Space[object]) -> int:
    """Number of axes of a part of the observation: 0 to 3.

    Raises:
        ConfigError: If it is no Box, or has more.
    """
    if not isinstance(space, gym.spaces.Box) or len(space.shape) > 3:
        raise ConfigError(f"observation {key!r} must be a Box of at most 3 axes; got {space}")
    return len(space.shape)


def _size(key: str, space: gym.Space[object]) -> int:
    _rank(key, space)
    size = 1
    for length in space.shape or ():
        size *= length
    return size


def _planes(space: gym.Space[object]) -> tuple[int, ...]:
    shape = space.shape or ()
    return shape if len(shape) == 3 else (1, *shape)
