"""Write ``docs/environments.md`` and its pictures: ``python docs/site/environments.py``.

Everything on that page follows from the table of ids, the spaces and the settings' own docstrings,
so it cannot say what the code does not. ``--text`` leaves the pictures as they are.
"""

from __future__ import annotations

import inspect
import re
import sys
from dataclasses import MISSING, Field, fields, is_dataclass
from math import isclose, pi
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

from activeloc.envs import ENVIRONMENTS, MAX_EPISODE_STEPS, STEPS
from activeloc.envs.worlds import configure

DOCS = Path(__file__).resolve().parents[1]

#: What each id asks of the robot, and the steps after which its picture is taken.
PROBLEMS = {
    "GlobalLocalization-v0": ("The belief starts uniform: where am I?", 6),
    "KidnappedRobot-v0": ("It starts right; then the robot is carried off and not told.", 24),
    "PositionTracking-v0": ("It starts right and must stay so.", 12),
    "Maze7-v0": ("A maze of 7 x 7 cells, the belief exact.", 3),
    "Maze15-v0": ("A maze of 15 x 15 cells.", 3),
    "Maze21-v0": ("A maze of 21 x 21 cells.", 3),
    "NoisyMaze9-v0": ("A maze of 9 x 9 cells; steps and readings are off by one at times.", 6),
}
MEANINGS = {
    "belief": "by heading, row and column; sqrt(p / max p), in mazes p / max p",
    "map": "share of free ground; row 0 is the south",
    "scan": "ranges over the longest, right to left; -1: no reading",
    "scalars": "entropy over the uniform's, mass near the estimate, touched, turned [half turns], "
    "travelled [m]",
    "depth": "cells to the wall ahead / 19",
    "time": "steps taken / 100",
    "view": "what may be around the robot: free, and what a reading would tell, in four directions",
    "ways": "straight ways in 12 bearings: open, and what a scan at their ends would tell",
    "place": "what was read and touched where the robot stands",
}
METRIC = configure({})
MAZE = configure(ENVIRONMENTS["activeloc/Maze7-v0"])
#: Title of each table of settings, and an object with these settings.
SETTINGS: dict[str, Any] = {
    "task": METRIC.task,
    'belief, `belief="histogram"`': METRIC.belief,
    'belief, `belief="particles"`': configure({"belief": "particles"}).belief,
    'sensor, `sensor="beam"`': METRIC.sensor,
    'sensor, `sensor="field"`': configure({"sensor": "field"}).sensor,
    'sensor, `sensor="proximity"`': configure({"sensor": "proximity"}).sensor,
    'sensor, `sensor="sonar"`, besides': configure({"sensor": "sonar"}).sensor,
    "motion": METRIC.motion,
    "motion.actuation, motion.odometry, standard deviations": METRIC.motion.odometry,
    "actions": METRIC.actions,
    "reward": METRIC.reward,
    "observation": METRIC.observation,
    "task, in mazes": MAZE.task,
    "observation, in mazes": MAZE.observation,
}


def prose(text: str) -> str:
    """A docstring's words in one line of Markdown."""
    text = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", " ".join(text.split()))
    return text.replace("``", "`").replace("|", "\\|")


def meanings(cls: type[Any], section: str = "Attributes") -> dict[str, str]:
    """What a class's docstring says of each of its fields, those of its bases included."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        text = inspect.cleandoc(base.__doc__ or "")
        part = re.search(rf"(?ms)^{section}:\n(.*?)(?=^\S|\Z)", text)
        for name, words in re.findall(
            r"(?ms)^    (\w+): (.*?)(?=^    \w|\Z)", part[1] if part else ""
        ):
            found[name] = prose(words)
    return found


def default(item: Field[Any]) -> str:
    """A field's default, angles as degrees."""
    value = item.default_factory() if item.default_factory is not MISSING else item.default
    if is_dataclass(value):
        return "below"
    if isinstance(value, float):
        degrees = value * 180.0 / pi
        angle = value and not isclose(value, float(f"{value:.3g}"), rel_tol=1e-9)
        if angle and isclose(degrees, float(f"{degrees:.3g}"), rel_tol=1e-9):
            return f"{degrees:g}°"
        return f"{value:.3g}"
    return f"`{value}`" if isinstance(value, str) else str(value)


