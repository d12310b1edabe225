"""Sweeps: paired, the same whatever the processes and interruptions, one at a time in a folder."""

import csv
import json
import os
import shutil
import subprocess
import sys
from math import fsum

import numpy as np
import pytest

from activeloc.agents.evaluation import Player, Sweep, evaluate
from activeloc.agents.evaluation.lock import locked
from activeloc.agents.evaluation.records import FILE_NAME, read_records
from activeloc.agents.evaluation.workers import Unit, play_in_processes
from activeloc.errors import ConfigError
from activeloc.maps import MapSource, from_text

HUT = from_text(
    """
##########
#...#....#
#........#
###.##...#
##########
""",
    name="hut",
)
COARSE = {"kind": "histogram", "cell_size": 0.5, "headings": 12}
AGENTS = {"random": {}, "spin": {}, "greedy": {"samples": 20, "readings": 2}}


def sweep(**changes):
    settings = {"belief": COARSE, **changes.pop("settings", {})}
    given = {"agents": AGENTS, "episodes": 3, "seed": 5, "limit": 12, "map": MapSource.parse(HUT)}
    env = changes.pop("env", "activeloc/GlobalLocalization-v0")
    return Sweep(env=env, settings=settings, **{**given, **changes})


def results(folder):
    return {name: (folder / name).read_bytes() for name in ("episodes.csv", "curves.csv")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A sweep played without a break."""
    folder = tmp_path_factory.mktemp("whole")
    evaluate(sweep(), folder)
    return folder


def test_every_agent_meets_the_same_episodes(whole):
    starts = {}
    for record in read_records(whole / FILE_NAME).records:
        starts.setdefault(record.episode, set()).add(record.start)
        starts[record.episode].add(record.start)
    assert sorted(starts) == [0, 1, 2]
    assert [len(poses) for poses in starts.values()] == [1, 1, 1]
    assert len(set.union(*starts.values())) == 3


def test_the_same_motions_meet_the_same_noise():
    player = Player(sweep(agents={"random": {}, "spin": {}}))
    scans = {}
    for agent in player.agents:
        player.reset(agent, 1)
        scans[agent] = [player.env.step(2)[0]["scan"].tolist() for _ in range(3)]
    assert scans["random"] == scans["spin"]


def test_an_episode_does_not_depend_on_those_before_it():
    player = Player(sweep())
    alone = player.play("greedy", 2)
    player.play("spin", 0)
    again = player.play("greedy", 2)
    assert (alone.entropy, alone.start, alone.total_reward) == (
        again.entropy,
        again.start,
        again.total_reward,
    )


def test_seeds_are_those_that_the_module_promises():
    words = np.random.SeedSequence(5, spawn_key=(7, 0)).generate_state(1, np.uint64)
    assert sweep().env_seed(7) == int(words[0])
    assert (
        sweep().agent_rng(7).random()
        == np.random.default_rng(np.random.SeedSequence(5, spawn_key=(7, 1))).random()
    )


def test_maps_come_round_in_order():
    player = Player(sweep(map=MapSource.parse("rooms:4-5"), limit=1))
    assert [player.play("spin", i).map for i in range(3)] == ["rooms-4", "rooms-5", "rooms-4"]


def test_two_processes_give_the_bytes_of_one(whole, tmp_path):
    evaluate(sweep(), tmp_path, jobs=2)
    assert results(tmp_path) == results(whole)


def test_particles_give_the_same_bytes_in_two_processes(tmp_path):
    few = {"kind": "particles", "n_min": 50, "n_max": 400, "n_elsewhere": 60}
    for jobs in (1, 2):
        played = sweep(settings={"belief": few}, agents={"random": {}, "spin": {}}, episodes=2)
        evaluate(played, tmp_path / str(jobs), jobs=jobs)
    assert results(tmp_path / "1") == results(tmp_path / "2")
    diagnostics = json.loads((tmp_path / "1" / "summary.json").read_text())["diagnostics"]
    assert 50 <= diagnostics["spin"]["n_particles"] <= 400 + 2 * 60


@pytest.mark.parametrize("jobs", [1, 2])
def test_stopped_and_gone_on_is_the_same_as_not_stopped(whole, tmp_path, jobs):
    class StopError(BaseException):
        pass

    n_played = []

    def stop(record):
        n_played.append(record)
        if len(n_played) == 4:
            raise StopError

    with pytest.raises(StopError):
        evaluate(sweep(), tmp_path, jobs=jobs, on_record=stop)
    assert not (tmp_path / "episodes.csv").exists()
    assert len(read_records(tmp_path / FILE_NAME).records) == 4
    path = tmp_path / FILE_NAME
    path.write_bytes(path.read_bytes()[:-40])  # the fourth record's line is torn
    found = []
    evaluate(sweep(), tmp_path, on_start=found.append)
    assert found == [3]
    assert results(tmp_path) == results(whole)


def test_what_is_there_is_not_played_again(whole, tmp_path, monkeypatch):
    shutil.copytree(whole, tmp_path / "copy")
    monkeypatch.setattr(Player, "play", None)
    evaluate(sweep(), tmp_path / "copy")
    assert results(tmp_path / "copy") == results(whole)


def test_a_shorter_sweep_and_more_agents_share_a_folder(whole, tmp_path):
    evaluate(sweep(episodes=2, agents={"random": {}}), tmp_path)
    assert len((tmp_path / "episodes.csv").read_text().splitlines()) == 3
    evaluate(sweep(), tmp_path)
    assert results(tmp_path) == results(whole)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"seed": 6}, "seed was 5 and is now 6"),
        ({"limit": 13}, "steps was 12 and is now 13"),
        ({"settings": {"world": "discrete"}}, "settings.world was 'continuous'"),
        ({"map": MapSource.parse("maze:1")}, "settings.map"),
        ({"agents": {"greedy": {"samples": 30, "readings": 2}}}, "agents.greedy.samples was 20"),
        ({"env": "activeloc/PositionTracking-v0"}, "env was"),
    ],
)
def test_another_configuration_is_refused(whole, changes, named):
    before = {path: path.read_bytes() for path in whole.iterdir()}
    with pytest.raises(ConfigError, match="start with --overwrite") as refusal:
        evaluate(sweep(**changes), whole)
    assert named in str(refusal.value)
    assert {path: path.read_bytes() for path in whole.iterdir()} == before


def test_overwrite_starts_over(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "copy")
    evaluate(sweep(seed=6, episodes=1), tmp_path / "copy", overwrite=True)
    rows = list(csv.DictReader((tmp_path / "copy" / "episodes.csv").read_text().splitlines()))
    assert [row["seed"] for row in rows] == ["6", "6", "6"]


def test_files_say_what_was_played(whole):
    with (whole / "episodes.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert ",".join(rows[0]) == (
        "agent,map,seed,episode,steps,success,wrong,entropy_auc,final_entropy,error_m,error_rad,"
        "return"
    )
    assert [(row["agent"], row["episode"]) for row in rows] == [
        (agent, str(episode)) for agent in AGENTS for episode in range(3)
    ]
    assert all(row["steps"] == "12" for row in rows if row["success"] == "0")
    with (whole / "curves.csv").open() as file:
        curves = list(csv.DictReader(file))
    assert len(curves) == 3 * 13
    for agent in AGENTS:
        mean = fsum(float(r["entropy"]) for r in curves if r["agent"] == agent and r["step"] != "0")
        areas = [float(row["entropy_auc"]) for row in rows if row["agent"] == agent]
        assert mean / 12 == pytest.approx(fsum(areas) / 3)
        assert all(float(r["low"]) <= float(r["entropy"]) <= float(r["high"]) for r in curves)


def test_summary_holds_scores_configuration_and_timing(whole):
    summary = json.loads((whole / "summary.json").read_text())
    assert summary["configuration"]["settings"]["belief"]["cell_size"] == 0.5
    assert summary["configuration"]["settings"]["sensor"]["z_max"] == 1.5
    assert summary["configuration"]["agents"]["greedy"]["samples"] == 20
    assert set(summary["scores"]) == set(AGENTS)
    assert set(summary["differences"]) == {"spin", "greedy"}
    assert summary["timing"]["greedy"]["act_ms"] > 0.0
    assert set(summary["versions"]) >= {"python", "activeloc", "numpy", "gymnasium"}


def test_rewards_add_up(whole):
    for record in read_records(whole / FILE_NAME).records:
        information = record.entropy[0] - record.entropy[-1]
        total = information - 0.005 * record.played + record.success - record.wrong
        assert record.total_reward == pytest.approx(total)


def test_tracking_is_judged_at_the_limit(tmp_path):
    played = sweep(env="activeloc/PositionTracking-v0", agents={"spin": {}}, episodes=2)
    evaluate(played, tmp_path)
    for record in read_records(tmp_path / FILE_NAME).records:
        assert (record.steps, record.played) == (12, 12)
        assert record.success == (record.error_m <= 0.5 and record.error_rad <= np.deg2rad(20.0))


def test_without_matplotlib_there_is_a_remark(whole, tmp_path, monkeypatch):
    shutil.copytree(whole, tmp_path / "copy")
    (tmp_path / "copy" / "entropy.png").unlink()
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    report = evaluate(sweep(), tmp_path / "copy")
    assert report.remarks == ["no entropy.png: matplotlib is not installed (activeloc[plot])"]
    assert not (tmp_path / "copy" / "entropy.png").exists()


def test_an_agent_that_cannot_play_is_refused_before_anything_is_written(tmp_path):
    continuous = sweep(settings={"actions": "continuous"})
    with pytest.raises(ConfigError, match="greedy needs discrete actions"):
        evaluate(continuous, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_workers_error_reaches_the_caller():
    continuous = sweep(settings={"actions": "continuous"})
    with pytest.raises(ConfigError, match="greedy needs discrete actions"):
        list(play_in_processes(continuous, [Unit(0, 0, ("greedy",))], 1))


def test_two_runs_do_not_share_a_folder(tmp_path):
    with (
        locked(tmp_path),
        pytest.raises(ConfigError, match=f"in use by process {os.getpid()}"),
        locked(tmp_path),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_dead_processes_lock_is_taken_over(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    with locked(tmp_path):
        held = (tmp_path / ".lock").read_text()
    (tmp_path / ".lock").write_text(held.replace(str(os.getpid()), str(dead.pid)))
    with locked(tmp_path):
        assert (tmp_path / ".lock").read_text() == held
    assert list(tmp_path.iterdir()) == []


def test_a_lock_of_another_host_is_left_alone(tmp_path):
    (tmp_path / ".lock").write_text("1 elsewhere\n")
    with pytest.raises(ConfigError, match="process 1 on elsewhere"), locked(tmp_path):
        pass
    assert (tmp_path / ".lock").exists()
