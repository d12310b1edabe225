"""``--set``, ``--agents``, ``--env`` and ``--map``: from what was typed to a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from activeloc.errors import ConfigError

if TYPE_CHECKING:
    from activeloc.agents.evaluation import Sweep

NAMESPACE = "activeloc/"
METRIC_AGENTS = "random,spin,greedy,active"
MAZE_AGENTS = "random,greedy"

Env = Annotated[
    str, typer.Option("--env", help="Registered id; see `activeloc envs`.", metavar="ID")
]
_MAP = typer.Option(
    "--map",
    help="A generator (office, rooms, cave, maze), office:7 for building 7, office:0-3 for "
    "four in turn, office:* for a new one each episode, or a map file.",
    metavar="SPEC",
)
Map = Annotated[str, _MAP]
MapIfGiven = Annotated[str | None, _MAP]
Belief = Annotated[str, typer.Option("--belief", help="histogram or particles.", metavar="KIND")]
Seed = Annotated[
    int, typer.Option("--seed", help="All chance follows from it, 0 to 2^63 - 1.", metavar="S")
]
Episode = Annotated[int, typer.Option("--episode", help="Which episode of the seed.", metavar="I")]
Steps = Annotated[
    int | None,
    typer.Option("--steps", help="Limit of an episode [steps]; the id's own if not given."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="A setting, as often as needed: sensor.z_max=1.0, world=discrete, "
        "belief.cell_size=0.1, agent.greedy.samples=400.",
        metavar="KEY=VALUE",
    ),
]


def make_sweep(
    env: str,
    map_spec: str | None,
    belief: str,
    agents: Sequence[str],
    settings: Sequence[str],
    seed: int,
    steps: int | None,
    episodes: int = 1,
    maps: str = "office",
) -> Sweep:
    """A sweep from the options of a subcommand.

    Where no map is given, the id's own is taken, or ``maps``.

    Raises:
        ActiveLocError: If one of them is refused.
    """
    from activeloc.agents import check_name
    from activeloc.agents.evaluation import Sweep
    from activeloc.configuration import unknown
    from activeloc.envs import ENVIRONMENTS, MAX_EPISODE_STEPS, STEPS
    from activeloc.maps import MapSource

    name = env if env.startswith(NAMESPACE) else NAMESPACE + env
    if name not in ENVIRONMENTS:
        raise unknown("--env", env, ENVIRONMENTS)
    for agent in agents:
        check_name(agent)
    tree = parse_settings(settings)
    given = _agent_settings(tree.pop("agent", {}), agents)
    base = {**ENVIRONMENTS[name], "belief": belief}
    base.pop("map", None)
    return Sweep(
        env=name,
        map=MapSource.parse(ENVIRONMENTS[name].get("map", maps) if map_spec is None else map_spec),
        agents={agent: given.get(agent, {}) for agent in agents},
        settings=_merged(base, tree),
        episodes=episodes,
        seed=seed,
        limit=STEPS.get(name, MAX_EPISODE_STEPS) if steps is None else steps,
    )


def default_agents(env: str) -> str:
    """Names of the agents that play where none are given."""
    from activeloc.envs import ENVIRONMENTS

    task = ENVIRONMENTS.get(NAMESPACE + env.removeprefix(NAMESPACE), {}).get("task")
    kind = task["kind"] if isinstance(task, Mapping) else task
    return MAZE_AGENTS if kind == "maze" else METRIC_AGENTS


def split_agents(text: str) -> list[str]:
    """Names from a comma list.

    Raises:
        ConfigError: If one is empty or comes twice.
    """
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if not name:
            raise ConfigError(f"--agents: an empty name in {text!r}; expected NAME,NAME,...")
        if names.count(name) > 1:
            raise ConfigError(f"--agents: {name} is given twice")
    return names


def parse_settings(items: Sequence[str]) -> dict[str, Any]:
    """Nested settings from ``key.sub=value`` items; a value is a YAML scalar or a list of them.

    Raises:
        ConfigError: If an item has no key or no value, or a key is given twice.
    """
    tree: dict[str, Any] = {}
    for item in items:
        key, equals, text = item.partition("=")
        path = [part.strip() for part in key.split(".")]
        if not equals or not all(path) or not text.strip():
            raise ConfigError(f"--set {item!r}: expected KEY=VALUE, such as sensor.z_max=1.0")
        if path[0] == "map" or path in (["belief"], ["env"], ["seed"], ["steps"]):
            raise ConfigError(f"--set {item!r}: use --{path[0]}")
        node = tree
        for part in path[:-1]:
            node = node.setdefault(part, {})
            if not isinstance(node, dict):
                raise ConfigError(f"--set {item!r}: {part} has been given a value already")
        if path[-1] in node:
            raise ConfigError(f"--set {item!r}: {key.strip()} is given twice")
        node[path[-1]] = _value(item, text)
    return tree


def _value(item: str, text: str) -> Any:
    """A YAML scalar or list; numbers that YAML takes for words (1e-3, inf) are numbers."""
    import yaml

    try:
        value = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError):
        raise ConfigError(f"--set {item!r}: {text!r} is not a YAML value") from None
    values = value if isinstance(value, list) else [value]
    if any(isinstance(one, Mapping | list | set) for one in values):
        raise ConfigError(f"--set {item!r}: a value is a scalar or a list; use dotted names")
    return [_number(one) for one in value] if isinstance(value, list) else _number(value)


def _number(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        return float(value)
    except ValueError:
        return value


def _merged(base: Mapping[str, Any], tree: Mapping[str, Any]) -> dict[str, Any]:
    """Settings laid over others: beside fields, a bare word is the kind of the thing."""
    merged = dict(base)
    for name, value in tree.items():
        if not isinstance(value, dict):
            merged[name] = value
            continue
        old = base.get(name)
        fields = old if isinstance(old, Mapping) else {} if old is None else {"kind": old}
        merged[name] = {**fields, **value}
    return merged


def _agent_settings(tree: object, agents: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Settings by agent.

    Raises:
        ConfigError: If they are for an agent that does not play, or are none.
    """
    from activeloc.configuration import unknown

    if not isinstance(tree, dict):
        raise ConfigError("--set agent: expected agent.NAME.SETTING=VALUE")
    for name, settings in tree.items():
        if name not in agents:
            raise unknown("--set agent", name, agents)
        if not isinstance(settings, dict):
            raise ConfigError(f"--set agent.{name}: expected agent.{name}.SETTING=VALUE")
    return tree
