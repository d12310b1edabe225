"""The house has floors: no import runs upward, and what is heavy is imported where it is used."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import activeloc

PACKAGE = Path(activeloc.__file__).parent
ROOT = PACKAGE.parent
# From the ground: a module imports from its own floor and from those below it, never from above.
FLOORS = (
    ("errors", "checks", "files", "configuration", "free_squares", "sharing"),
    ("grid", "raycast", "tracing", "range_levels", "range_table"),
    ("maps", "motion", "sensors", "logs", "plots"),
    ("beliefs",),
    ("simulator", "replay"),
    ("calibration",),
    ("envs",),
    ("agents",),
    ("benchmarks",),
    ("cli",),
)
LEVEL = {noun: level for level, nouns in enumerate(FLOORS) for noun in nouns}
# Nothing imports these but the floor above all.
IMPORTED_BY_THE_TOP_ONLY = ("plots", "cli")
# Imported anywhere under these, at any time, because that is what they are for.
HEAVY = {
    "torch": ("agents.sb3",),
    "stable_baselines3": ("agents.sb3",),
    "sb3_contrib": ("agents.sb3",),
    "matplotlib": (),
    "pygame": (),
    "imageio_ffmpeg": (),
    "gymnasium": ("envs", "agents", "benchmarks"),
    "typer": ("cli",),
    "rich": ("cli",),
}


def names_of(folder, package):
    """Module name and path of each file under a folder, links followed."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and path.name != "__pycache__":
            yield from names_of(path, f"{package}.{path.name}")
        elif path.suffix == ".py":
            stem = "" if path.stem == "__init__" else f".{path.stem}"
            yield package + stem, path


MODULES = dict(names_of(PACKAGE, "activeloc"))
TREES = {name: ast.parse(path.read_text("utf-8")) for name, path in MODULES.items()}


def is_type_checking(node):
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def imports_of(node, module, *, lazy):
    """Names that a module's tree imports; with ``lazy`` also those imported inside functions."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            assert child.level == 0, f"{module}: relative import, line {child.lineno}"
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        elif is_type_checking(child):
            for other in child.orelse:
                yield from imports_of(other, module, lazy=lazy)
        elif lazy or not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from imports_of(child, module, lazy=lazy)


def floor_of(name):
    """The noun a name of ours stands under; None for the package itself and for others' names."""
    parts = name.split(".")
    return parts[1] if parts[0] == "activeloc" and len(parts) > 1 else None


def is_under(module, places):
    return any(f"{module}.".startswith(f"activeloc.{place}.") for place in places)


INNER = sorted(name for name in MODULES if floor_of(name) is not None)


def upward(module, tree):
    """What a module imports from floors above its own."""
    own = LEVEL[floor_of(module)]
    imported = (name for name in imports_of(tree, module, lazy=True) if floor_of(name))
    return [name for name in imported if LEVEL.get(floor_of(name), len(FLOORS)) > own]


def heavy(module, tree):
    """What a module imports that it may not, ever, or may only inside a function."""
    top = {name.split(".")[0] for name in imports_of(tree, module, lazy=False)}
    anywhere = {name.split(".")[0] for name in imports_of(tree, module, lazy=True)}
    wrong = {name for name in top & set(HEAVY) if not is_under(module, HEAVY[name])}
    if LEVEL[floor_of(module)] < LEVEL["envs"]:
        wrong |= anywhere & {"gymnasium", "torch", "stable_baselines3"}
    return sorted(wrong)


def test_every_module_stands_on_a_floor():
    unknown = {floor_of(name) for name in INNER} - set(LEVEL)
    assert not unknown, f"give them a floor: {unknown}"
    assert {"grid", "maps", "beliefs", "simulator", "envs", "agents", "cli"} <= {
        floor_of(name) for name in INNER
    }
    assert len(INNER) > 50


@pytest.mark.parametrize("module", INNER)
def test_no_import_runs_upward(module):
    assert upward(module, TREES[module]) == []


@pytest.mark.parametrize("module", INNER)
def test_heavy_packages_are_imported_where_they_are_used(module):
    assert heavy(module, TREES[module]) == []


