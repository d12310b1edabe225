"""What is exported plays as what was trained, without torch."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
import torch

from activeloc.agents import make_agent, onnx_policy
from activeloc.agents.evaluation import Sweep
from activeloc.agents.sb3 import export
from activeloc.agents.sb3.algorithms import build_model, training_env
from activeloc.agents.sb3.checkpoint import find_checkpoint
from activeloc.agents.sb3.configuration import TrainingConfig
from activeloc.agents.sb3.export import Logits, export_checkpoint, onnx_of
from activeloc.agents.sb3.training import load_policy, train
from activeloc.cli import main
from activeloc.errors import CheckpointError, ConfigError
from activeloc.maps import MapSource

ENV = "activeloc/GlobalLocalization-v0"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run and its exported policy, by algorithm."""
    known = {}

    def of(config):
        if config.algorithm not in known:
            folder = tmp_path_factory.mktemp(config.algorithm)
            train(config, folder / "run")
            size = export_checkpoint(folder / "run", folder / "policy.onnx")
            assert size == (folder / "policy.onnx").stat().st_size
            known[config.algorithm] = folder
        return known[config.algorithm]

    return of


@pytest.mark.parametrize(
    "algorithm",
    ["ppo", *(pytest.param(other, marks=pytest.mark.slow) for other in ("recurrent_ppo", "dqn"))],
)
def test_it_takes_the_actions_that_sb3_takes(make_config, run, home, algorithm):
    """Over whole episodes, so that the memory counts; logits of random observations are compared
    by the export itself."""
    config = make_config(algorithm, total_timesteps=40)
    folder = run(config)
    path = sorted((folder / "run" / "checkpoints").glob("step-*"))[-1]
    _, model = load_policy(path)
    agent = make_agent(f"onnx:{folder / 'policy.onnx'}")
    env = gym.make(ENV, **home)
    taken = []
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        agent.reset(np.random.default_rng(0))
        state, start, over = None, True, False
        while not over:
            wanted, state = model.predict(observation, state, np.array([start]), deterministic=True)
            action = agent.act(observation, env.unwrapped.knowledge)
            assert action == int(wanted)
            taken.append(action)
            observation, _, terminated, truncated, _ = env.step(action)
            start, over = False, terminated or truncated
    assert len(taken) >= 15


def trained(folder):
    """The model that was exported."""
    return load_policy(find_checkpoint(folder / "run"))[1]


def test_a_policy_for_mazes_draws_its_own_view(tmp_path, capsys):
    """The evaluation leaves the costly view out; the policy needs it."""
    rows = {"n_envs": 4, "n_steps": 15, "batch_size": 20, "hidden": [16]}
    changes = {**rows, "evaluate_every": 0, "env": {"observation": {"radius": 4}}}
    config = TrainingConfig.build("activeloc/Maze7-v0", "ppo", changes, total_timesteps=60)
    train(config, tmp_path / "run")
    file = tmp_path / "maze.onnx"
    assert main(["export", str(tmp_path / "run"), "--out", str(file)]) == 0
    assert [*onnx_policy.Network(file.read_bytes()).inputs] == ["depth", "view"]
    with_view = gym.make("activeloc/Maze7-v0", observation={"view": True, "radius": 4})
    without = gym.make("activeloc/Maze7-v0")
    model = trained(tmp_path)
    agent = make_agent(f"onnx:{file}")
    for seed in range(3):
        seen, _ = with_view.reset(seed=seed)
        observation, _ = without.reset(seed=seed)
        assert "view" not in observation
        agent.reset(np.random.default_rng(0))
        came = set()
        for _ in range(10):
            own = {key: seen[key] for key in ("depth", "view")}
            action = agent.act(observation, without.unwrapped.knowledge)
            if seen["view"].tobytes() not in came:
                assert action == int(model.predict(own, deterministic=True)[0])
            came.add(seen["view"].tobytes())
            seen, observation = with_view.step(action)[0], without.step(action)[0]
        assert len(came) > 1


class Ranks(onnx_policy.Network):
    """Ranks actions as the first number observed says."""

    def run(self, inputs):
        first = inputs["depth"][:, :1]
        return [np.concatenate([first, 0.5 + 0.0 * first, 1.0 - first], axis=1)]


def test_what_was_taken_at_an_observation_is_not_taken_there_again(tmp_path, monkeypatch):
    """Until all actions have been; another observation and another episode begin anew."""
    rows = {"n_envs": 4, "n_steps": 15, "batch_size": 20, "hidden": [16]}
    config = TrainingConfig.build("activeloc/Maze7-v0", "ppo", rows, total_timesteps=60)
    file = tmp_path / "maze.onnx"
    file.write_bytes(onnx_of(build_model(config, training_env(config))))
    monkeypatch.setattr(onnx_policy, "Network", Ranks)
    agent = make_agent(f"onnx:{file}")
    env = gym.make("activeloc/Maze7-v0", **config.settings).unwrapped
    env.reset(seed=0)

    def acts(depths):
        seen = {"view": np.zeros((5, 11, 11), np.float32)}
        return [
            agent.act({**seen, "depth": np.array([depth], np.float32)}, env.knowledge)
            for depth in depths
        ]

    for _ in range(2):
        agent.reset(np.random.default_rng(0))
        assert acts([0.9, 0.9, 0.2, 0.9, 0.2, 0.9]) == [0, 1, 2, 2, 1, 0]


