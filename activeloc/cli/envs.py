"""``activeloc envs``: what can be made."""

from __future__ import annotations

HELP = "List the environments: id, task, spaces, steps."


def envs() -> None:
    """Print a row for each registered id."""
    import gymnasium as gym
    from rich.console import Console
    from rich.table import Table

    from activeloc.envs import ENVIRONMENTS

    table = Table(box=None, pad_edge=False)
    for title in ("id", "task", "actions", "observation", "steps"):
        table.add_column(title, no_wrap=True)
    for name in ENVIRONMENTS:
        env = gym.make(name, disable_env_checker=True)
        space = env.observation_space
        assert isinstance(space, gym.spaces.Dict)
        parts = "\n".join(
            f"{key} {'x'.join(map(str, part.shape or ()))}" for key, part in space.spaces.items()
        )
        steps = env.spec.max_episode_steps if env.spec is not None else None
        task = str(getattr(env.unwrapped, "config").task.kind)  # noqa: B009
        table.add_row(name, task, str(env.action_space), parts, str(steps))
    Console(highlight=False).print(table)
