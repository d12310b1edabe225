"""A planner on a ROS map: ``python examples/greedy_on_your_map.py [building.yaml]``.

The greedy agent takes the action after which a scan is expected to say most. Without a map of your
own (a map_server YAML file), a small home is generated and written as one, ``home.yaml`` and
``home.pgm`` in the current folder. Printed are the map's size, each action of the robot with the
entropy left after it, and how the episode ended.
"""

import sys
from pathlib import Path

import gymnasium as gym
import numpy as np

import activeloc  # noqa: F401  registers the environments
from activeloc.agents import make_agent
from activeloc.maps import MapSource, load_map, save_ros


def small_home(path: Path) -> Path:
    """Generate a home and write it as a map_server map."""
    save_ros(MapSource.parse("rooms(width=8,height=6)").number(0), path)
    return path


def main(map_file: Path | None = None, seed: int = 1, steps: int = 100) -> bool:
    """Play one episode; whether the robot found itself."""
    path = small_home(Path("home.yaml")) if map_file is None else map_file
    left, right, bottom, top = load_map(path).extent
    print(f"{path}: {right - left:.1f} x {top - bottom:.1f} m")

    env = gym.make("activeloc/GlobalLocalization-v0", map=str(path), max_episode_steps=steps)
    agent = make_agent("greedy")
    agent.reset(np.random.default_rng(seed))
    observation, info = env.reset(seed=seed)
    over = False
    while not over:
        # The belief, the models and the last scan: all that the robot knows, and not the truth.
        action = agent.act(observation, env.unwrapped.knowledge)
        observation, _, terminated, truncated, info = env.step(action)
        words = env.unwrapped.config.actions.words(action)
        print(f"{words:18s} entropy {info['entropy']:.2f} nat")
        over = terminated or truncated
    print(f"right: {info['is_success']}; the estimate is {info['error_m']:.2f} m off")
    return bool(info["is_success"])


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:2]))
