"""The pages: code blocks run, commands are ones that exist, links lead somewhere.

``python`` blocks run in order, a page in one namespace, in a temporary folder. ``bash`` blocks
under ``<!-- run -->`` run too; the others, trainings and full evaluations, are parsed: the command,
its options, its files and its targets must exist. So are commands within a sentence.
"""

import ast
import importlib.util
import re
import shlex
import tomllib
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote

import pytest
import typer

from activeloc.agents import AGENTS
from activeloc.cli import app, main

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "agents" / "policies").glob("*.md")),
]
FENCE = re.compile(r"(?ms)^(<!-- run -->\n+)?^```(\w+)\n(.*?)^```$")
LINK = re.compile(r"(?:\]\(|src=\")(?!https?:|mailto:)([^)\"\s]*)")
TARGETS = set(re.findall(r"(?m)^(\w+):", (ROOT / "Makefile").read_text("utf-8")))
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
    "optional-dependencies"
]
OTHERS = ("git", "apt-get", "tensorboard")
"""Programs that are not ours."""
USAGE = typer.BadParameter.__mro__[1]
"""What Typer raises for a command line that it refuses."""


SITE = ROOT / "docs" / "site"


def script(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def named(path):
    return str(path.relative_to(ROOT))


def text_of(page):
    return page.read_text("utf-8")


def blocks(page, language):
    """Code and whether it is marked to be run, of each block in a language."""
    return [
        (code, bool(run)) for run, kind, code in FENCE.findall(text_of(page)) if kind == language
    ]


def commands(code):
    """The words of each command of a shell block."""
    lines = code.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if shlex.split(line, comments=True)]


def within_sentences(page):
    """The words of each command that stands in a sentence."""
    prose = FENCE.sub("", text_of(page))
    for code in re.findall(r"(?s)(?<!`)`([^`]+)`(?!`)", prose):
        code = " ".join(code.split())
        if re.match(r"(activeloc|make|pip|python|pytest) ", code) and "..." not in code:
            yield shlex.split(code)


def check_activeloc(words, whole):
    """Parse as the command would, and do not run it; ``whole``: nothing may be missing."""
    command = typer.main.get_command(app)
    try:
        while words and not words[0].startswith("-") and hasattr(command, "commands"):
            assert words[0] in command.commands, f"there is no {words[0]}"
            command, words = command.commands[words[0]], words[1:]
        if words != ["--help"]:
            command.make_context("activeloc", list(words))
    except USAGE as error:
        if whole or type(error).__name__ not in ("MissingParameter", "NoArgsIsHelpError"):
            raise


def check_python(words):
    """A script of ours with its arguments, or a module."""
    if words[0] == "-m":
        assert find_spec(words[1]), f"there is no module {words[1]}"
    elif words[0] == "train.py":
        script(ROOT / "train.py").parse_args(words[1:])
    else:
        assert (ROOT / words[0]).exists(), f"there is no {words[0]}"


def check(words, whole=True):
    """Whether a command is one that could be given."""
    while "=" in words[0]:
        words = words[1:]
    program, *rest = words
    if program == "activeloc":
        check_activeloc(rest, whole)
    elif program == "python":
        check_python(rest)
    elif program == "make":
        assert set(rest) <= TARGETS
    elif program == "pip":
        for extra in re.findall(r"\.\[(.*)\]", " ".join(rest)):
            assert set(extra.split(",")) <= set(EXTRAS)
    elif program == "pytest":
        assert all((ROOT / word).exists() for word in rest if word.endswith(".py"))
    else:
        assert program in OTHERS, f"what is {program}?"


@pytest.fixture(autouse=True)
def agents():
    """The table of agents, as it was afterwards: some pages enter one of their own."""
    before = dict(AGENTS)
    yield
    AGENTS.clear()
    AGENTS.update(before)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=named)
def test_python_blocks_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space = {"__name__": "__main__"}
    for code, _ in blocks(page, "python"):
        parsed = ast.parse(code)
        if "from ray" in code and find_spec("ray") is None:
            continue
        exec(compile(parsed, named(page), "exec"), space)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "bash")], ids=named)
