"""A robot finds itself in a generated office: ``python examples/find_yourself.py``."""

import gymnasium as gym
import numpy as np

import activeloc  # noqa: F401  registers the environments
from activeloc.agents import make_agent


def main(map: str = "office", seed: int = 4, steps: int = 150) -> bool:
    """Play one episode with active Markov localization; whether it ended right."""
    env = gym.make("activeloc/GlobalLocalization-v0", map=map, max_episode_steps=steps)
    agent = make_agent("active")
    agent.reset(np.random.default_rng(seed))
    observation, info = env.reset(seed=seed)
    over = False
    while not over:
        action = agent.act(observation, env.unwrapped.knowledge)
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    print(f"entropy {info['entropy']:.2f} nat, error {info['error_m']:.2f} m")
    return bool(info["is_success"])


if __name__ == "__main__":
    raise SystemExit(0 if main() else 1)