@pytest.mark.parametrize("module", INNER)
def test_nobody_but_the_top_imports_the_top(module):
    allowed = ("cli", "plots", "agents.evaluation", "agents.sb3", "benchmarks")
    names = [name for name in imports_of(TREES[module], module, lazy=True) if floor_of(name)]
    used = {floor_of(name) for name in names} & set(IMPORTED_BY_THE_TOP_ONLY)
    if is_under(module, allowed):
        used -= {floor_of(module), "plots"}
    assert not used


def test_the_package_itself_imports_nothing_but_the_registration():
    names = set(imports_of(TREES["activeloc"], "activeloc", lazy=True))
    assert names == {"activeloc.envs.register"}


@pytest.mark.parametrize("folder", ["activeloc", "tests", "benchmarks", "examples"])
def test_the_linked_folders_have_one_name(folder):
    """``import envs`` works from the root of the checkout and nowhere else."""
    wrong = []
    paths = [path for _, path in names_of(ROOT / folder, folder)]
    for path in [*paths, *ROOT.glob("*.py")]:
        tree = ast.parse(path.read_text("utf-8"))
        names = imports_of(tree, path.name, lazy=True)
        wrong += [f"{path}: {name}" for name in names if name.split(".")[0] in ("envs", "agents")]
    assert not wrong


PLANTED = {
    "upward": ("activeloc.grid", "from activeloc.beliefs import Belief"),
    "upward, inside a function": ("activeloc.motion", "def f():\n    import activeloc.envs"),
    "upward, by one floor": ("activeloc.envs.tasks", "from activeloc.agents import make_agent"),
    "gymnasium below": ("activeloc.simulator", "def f():\n    import gymnasium as gym"),
    "torch at the top": ("activeloc.agents.greedy", "import torch.nn"),
    "matplotlib at the top": ("activeloc.plots", "from matplotlib.figure import Figure"),
}


@pytest.mark.parametrize("name", PLANTED)
def test_the_rules_find_what_breaks_them(name):
    module, code = PLANTED[name]
    tree = ast.parse(code)
    assert upward(module, tree) or heavy(module, tree)


@pytest.mark.parametrize(
    ("module", "code"),
    [
        ("activeloc.plots", "def f():\n    from matplotlib.figure import Figure"),
        ("activeloc.plots", "if TYPE_CHECKING:\n    from matplotlib.figure import Figure"),
        ("activeloc.agents.sb3.training", "import torch"),
        ("activeloc.beliefs.view", "from activeloc.grid import OccupancyGrid"),
    ],
)
def test_the_rules_leave_alone_what_keeps_them(module, code):
    tree = ast.parse(code)
    assert not upward(module, tree)
    assert not heavy(module, tree)


@pytest.mark.parametrize(
    "module", ["activeloc", "activeloc.envs.vector", "activeloc.agents", "activeloc.cli"]
)
def test_importing_it_loads_nothing_heavy(module):
    heavy_names = ("torch", "stable_baselines3", "matplotlib", "pygame", "IPython")
    code = f"import {module}, sys\nprint(*(n for n in {heavy_names} if n in sys.modules))"
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert there.stdout.split() == []


@pytest.mark.parametrize(
    ("settings", "others"),
    [
        ("belief='histogram'", ("beliefs.particles", "beliefs.monte_carlo", "envs.maze_episodes")),
        ("belief='histogram'", ("beliefs.metric_view", "maps.ros")),
        ("belief='particles'", ("beliefs.histogram", "beliefs.track", "envs.maze_episodes")),
        ("task='maze', map='maze(size=7):0'", ("beliefs.particles", "beliefs.histogram")),
    ],
)
def test_an_environment_loads_nothing_that_it_does_not_need(settings, others):
    code = (
        "import sys\nfrom activeloc.envs.localization import LocalizationEnv\n"
        f"LocalizationEnv({settings})\n"
        f"print(*(name for name in {others} if 'activeloc.' + name in sys.modules))"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert there.stdout.split() == []
