"""Train PPO on the native vector environment: ``python examples/train_ppo.py``.

Stable-Baselines3 learns on 32 small mazes at once, from the egocentric view (what may lie around
the robot, whatever the maze's size); it is installed by ``pip install -c constraints.txt -e
".[train]"``. Printed is the share of mazes in which the policy is certain of the right place at the
end, before and after training (some ten seconds). ``train.py`` does the same with checkpoints,
evaluation while it trains, and imitation of a planner.
"""

import numpy as np
from stable_baselines3 import PPO

import activeloc  # noqa: F401  registers the environments
from activeloc.agents.sb3.vec_env import NativeVecEnv, make_vec_env

SETTINGS = {
    "observation": {"view": True, "radius": 5, "time": False},
    # The largest probability less 1 at each step, until the belief is certain.
    "task": {"kind": "maze", "reward": "doubt"},
}


def share_right(model: PPO, env: NativeVecEnv, seed: int) -> float:
    """Share of the robots whose first episode ends right."""
    env.seed(seed)
    observations = env.reset()
    right: dict[int, bool] = {}
    while len(right) < env.num_envs:
        actions, _ = model.predict(observations)
        observations, _, dones, infos = env.step(actions)
        for robot in np.flatnonzero(dones):
            right.setdefault(int(robot), bool(infos[robot]["is_success"]))
    return float(np.mean(list(right.values())))


def main(steps: int = 16_000, mazes: int = 200, seed: int = 0) -> tuple[float, float]:
    """Train; returns the shares right before and after."""
    held_out = make_vec_env("activeloc/Maze7-v0", mazes, SETTINGS, keys=["view"])
    env = make_vec_env("activeloc/Maze7-v0", 32, SETTINGS, keys=["view"])
    model = PPO("MultiInputPolicy", env, n_steps=32, batch_size=256, n_epochs=4,
                learning_rate=1e-3, ent_coef=0.01, seed=seed)  # fmt: skip
    before = share_right(model, held_out, seed=1)
    print(f"before: right in {before:.2f} of {mazes} mazes")
    model.learn(steps)
    after = share_right(model, held_out, seed=1)
    print(f"after {model.num_timesteps} steps: right in {after:.2f}")
    return before, after


if __name__ == "__main__":
    main()
