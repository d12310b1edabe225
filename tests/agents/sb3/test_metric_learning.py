"""What learning on metric maps adds: keys, mirroring, other buildings, views drawn by policies."""

from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest

from activeloc.agents.onnx_policy import OnnxAgent
from activeloc.agents.sb3.algorithms import build_model, training_env
from activeloc.agents.sb3.batches import Batch, can_mirror, mirrored
from activeloc.agents.sb3.configuration import TrainingConfig
from activeloc.agents.sb3.export import onnx_of
from activeloc.agents.sb3.features import keys_for
from activeloc.agents.sb3.imitation import ImitationConfig, gather, labels_of_agent
from activeloc.agents.sb3.training import Keeper, Stop, held_out_evaluation
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.beliefs.metric_view import MetricView
from activeloc.grid import OccupancyGrid
from activeloc.maps import from_text
from activeloc.motion import MotionModel
from activeloc.sensors import BeamModel

ID = "activeloc/GlobalLocalization-v0"
MAP = "rooms(width=6,height=5,resolution=0.1):1"
SMALL = {"map": MAP, "belief": {"kind": "histogram", "cell_size": 0.4, "headings": 36}}
YARD = from_text(
    "##############\n#............#\n#..##........#\n#..#.....#####\n#........#...#\n##############",
    resolution=1.0,
)


@pytest.fixture
def small():
    changes = {"n_envs": 2, "n_steps": 8, "batch_size": 16, "hidden": [16], "env": SMALL}
    return TrainingConfig.build(ID, "ppo", changes, total_timesteps=16)


def test_a_policy_reads_what_is_seen_from_the_robot(small):
    env = training_env(small)
    assert sorted(env.keys) == ["place", "scalars", "scan", "view", "ways"]
    space = env.envs.single_observation_space
    assert sorted(keys_for(space, "world")) == ["belief", "map", "place", "scalars", "scan"]


def seen(grid, poses, scan, refused):
    """A labelled observation of a belief that holds these poses."""
    sensor = BeamModel(beams=5)
    belief = HistogramBelief(1, HistogramConfig(cell_size=0.25), sensor, MotionModel())
    belief.reset(0, grid)
    prior = np.zeros_like(belief.probabilities(0))
    cell, heading = belief.poses(0).states_of(np.array(poses))
    np.add.at(prior, (cell, heading), 1.0 / len(poses))
    belief.reset(0, grid, prior)
    place = belief.place(0)
    place.read(np.deg2rad([0.0, 30.0]) * (1 if refused > 0 else -1))
    place.refused[place.sector(np.array([refused]))] = True
    parts = MetricView(belief, sensor, 4).draw(0)
    parts |= {"scan": scan, "scalars": np.array([0.5, 0.1, 0.0, 0.2 * np.sign(refused), 0.3])}
    observations = {key: np.asarray(part, np.float32)[None] for key, part in parts.items()}
    return observations


def test_a_mirrored_observation_is_that_of_the_mirrored_world():
    """Map, belief, scan and memory in a mirror along x."""
    other = OccupancyGrid(YARD.cells[::-1], 1.0)
    poses = [(1.875, 1.375, 0.5672), (5.125, 3.125, -1.7890), (8.375, 1.875, 2.6616)]
    flipped = [(x, 6.0 - y, -theta) for x, y, theta in poses]
    scan = np.array([0.1, 0.4, 0.9, 1.0, -1.0])
    one = seen(YARD, poses, scan, np.pi / 3)
    two = seen(other, flipped, scan[::-1], -np.pi / 3)
    batch = Batch(one, np.array([[3.0, 1.0, 2.0]], np.float32), np.ones(1, np.float32))
    assert can_mirror(batch)
    swapped = mirrored(batch)
    assert swapped.values.tolist() == [[1.0, 3.0, 2.0]]
    assert set(swapped.observations) == set(two)
    for key, part in swapped.observations.items():
        # A ray along a wall may fall to either side of it.
        assert np.abs(part - two[key]).mean() < 0.01, key
        assert np.abs(one[key] - two[key]).mean() > 0.02, key
    back = mirrored(swapped)
    for key, part in back.observations.items():
        np.testing.assert_array_equal(part, one[key])


def test_a_metric_planner_labels_by_the_value_of_each_action(small):
    env = training_env(small)
    labels = labels_of_agent("glance", env_id=ID)
    config = ImitationConfig(labels=12, noise=(0.5,))
    rows = list(gather(env, labels, config, np.random.default_rng(0)))
    values = np.concatenate([batch.values for batch in rows])
    assert values.shape[1] == 3
    assert len(np.unique(values.argmax(axis=1))) > 1
    assert (np.isfinite(values).sum(axis=1) > 1).any()


def test_held_out_buildings_are_none_of_those_of_training(tmp_path):
    config = TrainingConfig.build(ID, "ppo", {}, total_timesteps=16)
    env = training_env(config, 1)
    keeper = Keeper(config, env, tmp_path, Stop(), None)
    held_out = held_out_evaluation(config, keeper).held_out
    theirs = held_out.envs.config.map.seeds
    ours = env.envs.config.map.seeds
    assert len(theirs) >= 4
    assert not set(theirs) & set(ours)


def test_on_a_map_of_ones_own_the_evaluation_is_there_too(small, tmp_path):
    keeper = Keeper(small, training_env(small), tmp_path, Stop(), None)
    assert held_out_evaluation(small, keeper).held_out.envs.config.map.spec == MAP


@pytest.mark.parametrize("kind", ["histogram", "particles"])
def test_a_policy_draws_the_view_itself(small, kind, tmp_path):
    """The same actions whether the environment shows the view or not, and with either belief."""
    file = tmp_path / "policy.onnx"
    file.write_bytes(onnx_of(build_model(small, training_env(small))))
    belief = SMALL["belief"] if kind == "histogram" else {"kind": kind, "n_start": 2_000}
    chosen = []
    for shows in (False, True):
        env = gym.make(ID, map=MAP, belief=belief, observation={"view": shows})
        agent = OnnxAgent(str(file))
        agent.reset(np.random.default_rng(0))
        observation, _ = env.reset(seed=1)
        actions = []
        for _ in range(10):
            actions.append(agent.act(observation, env.unwrapped.knowledge))
            observation = env.step(actions[-1])[0]
        chosen.append(actions)
    assert chosen[0] == chosen[1]


class Scripted:
    """Stands for a network: logits one after the other."""

    inputs: ClassVar[dict[str, list[int]]] = {}

    def __init__(self, rows):
        self.rows = [np.array([row], np.float32) for row in rows]

    def memory(self):
        return {}

    def run(self, inputs):
        return [self.rows.pop(0)]


def test_a_turn_is_not_taken_back_before_a_drive(small, tmp_path):
    file = tmp_path / "policy.onnx"
    file.write_bytes(onnx_of(build_model(small, training_env(small))))
    agent = OnnxAgent(str(file))
    agent.reset(np.random.default_rng(0))
    env = gym.make(ID, map=MAP, belief=SMALL["belief"])
    observation, _ = env.reset(seed=0)
    left, right, ahead = [3.0, 2.0, 1.0], [2.0, 3.0, 1.0], [2.0, 1.0, 3.0]
    # To and fro; ahead, which allows both turns again; once around to the right, and no further.
    agent._network = Scripted([left, right, left, ahead, right, left, right, *[right] * 10, right])
    chosen = [agent.act(observation, env.unwrapped.knowledge) for _ in range(18)]
    assert chosen == [0, 0, 0, 2, *[1] * 12, 2, 1]
