"""Evaluation in mazes: the agents that play there, given starts, the columns and the scores."""

import csv
import json

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401  (registers the ids)
from activeloc.agents import make_agent
from activeloc.agents.evaluation import Starts
from activeloc.agents.maze_greedy import expected_entropies, least_expected_entropy
from activeloc.cli import main
from activeloc.errors import ConfigError, MapError
from activeloc.maps.maze import Maze

WAYS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def left_over(knowledge, robot, action):
    """E_z[H(x' | z, u)], reading by reading, state by state."""
    on = knowledge.lattice
    n, p_off = on.n_cells[robot], on.p_off
    bel_bar = np.zeros((n, 4))
    for c, k in np.argwhere(knowledge.belief.bel[robot, :n] > 0.0):
        p = knowledge.belief.bel[robot, c, k]
        if action < 2:
            bel_bar[c, (k + (1, -1)[action]) % 4] += p
            continue
        for length, q in ((0, p_off), (1, 1.0 - 2.0 * p_off), (2, p_off)):
            row, col = on.cells[robot, c]
            for _ in range(length):
                if on.free[robot, row + WAYS[k][0], col + WAYS[k][1]]:
                    row, col = row + WAYS[k][0], col + WAYS[k][1]
            bel_bar[on.index[robot, row, col], k] += p * q
    total = 0.0
    for z in range(len(on.sensor.confusion)):
        joint = bel_bar * on.sensor.confusion[on.depth[robot, :n], z]
        p_z = joint.sum()
        if p_z > 0.0:
            p = joint[joint > 0.0] / p_z
            total -= p_z * (p * np.log(p)).sum()
    return total


@pytest.mark.parametrize("id", ["Maze7-v0", "Maze15-v0", "NoisyMaze9-v0"])
def test_greedy_takes_what_is_expected_to_leave_least_forward_first(id):
    batch, rng = gym.make_vec(f"activeloc/{id}", num_envs=6), np.random.default_rng(0)
    batch.reset(seed=0)
    tied = 0
    for _ in range(8):
        knowledge = batch.batch_knowledge
        found, chosen = expected_entropies(knowledge), least_expected_entropy(knowledge)
        for robot in range(6):
            expected = [left_over(knowledge, robot, action) for action in range(3)]
            np.testing.assert_allclose(found[robot], expected, atol=1e-10)
            best = [a for a in (2, 0, 1) if expected[a] <= min(expected) + 1e-9]
            assert chosen[robot] == best[0]
            assert make_agent("greedy").act({}, batch.knowledge(robot)) == chosen[robot]
            tied += len(best) > 1
        batch.step(rng.integers(3, size=6))
    assert tied or id == "NoisyMaze9-v0"


def write_starts(path, n=6, size=15, **changed):
    rng = np.random.default_rng(3)
    grids = np.array([Maze(size).draw(rng) != 0 for _ in range(n)])
    cells = [np.argwhere(~grid)[rng.integers((~grid).sum())] for grid in grids]
    poses = np.array([[*cell, rng.integers(4)] for cell in cells])
    np.savez(path, **{"grids": grids, "poses": poses, **changed})
    return grids, poses


def test_success_in_the_csv_is_the_strict_accuracy_of_the_episode_played_by_hand(tmp_path):
    grids, poses = write_starts(tmp_path / "starts.npz")
    out = tmp_path / "out"
    words = ["evaluate", "--env", "Maze15-v0", "--agents", "greedy", "--steps", "12"]
    assert main([*words, "--starts", str(tmp_path / "starts.npz"), "--out", str(out)]) == 0
    rows = list(csv.DictReader((out / "episodes.csv").read_text().splitlines()))
    assert [row["map"] for row in rows] == [f"starts.npz-{i}" for i in range(6)]
    env, agent = gym.make("activeloc/Maze15-v0", max_episode_steps=12), make_agent("greedy")
    strict = set()
    for row, grid, pose in zip(rows, grids, poses, strict=True):
        env.reset(options={"grid": grid, "pose": pose})
        largest = []
        for _ in range(12):
            _, reward, _, over, info = env.step(agent.act({}, env.unwrapped.knowledge))
            largest.append(reward)
        assert over
        n_sure = sum(p == 1.0 for p in largest)
        assert row["success"] == str(int(n_sure > 0))
        assert row["steps"] == str(12 - n_sure + 1 if n_sure else 12)
        assert float(row["return"]) == pytest.approx(sum(largest))
        assert row["likeliest"] == str(int(info["likeliest_is_true"]))
        assert float(row["final_entropy"]) == pytest.approx(-np.log(largest[-1]), abs=1e-12)
        strict.add(row["success"])
    assert strict == {"0", "1"}
    scores = json.loads((out / "summary.json").read_text())["scores"]["greedy"]
    returns = [float(row["return"]) for row in rows]
    assert scores["return"]["value"] == pytest.approx(np.mean(returns))
    assert scores["right"]["value"] == np.mean([row["success"] == "1" for row in rows])


