"""Stopped, killed or left alone: a run ends with the same weights."""

import hashlib
import multiprocessing
import os
import signal
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

from activeloc.agents.sb3 import training
from activeloc.agents.sb3.checkpoint import latest_checkpoint, read_checkpoint
from activeloc.agents.sb3.configuration import TrainingConfig
from activeloc.agents.sb3.training import CHECKPOINTS, Stopped, train
from activeloc.agents.sb3.vec_env import NativeVecEnv
from activeloc.errors import ConfigError

ROOT = Path(__file__).parents[3]


def digest(path):
    """Of everything that makes the next update what it is."""
    stored = read_checkpoint(path)
    sha = hashlib.sha256()
    for arrays in (stored.policy, stored.optimizer, stored.state):
        for name in sorted(arrays):
            sha.update(name.encode() + arrays[name].tobytes())
    return sha.hexdigest()


class Killed(Exception):
    pass


def at_step(monkeypatch, number, act):
    """Do something in the middle of the environment's step ``number``."""
    step, count = NativeVecEnv.step_wait, [0]

    def counted(self):
        count[0] += 1
        if count[0] == number:
            act()
        return step(self)

    monkeypatch.setattr(NativeVecEnv, "step_wait", counted)


def kill():
    raise Killed


def send(number):
    return lambda: os.kill(os.getpid(), number)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """Digest of the last checkpoint of a run left alone, by configuration; computed once."""
    known = {}

    def of(config):
        key = str(config.plain())
        if key not in known:
            known[key] = digest(train(config, tmp_path_factory.mktemp("alone") / "run"))
        return known[key]

    return of


@pytest.mark.parametrize(
    ("algorithm", "step", "act"),
    [
        ("ppo", 20, kill),
        ("ppo", 8, send(signal.SIGTERM)),
        ("ppo", 19, send(signal.SIGINT)),
        ("recurrent_ppo", 33, kill),
        ("recurrent_ppo", 23, send(signal.SIGTERM)),
        ("dqn", 30, kill),
        ("dqn", 40, send(signal.SIGTERM)),
    ],
)
def test_an_interrupted_run_ends_with_the_same_bits(
    make_config, uninterrupted, tmp_path, monkeypatch, algorithm, step, act
):
    config = make_config(algorithm)
    with monkeypatch.context() as patched:
        at_step(patched, step, act)
        with pytest.raises((Killed, Stopped)):
            train(config, tmp_path)
    assert digest(latest_checkpoint(tmp_path / CHECKPOINTS)[0]) != uninterrupted(config)
    assert digest(train(config, tmp_path, resume=True)) == uninterrupted(config)


@pytest.mark.slow
def test_interrupted_again_and_again(make_config, uninterrupted, tmp_path, monkeypatch):
    config = make_config(evaluate_every=2, n_eval_episodes=2)
    for number in range(12):
        with monkeypatch.context() as patched:
            at_step(patched, 9 + 8 * number, send(signal.SIGTERM) if number % 2 else kill)
            try:
                path = train(config, tmp_path, resume=number > 0)
            except (Killed, Stopped):
                continue
            break
    assert number > 2
    assert digest(path) == uninterrupted(config)


def test_another_seed_gives_other_weights(make_config, uninterrupted):
    assert uninterrupted(make_config(seed=6)) != uninterrupted(make_config())


def test_evaluations_do_not_change_the_weights(make_config, uninterrupted, tmp_path):
    path = train(make_config(evaluate_every=2, n_eval_episodes=2), tmp_path)
    assert digest(path) == uninterrupted(make_config())
    assert read_checkpoint(path).config["progress"]["best_mean_reward"] is not None
    best = (tmp_path / CHECKPOINTS / "best").read_text().strip()
    assert read_checkpoint(tmp_path / CHECKPOINTS / best).config["progress"]["num_timesteps"] < 90


def test_a_signal_ends_the_run_with_a_checkpoint_of_its_last_boundary(
    make_config, tmp_path, monkeypatch
):
    at_step(monkeypatch, 8, send(signal.SIGTERM))
    with pytest.raises(Stopped):
        train(make_config(), tmp_path)
    stored = latest_checkpoint(tmp_path / CHECKPOINTS)[1]
    assert stored.config["progress"]["num_timesteps"] == 15
    assert stored.state["actions"].shape == (5, 3)


def test_a_complete_run_resumes_to_itself(make_config, uninterrupted, tmp_path):
    path = train(make_config(), tmp_path)
    before = (path / "manifest.json").read_bytes()
    assert train(make_config(), tmp_path, resume=True) == path
    assert (path / "manifest.json").read_bytes() == before


def test_the_seeds_of_training_and_of_evaluation_never_meet(make_config):
    config = make_config()
    training_seeds = {seed for u in range(300) for seed in config.env_seeds(0, u, 8)}
    assert len(training_seeds) == 2400
    assert not training_seeds & set(config.env_seeds(1, 0, 64))


