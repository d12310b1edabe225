import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401
from activeloc.agents import make_agent
from activeloc.envs.recorder import Recorder
from activeloc.envs.rendering import Tape, draw
from activeloc.envs.rendering.ground import places_of, probabilities_of, shades_of
from activeloc.envs.rendering.recording import heading_slices, outcome_of
from activeloc.errors import ConfigError

SMALL = "rooms(width=5,height=3,smallest=1.5):0"
COARSE = {"kind": "histogram", "cell_size": 0.5, "headings": 12}


def make(id="GlobalLocalization-v0", steps=6, **settings):
    settings = {"map": SMALL, "belief": COARSE, "render_mode": "rgb_array"} | settings
    return Recorder(gym.make(f"activeloc/{id}", max_episode_steps=steps, **settings))


def test_it_holds_what_happened():
    env, agent = make(), make_agent("random")
    agent.reset(np.random.default_rng(3))
    observation, info = env.reset(seed=3)
    core = env.unwrapped
    poses, infos, actions, scans = [core.pose], [info], [], [core.knowledge.scan]
    over = False
    while not over:
        actions.append(agent.act(observation, core.knowledge))
        observation, _, terminated, truncated, info = env.step(actions[-1])
        poses.append(core.pose)
        scans.append(core.knowledge.scan)
        infos.append(info)
        over = terminated or truncated
    recording = env.recording("random")
    assert (recording.agent, len(recording)) == ("random", len(infos))
    np.testing.assert_array_equal(recording.poses, poses)
    np.testing.assert_array_equal(recording.scans, scans)
    np.testing.assert_array_equal(recording.actions, actions)
    for name in ("entropy", "entropy_fraction", "mass", "error_m", "error_rad"):
        np.testing.assert_array_equal(getattr(recording, name), [info[name] for info in infos])
    words = ("turn left 30 deg", "turn right 30 deg", "drive 0.5 m")
    assert recording.commands == tuple(words[action] for action in actions)
    assert recording.outcome == outcome_of(infos[-1])
    assert recording.carried_at is None


@pytest.mark.parametrize(
    "settings",
    [{}, {"id": "Maze7-v0", "map": "maze(size=7):1", "belief": "histogram"}],
    ids=["rooms", "maze"],
)
def test_it_is_drawn_as_the_episode_was(settings):
    env = make(**settings)
    env.reset(seed=1)
    live = [env.render()]
    for action in (0, 2, 2):
        env.step(action)
        live.append(env.render())
    recording = env.recording("mine")
    for moment, frame in enumerate(live):
        # The belief is cut to the map: where two cells are blended, rounding may differ.
        np.testing.assert_allclose(draw(recording.scene(moment)).astype(int), frame, atol=2)
    np.testing.assert_array_equal(draw(recording.scene(99)), draw(recording.scene(3)))
    assert recording.scene(0, with_agent=True).caption.startswith("mine: ")


def test_the_belief_is_kept_on_the_map_and_a_cell_beyond():
    env = make()
    env.reset(seed=1)
    recording = env.recording("mine")
    (_, _, y0, y1), (rows, cols) = recording.grid.extent, recording.shades.shape[1:]
    side, bottom = recording.resolution, recording.origin[1]
    assert rows < cols == 160
    assert bottom + side <= y0 + 1e-9 < bottom + 2 * side
    assert bottom + (rows - 2) * side - 1e-9 <= y1 <= bottom + (rows - 1) * side + 1e-9


def test_a_new_episode_begins_a_new_recording():
    env = make()
    env.reset(seed=1)
    env.step(0)
    env.reset(seed=2)
    assert len(env.recording("mine")) == 1


def test_it_says_when_the_robot_was_carried_off():
    env = make("KidnappedRobot-v0", task={"kidnap_first": 2, "kidnap_last": 2, "kind": "kidnapped"})
    env.reset(seed=1)
    for _ in range(3):
        env.step(0)
    assert env.recording("mine").carried_at == 2


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ((1.0, -1.0), "turn left 30 deg"),
        ((-0.5, 1.0), "turn right 15 deg, drive 0.5 m"),
        ((0.0, 0.0), "drive 0.25 m"),
        ((0.0, -1.0), "stay"),
    ],
)
def test_actions_in_words(action, words):
    from activeloc.envs.actions import Actions

    assert Actions(kind="continuous").words(np.array(action, np.float32)) == words


def test_foreign_environments_and_empty_tapes_are_refused():
    with pytest.raises(ConfigError, match="only activeloc's environments"):
        Recorder(gym.make("CartPole-v1"))
    with pytest.raises(ConfigError, match="nothing has been recorded"):
        make().recording("mine")
    with pytest.raises(ConfigError, match="nothing has been recorded"):
        Tape().recording("mine")


def test_the_documented_lines_run(tmp_path, monkeypatch):
    text = (Path(__file__).parents[2] / "docs" / "seeing.md").read_text("utf-8")
    (lines,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    small = 'map="rooms(width=4,height=3,smallest=1.5):0", max_episode_steps=3'
    exec(lines.replace('map="rooms", max_episode_steps=20', small), {})
    assert {path.name for path in tmp_path.iterdir()} == {"mine.html", "mine.gif"}


# --- shades and slices


def test_shades_keep_probabilities_to_a_few_per_cent():
    p = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, 200)])
    back = probabilities_of(shades_of(p, 2000.0), 2000.0)
    kept = p > 0.012 / 2000.0
    assert back[0] == 0.0
    np.testing.assert_allclose(back[kept], p[kept], rtol=0.06)
    np.testing.assert_array_equal(shades_of(back, 2000.0), shades_of(p, 2000.0))


def test_the_uniform_belief_has_its_shade(recording_of):
    n = places_of(recording_of().grid, 0.5)
    assert n == 960 - 8 - 10
    assert shades_of(np.array([1.0 / n]), n)[0] == pytest.approx(0.2 * 255, abs=1)
    assert shades_of(np.array([1.0]), n)[0] == 255


@pytest.mark.parametrize(("bins", "sectors"), [(24, 8), (8, 4), (72, 8), (12, 4), (1, 1), (7, 1)])
def test_slices_are_centred_on_their_headings(bins, sectors):
    """The oracle: sample each bin's headings finely and count which sector each falls into."""
    for t in range(bins):
        belief = np.zeros((bins, 2, 3))
        belief[t, 1, 2] = 1.0
        slices = heading_slices(belief)
        fine = -np.pi + (t + (np.arange(1000) + 0.5) / 1000) * 2 * np.pi / bins
        sector = np.round((fine + np.pi) * sectors / (2 * np.pi)).astype(int) % sectors
        expected = np.bincount(sector, minlength=sectors) / 1000
        np.testing.assert_allclose(slices[:, 1, 2], expected, atol=2e-3)
        assert slices.sum() == pytest.approx(1.0)


def test_large_beliefs_are_pooled_for_the_slices():
    env = make(map="rooms(width=30,height=10):0")
    env.reset(seed=0)
    recording = env.recording("mine")
    assert max(recording.shades.shape[1:]) == 160
    assert max(recording.slices.shape[2:]) == 80
    assert recording.slice_resolution == 2 * recording.resolution