def test_starts_may_be_given_as_free_cells_or_as_walls(tmp_path):
    grids, _ = write_starts(tmp_path / "walls.npz")
    write_starts(tmp_path / "free.npz", grids=~grids)
    walls, free = Starts.load(tmp_path / "walls.npz"), Starts.load(tmp_path / "free.npz")
    np.testing.assert_array_equal(walls.free, ~grids)
    np.testing.assert_array_equal(free.free, ~grids)
    assert walls.digest == free.digest
    turned = walls.poses.copy()
    turned[5, 2] = (turned[5, 2] + 1) % 4
    write_starts(tmp_path / "other.npz", poses=turned)
    assert Starts.load(tmp_path / "other.npz").digest != walls.digest


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"grids": np.ones((6, 15, 15))}, ConfigError, "grids must be bools"),
        ({"poses": np.zeros((5, 3))}, ConfigError, r"poses must be whole numbers \(6, 3\)"),
        ({"poses": np.zeros((6, 3))}, MapError, "start 0: pose"),
        ({"grids": np.zeros((6, 15, 15), dtype=bool)}, MapError, "start 0: pose"),
        ({"poses": np.array([["a"] * 3] * 6)}, ConfigError, "poses must be"),
    ],
    ids=str,
)
def test_starts_that_are_none_are_refused(tmp_path, changed, error, message):
    write_starts(tmp_path / "starts.npz", **changed)
    with pytest.raises(error, match=message):
        Starts.load(tmp_path / "starts.npz")


@pytest.mark.parametrize("content", [b"", b"no zip", None])
def test_a_file_without_starts_is_refused(tmp_path, content):
    path = tmp_path / "starts.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match="cannot read"):
        Starts.load(path)
    np.savez(tmp_path / "half.npz", grids=np.zeros((1, 7, 7), dtype=bool))
    with pytest.raises(ConfigError, match="no array 'poses'"):
        Starts.load(tmp_path / "half.npz")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--env", "Maze15-v0", "--agents", "spin"], "spin plays no mazes"),
        (["--env", "Maze15-v0", "--gains"], "gains are not recorded in mazes"),
        (["--env", "Maze15-v0", "--belief", "particles"], "belief is not for the maze task"),
        (["--env", "Maze15-v0", "--map", "office"], "not for the maze task"),
        (["--env", "Maze7-v0", "--starts", "starts.npz"], "needs 7 x 7"),
        (["--env", "Maze15-v0", "--starts", "starts.npz", "--episodes", "7"], "at most the 6"),
        (["--agents", "random", "--starts", "starts.npz"], "starts are for mazes"),
    ],
    ids=" ".join,
)
def test_what_cannot_be_played_is_refused_in_one_line(
    tmp_path, monkeypatch, capsys, words, message
):
    monkeypatch.chdir(tmp_path)
    write_starts(tmp_path / "starts.npz")
    assert main(["evaluate", *words, "--out", "out"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("agent", "strict", "total"), [("random", (0.36, 0.40), (7.0, 7.5)),
                                   ("greedy", (0.55, 0.61), (12.0, 12.5))]
)  # fmt: skip
def test_agrees_with_what_others_measured_on_mazes_of_15(agent, strict, total):
    """Public test set: random .381 / 7.45, greedy .569 / 12.10; own mazes of the same law here."""
    n, rng = 4000, np.random.default_rng(0)
    batch = gym.make_vec("activeloc/Maze15-v0", num_envs=n)
    batch.reset(seed=1)
    returns = np.zeros(n)
    for _ in range(20):
        greedy = least_expected_entropy(batch.batch_knowledge)
        chosen = greedy if agent == "greedy" else rng.integers(3, size=n)
        _, rewards, _, _, infos = batch.step(chosen)
        returns += rewards
    share, mean = infos["is_success"].mean(), returns.mean()
    print(f"{agent}: strict {share:.3f}, return {mean:.2f} over {n} mazes")
    assert strict[0] < share < strict[1]
    assert total[0] < mean < total[1]