def test_a_run_is_not_overwritten_nor_mixed_with_another(make_config, tmp_path):
    train(make_config(total_timesteps=15), tmp_path / "a")
    with pytest.raises(ConfigError, match="holds a run already"):
        train(make_config(total_timesteps=15), tmp_path / "a")
    with pytest.raises(ConfigError, match="a run with seed 5; asked for 6"):
        train(make_config(total_timesteps=15, seed=6), tmp_path / "a", resume=True)
    with pytest.raises(ConfigError, match="batch_size must divide"):
        make_config(hyperparameters={"batch_size": 4})
    with pytest.raises(ValueError, match="no checkpoint that can be read"):
        train(make_config(), tmp_path / "b", resume=True)
    assert not (tmp_path / "b").exists()


def test_a_configuration_survives_json(make_config):
    for algorithm in ("ppo", "recurrent_ppo", "dqn"):
        config = make_config(algorithm)
        assert TrainingConfig.from_plain(config.plain()) == config


# --- the command


def command(monkeypatch, *arguments):
    """The exit code of train.py in this process."""
    monkeypatch.syspath_prepend(str(ROOT))
    sys.modules.pop("train", None)
    import train as script

    return script.main(list(arguments))


ARGUMENTS = (
    "--env=GlobalLocalization-v0",
    "--total-timesteps=60",
    "--seed=1",
    "--set=env.map=rooms(width=6,height=5,resolution=0.1):0",
    "--set=env.max_episode_steps=7",
    "--set=env.belief.kind=histogram",
    "--set=env.belief.cell_size=0.5",
    "--set=env.belief.headings=12",
    "--set=n_envs=3",
    "--set=n_steps=5",
    "--set=batch_size=5",
    "--set=evaluate_every=0",
)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_signals_have_their_exit_codes(tmp_path, monkeypatch, capsys, number, code):
    with monkeypatch.context() as patched:
        at_step(patched, 7, send(number))
        assert command(patched, *ARGUMENTS, "--out", str(tmp_path / "run")) == code
    said = capsys.readouterr().err.strip()
    assert "--resume" in said
    assert "\n" not in said
    assert command(monkeypatch, *ARGUMENTS, "--out", str(tmp_path / "run"), "--resume") == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--env", "Nowhere-v0"], "did you mean|unknown name"),
        (["--algo", "pppo"], "did you mean 'ppo'"),
        (["--set", "n_stepps=3"], "did you mean 'n_steps'"),
        (["--set", "n_epochs=0"], "n_epochs must be an integer"),
        (["--set", "learning_rate=nan"], "learning_rate"),
        (["--set", "env.nothing=3"], "unknown name 'nothing'"),
        (["--set", "env.actions=continuous"], "discrete actions"),
        (["--total-timesteps", "0"], "total_timesteps"),
        (["--imitate", "nobody"], "unknown name 'nobody'"),
        (["--resume"], "no checkpoint"),
    ],
)
def test_what_is_refused_ends_in_one_line_and_writes_nothing(
    tmp_path, monkeypatch, capsys, arguments, said
):
    out = tmp_path / "run"
    assert command(monkeypatch, *ARGUMENTS, *arguments, "--out", str(out)) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert any(part in error for part in said.split("|")), error
    assert not out.exists()


# --- kill -9


def _train_quietly(config, folder, resume):
    warnings.simplefilter("ignore")
    train(config, folder, resume=resume)
    os._exit(0)


def kill_and_resume(config, folder, n_kills, seed):
    """SIGKILL at random moments; returns how many came before the run was complete."""
    # Where torch has a GPU, its threads keep a forked child from learning.
    context = multiprocessing.get_context("spawn" if torch.cuda.is_available() else "fork")
    rng, killed = np.random.default_rng(seed), 0
    while True:
        there = (folder / CHECKPOINTS / "latest").exists()
        child = context.Process(target=_train_quietly, args=(config, folder, there))
        child.start()
        if killed < n_kills:
            while child.is_alive() and not (folder / CHECKPOINTS).exists():
                time.sleep(0.01)
            time.sleep(float(rng.uniform(0.0, 0.6)))
            child.kill()
        child.join()
        if child.exitcode == 0:
            return killed
        assert child.exitcode == -signal.SIGKILL
        killed += 1
        if (folder / CHECKPOINTS / "latest").exists():
            latest_checkpoint(folder / CHECKPOINTS)


@pytest.mark.parametrize("n_kills", [2, pytest.param(40, marks=pytest.mark.slow)])
def test_kill_9_at_any_moment_leaves_a_checkpoint_to_go_on_with(
    make_config, uninterrupted, tmp_path, n_kills
):
    """A checkpoint at every update, so that many kills come while one is written."""
    config = make_config(total_timesteps=15 * 8 * n_kills, checkpoint_every=1)
    killed = kill_and_resume(config, tmp_path, n_kills, seed=n_kills)
    assert killed >= 1
    path, _ = latest_checkpoint(tmp_path / CHECKPOINTS)
    assert path.name == f"step-{config.total_timesteps:012d}"
    assert digest(path) == uninterrupted(config)
    kept = sorted(p.name for p in (tmp_path / CHECKPOINTS).glob("*") if p.is_dir())
    assert len(kept) == 2


def test_a_second_signal_ends_the_process_at_once(monkeypatch):
    codes = []
    monkeypatch.setattr(training.os, "_exit", codes.append)
    stop = training.Stop()
    stop(signal.SIGTERM, None)
    assert codes == []
    stop(signal.SIGINT, None)
    assert codes == [130]