def test_logits_equal_torchs_in_any_batch(make_config, run):
    folder = run(make_config("ppo", total_timesteps=40))
    model, content = trained(folder), (folder / "policy.onnx").read_bytes()
    network = onnx_policy.Network(content)
    space = model.observation_space
    assert [*network.inputs] == [*space.spaces]
    rng = np.random.default_rng(4)
    for n in (1, 5, 64):
        given = {k: rng.random((n, *s.shape), dtype=np.float32) for k, s in space.items()}
        tensors = {key: torch.as_tensor(array) for key, array in given.items()}
        with torch.no_grad():
            wanted = model.policy.get_distribution(tensors).distribution.logits
        logits = network.run(given)[0]
        ours = torch.log_softmax(torch.as_tensor(logits), dim=1)
        np.testing.assert_allclose(ours, wanted, atol=1e-5)


def test_an_export_that_differs_is_refused(make_config, run):
    folder = run(make_config("ppo", total_timesteps=40))
    model, content = trained(folder), (folder / "policy.onnx").read_bytes()
    module = Logits(model.policy, [*model.observation_space.spaces])
    export.check_equal(module, content, model.observation_space)
    with torch.no_grad():
        model.policy.action_net.bias[1] += 1e-4
    with pytest.raises(CheckpointError, match="differs from torch's"):
        export.check_equal(module, content, model.observation_space)


def test_the_file_says_nothing_of_where_it_was_made(make_config, run):
    content = (run(make_config("ppo", total_timesteps=40)) / "policy.onnx").read_bytes()
    assert b".py" not in content
    assert b"stack_trace" not in content


def test_it_plays_in_an_evaluation(make_config, run, home, tmp_path, capsys):
    file = run(make_config("ppo", total_timesteps=40)) / "policy.onnx"
    settings = [f"--set={key}={value}" for key, value in flat(home)]
    code = main(
        [
            "evaluate",
            f"--agents=random,onnx:{file}",
            f"--map={home['map']}",
            "--episodes=2",
            "--steps=5",
            f"--out={tmp_path / 'out'}",
            *settings,
        ]
    )
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "policy.onnx" in (tmp_path / "out" / "episodes.csv").read_text()


def flat(home):
    for name in ("belief", "observation"):
        yield from ((f"{name}.{key}", value) for key, value in home[name].items())


def test_the_command_exports_the_best_of_a_run(make_config, run, tmp_path, capsys):
    folder = run(make_config("ppo", total_timesteps=40))
    out = tmp_path / "again.onnx"
    assert main(["export", str(folder / "run"), "--out", str(out)]) == 0
    assert "MB" in capsys.readouterr().out
    assert out.read_bytes() == (folder / "policy.onnx").read_bytes()
    assert main(["export", str(tmp_path), "--out", str(out)]) == 2
    assert "no checkpoint here" in capsys.readouterr().err
    assert main(["export", str(folder / "run"), "--out", str(tmp_path / "a.pt")]) == 2


def test_two_files_are_two_agents_to_a_sweep(make_config, run):
    ours = run(make_config("ppo", total_timesteps=40)) / "policy.onnx"
    name = f"onnx:{ours}"
    sweep = Sweep(ENV, MapSource.parse("rooms:0"), {name: {}}, {})
    described = sweep.identity()["agents"][name]
    assert len(described["sha256"]) == 64
    assert described["type"] == "OnnxAgent"
    with pytest.raises(CheckpointError, match="sha256"):
        make_agent(name, {"sha256": "0" * 64})


def test_refusals(make_config, run, tmp_path):
    file = run(make_config("ppo", total_timesteps=40)) / "policy.onnx"
    (tmp_path / "cut.onnx").write_bytes(file.read_bytes()[:500])
    for name, said in [("none.onnx", "no such file"), ("cut.onnx", "no ONNX network")]:
        with pytest.raises(CheckpointError, match=said):
            make_agent(f"onnx:{tmp_path / name}")
    agent = make_agent(f"onnx:{file}")
    env = gym.make(ENV, map="rooms:0", belief={"kind": "particles", "n_min": 50, "n_max": 50})
    observation, _ = env.reset(seed=0)
    agent.reset(np.random.default_rng(0))
    with pytest.raises(ConfigError, match="was trained for"):
        agent.act(observation, env.unwrapped.knowledge)
    with pytest.raises(ConfigError, match="needs 'belief' observed"):
        agent.act({"map": observation["map"]}, env.unwrapped.knowledge)
    with pytest.raises(ConfigError, match="no trained policy comes with the package"):
        make_agent("ppo", env="activeloc/PositionTracking-v0")
    with pytest.raises(ConfigError, match="did you mean"):
        make_agent("greddy")


def test_a_packaged_policy_is_found_by_the_environments_id(make_config, run, tmp_path, monkeypatch):
    content = (run(make_config("ppo", total_timesteps=40)) / "policy.onnx").read_bytes()
    (tmp_path / "policies").mkdir()
    (tmp_path / "policies" / "GlobalLocalization-v0.ppo.onnx").write_bytes(content)
    monkeypatch.setattr(onnx_policy.resources, "files", lambda package: tmp_path)
    assert make_agent("ppo", env=ENV).file.endswith("GlobalLocalization-v0.ppo.onnx")
    with pytest.raises(ConfigError, match="there are: GlobalLocalization-v0"):
        make_agent("ppo", env="activeloc/KidnappedRobot-v0")


def test_playing_needs_no_torch(make_config, run):
    file = run(make_config("ppo", total_timesteps=40)) / "policy.onnx"
    code = (
        "import sys; from activeloc.agents import make_agent; "
        f"make_agent({f'onnx:{file}'!r}); "
        "assert 'onnxruntime' in sys.modules; sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
