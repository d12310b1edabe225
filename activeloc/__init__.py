"""Active localization as a Gymnasium environment.

A robot has a map and a range finder and does not know where it is. A Bayes filter keeps its belief,
which is the observation; an agent chooses the motions that make the belief collapse on the truth.

>>> import activeloc
>>> import gymnasium as gym
>>> env = gym.make("activeloc/GlobalLocalization-v0")
"""

from activeloc.envs import register as _register

__version__ = "0.1.0"

_register()