def settings_table(cls: type[Any]) -> str:
    """Name, default and meaning of a settings class's fields."""
    words = meanings(cls)
    known = {item.name for base in cls.__bases__ if is_dataclass(base) for item in fields(base)}
    rows = [
        f"| `{item.name}` | {default(item)} | {words[item.name]} |"
        for item in fields(cls)
        if item.init and item.name not in known
    ]
    return "\n".join(["| setting | default | |", "|---|---|---|", *rows])


def observation_table(env: gym.Env[Any, Any]) -> str:
    """Key, shape, range and meaning of the observation's parts."""
    rows = [
        f"| `{key}` | {box.shape} | {box.low.min():g} to {box.high.max():g} | {MEANINGS[key]} |"
        for key, box in env.observation_space.spaces.items()
    ]
    return "\n".join(["| observation | shape, float32 | range | |", "|---|---|---|---|", *rows])


def section(name: str) -> str:
    """What there is to say of an id."""
    env = gym.make(f"activeloc/{name}")
    _, steps = PROBLEMS[name]
    given = ENVIRONMENTS[f"activeloc/{name}"]
    limit = STEPS.get(f"activeloc/{name}", MAX_EPISODE_STEPS)
    commands = [env.unwrapped.config.actions.words(action) for action in range(env.action_space.n)]
    if "Maze" in name:
        commands = ["turn left 90 deg", "turn right 90 deg", "one cell forward"]
        reward = "the largest probability after the step"
    else:
        weights = METRIC.reward
        reward = ", ".join(
            f"`{item.name}` x {getattr(weights, item.name):g}" for item in fields(weights)
        )
    lines = [
        f"## {name}\n\n{PROBLEMS[name][0]}\n",
        f"![{name} after {steps} steps](environments/{name}.png)\n",
        f"- map: `{given.get('map', 'office')}`",
        f"- actions: `{env.action_space}`: " + ", ".join(commands),
        f"- reward: {reward}",
        f"- limit: {limit} steps\n",
    ]
    if name in ("GlobalLocalization-v0", "Maze7-v0"):
        lines.append(observation_table(env) + "\n")
    else:
        same = "Maze7-v0" if "Maze" in name else "GlobalLocalization-v0"
        shapes = {key: box.shape for key, box in env.observation_space.spaces.items()}
        sized = f", `belief` {shapes['belief']}, `map` {shapes['map']}" if "Maze" in name else ""
        lines.append(f"Observation: as [{same}](#{same.lower()}){sized}.\n")
    return "\n".join(lines)


def page() -> str:
    """The whole page."""
    from activeloc.envs.localization import LocalizationEnv

    parts = [(DOCS / "site" / "environments_head.md").read_text("utf-8")]
    parts += [section(name) for name in PROBLEMS]
    parts.append(
        "## Arguments\n\nThose of `gym.make` and `gym.make_vec`. `make_vec` takes `num_envs`, "
        "`max_episode_steps`,\n`autoreset_mode` and `threads` besides: how many threads share the "
        "work, 1 by default. Results are the same\nbits for any number.\n"
    )
    words = meanings(LocalizationEnv, "Args")
    parts.append("\n".join(["| argument | |", "|---|---|"]))
    parts[-1] += "".join(f"\n| `{name}` | {text} |" for name, text in words.items()) + "\n"
    parts.append("## Settings\n")
    for title, given in SETTINGS.items():
        parts.append(f"### {title}\n\n{settings_table(type(given))}\n")
    return "\n".join(parts)


def picture(name: str) -> None:
    """What an episode of an id looks like after some steps of its usual agent."""
    from activeloc.agents import make_agent

    env = gym.make(f"activeloc/{name}", render_mode="rgb_array")
    agent = make_agent("greedy")
    agent.reset(np.random.default_rng(0))
    observation, _ = env.reset(seed=1)
    for _ in range(PROBLEMS[name][1]):
        observation = env.step(agent.act(observation, env.unwrapped.knowledge))[0]
    drawn = Image.fromarray(env.render()).quantize(256)
    drawn.save(DOCS / "environments" / f"{name}.png", optimize=True)


def main() -> None:
    """Write the page and, unless told not to, the pictures."""
    if "--text" not in sys.argv[1:]:
        for name in PROBLEMS:
            picture(name)
    (DOCS / "environments.md").write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
