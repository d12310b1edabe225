"""``activeloc play``: keys, what is shown, and the window under SDL's dummy driver."""

import json
import re

import numpy as np
import pytest

from activeloc.agents.advice import advise
from activeloc.cli import main, window
from activeloc.cli.game import Game
from activeloc.cli.settings import make_sweep

HUT = """\
############
#....#.....#
#..........#
#....#...#.#
############
"""
COARSE = ["belief.cell_size=0.5", "belief.headings=12"]
FAST = "--map hut.txt --set belief.cell_size=0.5 --set belief.headings=12 --advice spin"
TRUTH = np.array([0, 98, 178])


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    (tmp_path / "hut.txt").write_text(HUT)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def game(*settings, agents=("spin", "greedy"), steps=5, env="GlobalLocalization-v0", **given):
    settings = [*(COARSE if env[0] == "G" else ()), *settings]
    source = "hut.txt" if env[0] == "G" else "maze(size=7):3"
    return Game(make_sweep(env, source, "histogram", agents, settings, 3, steps), size=400, **given)


def robot_is_drawn(one):
    """Whether the map's part of the frame has the true robot's blue."""
    part = one.frame()[:150, :400].astype(int)
    return bool((np.abs(part - TRUTH).max(axis=-1) < 12).sum() > 20)


@pytest.mark.parametrize(
    ("key", "command"),
    [
        ("left", "turn left 30 deg"),
        ("a", "turn left 30 deg"),
        ("right", "turn right 30 deg"),
        ("d", "turn right 30 deg"),
        ("up", "drive 0.5 m"),
        ("w", "drive 0.5 m"),
        ("s", "stay"),
        ("down", "stay"),
        ("space", "stay"),
    ],
)
@pytest.mark.parametrize("kind", ["discrete+stay", "continuous"])
def test_a_key_is_a_step(key, command, kind):
    one = game(f"actions={kind}", agents=("spin",))
    assert one.press(key)
    assert one.recording().commands == (command,)
    assert one.recording().agent == "you"


def test_other_keys_do_nothing():
    one = game()
    assert not any(one.press(key) for key in ("x", "", "s", "escape", "left shift"))
    assert (one.steps, len(one.recording())) == (0, 1)


def test_mazes_are_played_in_cells():
    one = game(agents=("greedy",), env="Maze7-v0")
    one.press("up")
    one.press("left")
    assert one.recording().commands == ("drive 1 m", "turn left 90 deg")


def test_the_truth_is_hidden_until_it_is_asked_for():
    one = game()
    assert not robot_is_drawn(one)
    assert not one.press("x")
    assert one.press("t")
    assert robot_is_drawn(one)
    assert one.press("t")
    assert not robot_is_drawn(one)


def test_the_end_shows_the_truth_and_waits():
    one = game(steps=2)
    one.press("left")
    assert (one.over, one.results) == (False, [])
    one.press("left")
    assert one.over
    assert robot_is_drawn(one)
    assert str(one.results[0]) == "episode 0 on hut: not localized after 2 steps"
    assert not one.press("left")
    assert (len(one.recording()), one.advice) == (3, [])
    start = one.recording().poses[0]
    one.press("r")
    assert (one.over, one.steps, len(one.recording())) == (False, 0, 1)
    np.testing.assert_array_equal(one.recording().poses[0], start)
    one.press("n")
    assert one.episode == 1
    assert (one.recording().poses[0] != start).any()
    assert len(one.results) == 1


def test_it_is_the_episode_that_agents_play():
    from activeloc.agents.evaluation import Player

    one = game(episode=4)
    sweep = make_sweep("GlobalLocalization-v0", "hut.txt", "histogram", ["spin"], COARSE, 3, 5)
    record = Player(sweep).play("spin", 4)
    assert tuple(one.recording().poses[0]) == record.start
    for _ in range(5):
        one.press("left")
    # A spinning robot turns left: the same commands, the same world, the same belief.
    np.testing.assert_array_equal(one.recording().entropy_fraction, record.entropy)


# --- advice


def test_advice_is_what_a_fresh_agent_does_and_changes_nothing():
    asked, alone = game("agent.greedy.samples=64"), game("agent.greedy.samples=64")
    for key in ("left", "up", "right"):
        knowledge, observation = asked.core.knowledge, asked.observation
        fresh = asked.sweep.agent("greedy")
        fresh.reset(np.random.default_rng([0, asked.steps]).spawn(2)[1])
        spin, greedy = asked.advice
        assert (spin.agent, spin.words) == ("spin", "turn left 30 deg")
        assert greedy.action == fresh.act(observation, knowledge)
        assert greedy.expected_gain == pytest.approx(fresh.plan.expected_gain)
        assert (spin.expected_gain, spin.walk, greedy.walk) == (None, "", "")
        asked.press(key)
        alone.press(key)
    one, other = asked.recording(), alone.recording()
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.shades, other.shades)


def test_a_walk_is_told_to_its_end():
    one = game("agent.active.samples=64", agents=("active",))
    for _ in range(12):
        advice = one.advice[0]
        if advice.walk:
            break
        one.press("left")
    times = [int(n) for n in re.findall(r"(\d+) x (?:turn|drive)", advice.walk)]
    assert sum(times) > 1
    assert advice.walk.split(" x ", 1)[1].startswith(advice.words)


