"""Make an environment, step it, look at what comes back: ``python examples/make_and_step.py``.

A robot stands somewhere in a small home and acts at random. Printed are the spaces, then, for every
fifth step, what the belief says: its entropy, the share of it near its estimate, and how far the
estimate is from the truth (which the agent is never told). The last line says how it ended.
"""

import gymnasium as gym

import activeloc  # noqa: F401  registers the environments


def main(map: str = "rooms(width=8,height=6):0", seed: int = 0, steps: int = 60) -> dict:
    """Play one episode; returns the last info."""
    env = gym.make("activeloc/GlobalLocalization-v0", map=map, max_episode_steps=steps)
    print(f"actions: {env.action_space} (turn left, turn right, drive forward)")
    for name, space in env.observation_space.items():
        print(f"observation {name!r}: {space.shape} of {space.dtype}")

    env.action_space.seed(seed)
    observation, info = env.reset(seed=seed)
    step, over = 0, False
    while not over:
        if step % 5 == 0:
            print(
                f"step {step:3d}: entropy {info['entropy']:.2f} nat, {info['mass']:4.0%} near the "
                f"estimate, which is {info['error_m']:.2f} m off"
            )
        action = env.action_space.sample()
        observation, reward, terminated, truncated, info = env.step(action)
        step, over = step + 1, terminated or truncated

    end = "wrong and sure" if info["wrong"] else "not sure by the limit"
    print(f"after {step} steps: {'localized' if info['is_success'] else end}")
    return info


if __name__ == "__main__":
    main()