def test_shell_blocks_are_commands(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for code, run in blocks(page, "bash"):
        for words in commands(code):
            check(words)
            if run:
                assert words[0] == "activeloc"
                assert main(words[1:]) == 0


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_commands_within_sentences_exist(page):
    for words in within_sentences(page):
        check(words, whole=False)


@pytest.mark.parametrize(
    "command",
    [
        "activeloc evalute --out out",
        "activeloc evaluate --episode 3 --out out",
        "activeloc evaluate --episodes three --out out",
        "activeloc evaluate --agents spin",
        "activeloc map inof a.yaml",
        "python train.py --env Maze7-v0 --out a --stpes 3",
        "python -m benchmarks.nothing",
        "python docs/figures/nothing.py",
        "make nothing",
        "pip install -e .[nothing]",
        "rm -rf out",
    ],
)
def test_what_is_no_command_is_noticed(command):
    with pytest.raises((AssertionError, USAGE, SystemExit, ModuleNotFoundError)):
        check(shlex.split(command))


def anchors(page):
    """Ids of a page's headings, as GitHub and the site make them."""
    prose = re.sub(r"(?ms)^```.*?^```$", "", text_of(page))
    titles = re.findall(r"(?m)^#+ (.*)$", prose)
    plain = [re.sub(r"\[([^]]*)\]\([^)]*\)|[`*]", r"\1", title) for title in titles]
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in plain}


def dead_links(page):
    for link in LINK.findall(re.sub(r"(?ms)^```.*?^```$", "", text_of(page))):
        path, _, place = unquote(link).partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists():
            yield f"{link}: no such file"
        elif place and place not in anchors(target):
            yield f"{link}: no such place"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_no_link_is_dead(page):
    assert [*dead_links(page)] == []


def test_a_dead_link_is_noticed(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# One place\n[a](#one-place) [b](nowhere.md) [c](#two) ![d](e.png)\n")
    assert [*dead_links(page)] == [
        "nowhere.md: no such file", "#two: no such place", "e.png: no such file",
    ]  # fmt: skip


def test_every_agent_is_described():
    table = text_of(ROOT / "docs" / "agents.md")
    assert [name for name in AGENTS if f"| `{name}` |" not in table] == []


# --- the site


def test_the_page_of_environments_says_what_the_code_does():
    written = text_of(ROOT / "docs" / "environments.md")
    assert script(SITE / "environments.py").page() == written, (
        "run python docs/site/environments.py"
    )


def pages_of(nav):
    for item in nav:
        for target in item.values():
            yield from [target] if isinstance(target, str) else pages_of(target)


def test_the_site_is_whole(tmp_path):
    assemble = script(SITE / "assemble.py")
    assemble.main(tmp_path / "site")
    config = tomllib.loads(text_of(ROOT / "zensical.toml"))["project"]
    there = {str(path.relative_to(tmp_path / "site")) for path in (tmp_path / "site").rglob("*.md")}
    missing = {page for page in pages_of(config["nav"]) if page not in there}
    assert missing == set()
    assert there - {*pages_of(config["nav"])} <= {"policies/README.md"}
    assert "# Train PPO" in text_of(tmp_path / "site" / "examples.md")
    with pytest.raises(SystemExit, match=r"README\.md: nowhere\.md is not part of the site"):
        assemble.relinked("[a](nowhere.md)", Path("README.md"), assemble.places())


def test_dead_links_of_the_site_are_noticed(tmp_path, capsys):
    good = '<a href="b.html#x">b</a><a href="https://example.org">out</a><img src="a.png">'
    (tmp_path / "a.html").write_text(good)
    (tmp_path / "b.html").write_text('<p id="x">')
    (tmp_path / "a.png").touch()
    check_links = script(SITE / "check_links.py")
    assert check_links.main(tmp_path) == 0
    bad = '<a href="c.html">c</a><a href="a.html#x">x</a><script src="https://example.org/a.js">'
    (tmp_path / "b.html").write_text('<p id="x">' + bad)
    assert check_links.main(tmp_path) == 1
    assert capsys.readouterr().out.splitlines()[1:4] == [
        "b.html: a.html#x: no such place",
        "b.html: c.html: no such file",
        "b.html: loads https://example.org/a.js",
    ]


def test_docstrings_become_markdown():
    pytest.importorskip("griffe", reason="activeloc[docs] is not installed")
    pytest.importorskip("latex2mathml", reason="activeloc[docs] is not installed")
    given = "A :class:`~a.B` [m].\n\n==== ====\n``a`` one\n     two\n==== ====\n\n>>> f(x)[0]\n"
    assert script(SITE / "extensions.py").markdown_of(given) == (
        "A `a.B` \\[m].\n\n|  |  |\n|---|---|\n| ``a`` | one two |\n\n```pycon\n>>> f(x)[0]\n```\n"
    )