def test_agents_are_asked_in_mazes():
    one = game(agents=("greedy", "lookahead"), env="Maze7-v0")
    rng = np.random.default_rng(0)
    asked = advise(one.agents, one.observation, one.core.knowledge, rng)
    assert [advice.agent for advice in asked] == ["greedy", "lookahead"]
    assert {advice.words for advice in asked} <= {
        "turn left 90 deg", "turn right 90 deg", "drive 1 m",
    }  # fmt: skip


# --- the window


@pytest.fixture
def keyboard(monkeypatch):
    """Keys to come, by name; ``None`` for the window's closing; what was on the screen before."""
    pygame = pytest.importorskip("pygame", reason="pygame-ce is not installed")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    seen = []

    def come(*keys):
        codes = {name: getattr(pygame, f"K_{name.upper() if len(name) > 1 else name}")
                 for name in keys if name}  # fmt: skip
        events = [
            pygame.event.Event(pygame.KEYDOWN, key=codes[name])
            if name
            else pygame.event.Event(pygame.QUIT)
            for name in keys
        ]

        def wait(timeout):
            screen = pygame.display.get_surface()
            seen.append(pygame.surfarray.array3d(screen).swapaxes(0, 1).copy())
            return events.pop(0)

        monkeypatch.setattr("pygame.event.wait", wait)
        return seen

    return come


def test_the_window_shows_each_step(keyboard):
    one, reference = game(), game()
    seen = keyboard("left", "x", "up", "escape")
    window.show(one, "hut")
    frames = [reference.frame()]
    for key in ("left", "up"):
        reference.press(key)
        frames.append(reference.frame())
    assert len(seen) == 4
    for screen, frame in zip(seen, [frames[0], frames[1], frames[1], frames[2]], strict=True):
        np.testing.assert_array_equal(screen, frame)
    assert one.recording().commands == ("turn left 30 deg", "drive 0.5 m")


def test_a_frame_of_another_shape_is_fitted_in(monkeypatch):
    pygame = pytest.importorskip("pygame", reason="pygame-ce is not installed")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    surface = pygame.display.set_mode((200, 100))
    window._paint(surface, np.full((50, 50, 3), (10, 20, 30), np.uint8))
    pixels = pygame.surfarray.array3d(surface).swapaxes(0, 1)
    inside = (pixels == (10, 20, 30)).all(axis=-1)
    pygame.display.quit()
    assert inside[:, 50:150].all()
    assert not inside[:, :50].any()
    assert not inside[:, 150:].any()


def test_the_command_plays_and_keeps_the_replay(place, keyboard, capsys):
    keyboard("left", "up", "right", None)
    assert main(f"play {FAST} --steps 2 --size 300 --out mine.html".split()) == 0
    out = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"episode 0 on hut: (not )?localized after 2 steps", out[0])
    assert re.fullmatch(r"mine\.html: 0\.\d\d MB", out[1])
    text = (place / "mine.html").read_text("utf-8")
    (track,) = json.loads(re.search(r'id="replay">(.*?)</script>', text, re.DOTALL)[1])["tracks"]
    assert (track["agent"], track["commands"]) == ("you", ["turn left 30 deg", "drive 0.5 m"])


def test_advice_suits_the_actions(keyboard, monkeypatch):
    shown = []
    monkeypatch.setattr(window, "show", lambda game, title: shown.append([*game.agents]))
    coarse = "--set belief.cell_size=0.5 --set belief.headings=12 --set agent.active.samples=64"
    for settings in ("--map hut.txt", "--map hut.txt --set actions=continuous"):
        assert main(f"play {settings} {coarse}".split()) == 0
    assert main(["play", "--env", "Maze7-v0"]) == 0
    assert shown == [["spin", "greedy", "lookahead", "active"], ["spin", "active"],
                     ["greedy", "lookahead"]]  # fmt: skip


def test_leaving_early_is_no_error(keyboard, capsys):
    keyboard("left", "escape")
    assert main(f"play {FAST} --size 300".split()) == 0
    expected = "no episode was played to its end; 1 steps in the last one\n"
    assert capsys.readouterr().out == expected


def test_without_a_screen_it_is_said_so(monkeypatch):
    from activeloc.errors import ConfigError

    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    with pytest.raises(ConfigError, match="there is no screen"):
        window._demand_display("offscreen")
    window._demand_display("x11")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window._demand_display("dummy")


def test_a_driver_that_does_not_exist_is_one_line(monkeypatch, capsys):
    pytest.importorskip("pygame", reason="pygame-ce is not installed")
    monkeypatch.setenv("SDL_VIDEODRIVER", "telepathy")
    assert main(f"play {FAST}".split()) == 2
    err = capsys.readouterr().err
    assert err.startswith("activeloc: no window can be opened: ")
    assert err.count("\n") == 1


def test_without_pygame_it_is_said_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr("activeloc.cli.window.find_spec", lambda name: None)
    assert main(f"play {FAST}".split()) == 2
    assert 'pip install "activeloc[render]"' in capsys.readouterr().err


REFUSED = {
    "agent": ("play --map hut.txt --advice gredy", "did you mean 'greedy'"),
    "size": ("play --map hut.txt --size 100", "size must be an integer in [300, 4000]"),
    "map": ("play --map lost.yaml", "lost.yaml: cannot read"),
    "suffix": ("play --map hut.txt --out mine.txt", "must end in .gif or .mp4 or .html"),
    "maze": ("play --env Maze7-v0 --advice spin", "agent spin plays no mazes"),
    "continuous": (
        "play --map hut.txt --set actions=continuous --advice greedy",
        "needs discrete actions",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_in_one_line(place, capsys, name):
    command, message = REFUSED[name]
    assert main(command.split()) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err
