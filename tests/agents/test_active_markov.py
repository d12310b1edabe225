"""Active Markov localization: what it walks to, by which way, and when it gives a walk up."""

import itertools
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401  (registers the ids)
from activeloc.agents import ActiveMarkovAgent
from activeloc.agents.active_markov import Option, command_of
from activeloc.agents.commands import FORWARD, LEFT, RIGHT, action_for
from activeloc.agents.imagination import Imagined, Plan, expected_gain
from activeloc.beliefs.histogram import HistogramBelief, HistogramConfig
from activeloc.envs.actions import Actions
from activeloc.envs.episodes import Knowledge
from activeloc.maps import from_text
from activeloc.motion import MotionModel, MotionNoise, Terrain, move
from activeloc.sensors import BeamModel

NO_NOISE = MotionModel(MotionNoise(), MotionNoise())
ALL_ROUND = BeamModel(beams=4, field_of_view=2 * np.pi, z_max=1.5)
TINY = {"n_min": 200, "n_max": 500}


def believing(grid, masses, *, sensor=None, actions=None, **config):
    """What a robot knows that gives poses ``[(pose, mass), ...]`` some mass: uniform if None."""
    sensor = sensor or BeamModel(beams=3, field_of_view=np.pi / 3.0, z_max=1.5)
    config = {"cell_size": 0.5, "headings": 36, "repetition": float("inf"), **config}
    belief = HistogramBelief(1, HistogramConfig(**config), sensor, NO_NOISE)
    belief.reset(0, grid)
    if masses is not None:
        prior = np.zeros(belief.probabilities(0).shape)
        for pose, mass in masses:
            cell, heading = belief.poses(0).states_of(np.array([pose], dtype=np.float64))
            prior[cell, heading] += mass
        belief.reset(0, grid, prior / prior.sum())
    scan = np.full(len(sensor.bearings), sensor.z_max)
    return Knowledge(belief, 0, actions or Actions(), NO_NOISE, sensor, belief.summarise(0), scan,
                     np.zeros(3), False, 0)  # fmt: skip


def agent_of(**settings):
    agent = ActiveMarkovAgent(**{"samples": 200, "readings": 30, "step_cost": 0.01, **settings})
    agent.reset(np.random.default_rng(0))
    return agent


def chosen(agent, knowledge):
    """The walk that an agent chooses, as its plan says."""
    first = agent.act({}, knowledge)
    moves = {tuple(command_of(knowledge.actions, m)): m for m in (LEFT, RIGHT, FORWARD)}
    walk = [moves[tuple(command)] for command, times in agent.plan.walk for _ in range(times)]
    assert walk == [first, *agent._walk]
    return walk


def walked(grid, pose, walk, actions=None):
    """Poses ``(n + 1, 3)`` on a walk without noise, and how far short each move fell [m]."""
    terrain, poses, short = Terrain(grid, NO_NOISE.radius), [np.array([pose], dtype=np.float64)], []
    for step in walk:
        command = command_of(actions or Actions(), step)
        reached, carried_out = move(terrain, poses[-1], command)
        poses.append(reached)
        short.append(command[1] - carried_out[0, 1])
    return np.concatenate(poses), np.array(short)


# --- targets


def corridor(niche=None):
    """15 m of corridor, 1.5 m wide, with a niche of a square metre in its upper wall or without."""
    lines = ["#" * 32] * 3 + ["#" + "." * 30 + "#"] * 3 + ["#" * 32]
    if niche is not None:
        col = round(niche / 0.5)
        lines[1:3] = ["#" * col + ".." + "#" * (30 - col)] * 2
    return from_text("\n".join(lines), resolution=0.5, name="corridor")


def lost_in(grid, heading=0.0):
    """Either 6 m or 9.5 m along the corridor, heading east; beams to all four sides."""
    poses = itertools.product((6.25, 9.75), (1.25,), (heading - 0.05, heading + 0.05))
    return believing(grid, [(p, 0.25) for p in poses], sensor=ALL_ROUND, likelihood_power=1.0)


@pytest.mark.parametrize(("niche", "west"), [(4.0, True), (8.0, False)])
def test_it_walks_to_where_the_hypotheses_differ(niche, west):
    """The niche is two metres from the first place: behind it, or ahead; nothing else differs."""
    walk = chosen(agent_of(distances=(2.0,), bearings=2), lost_in(corridor(niche)))
    assert walk[-4:] == [FORWARD] * 4
    assert (len(walk) == 10) == west
    assert set(walk[:-4]) <= {LEFT, RIGHT}


@pytest.mark.parametrize(
    ("niche", "heading", "turn"),
    [
        (4.0, np.pi / 2, LEFT),
        (8.0, np.pi / 2, RIGHT),
        (4.0, -np.pi / 2, RIGHT),
        (8.0, -np.pi / 2, LEFT),
    ],
)
def test_it_turns_to_the_side_where_they_differ(niche, heading, turn):
    agent = agent_of(distances=(2.0,), bearings=4)
    assert chosen(agent, lost_in(corridor(niche), heading)) == [turn] * 3 + [FORWARD] * 4


def test_it_takes_the_cheaper_of_two_ways_that_tell_nothing():
    agent = agent_of(distances=(2.0,), bearings=2)
    assert chosen(agent, lost_in(corridor())) == [FORWARD] * 4


def test_it_asks_what_a_way_costs():
    agent = agent_of(distances=(2.0,), bearings=2, step_cost=1.0)
    assert chosen(agent, lost_in(corridor(4.0))) == [FORWARD] * 4


TWO_ROOMS = from_text(
    "\n".join(
        [
            "#" * 32,
            "#" + "." * 30 + "#",
            "#" + "." * 30 + "#",
            "#" + "." * 30 + "#",
            "####..#####" + "#" * 10 + "####..#####",
            "#.........#" + "#" * 10 + "#.........#",
            "#.........#" + "#" * 10 + "#.........#",
            "#.........#" + "#" * 10 + "#.........#",
            "#" * 32,
        ]
    ),
    resolution=0.5,
    name="two rooms",
)  # The one opens 1.5 m from the left end of the corridor, the other 2 m from the right one.


@pytest.mark.parametrize("heading", [0.26, 0.26 - np.pi])
def test_of_two_like_rooms_it_leaves_by_the_door(heading):
    """Inside, nothing tells them apart; straight on there are walls."""
    poses = [(x, 1.25, heading) for x in (4.25, 14.75)]
    masses = [(pose, 0.5) for pose in poses]
    knowledge = believing(TWO_ROOMS, masses, likelihood_power=1.0, cell_size=0.1)
    walk = chosen(agent_of(bearings=12), knowledge)
    for pose in poses:
        places, short = walked(TWO_ROOMS, pose, walk)
        assert places[-1, 1] > 2.5
        assert short.max() < 0.25


def test_what_it_expects_is_the_gain_of_its_walk():
    """As the planners' own estimate says of the same commands, with many samples and readings."""
    knowledge = lost_in(corridor(8.0))
    agent = agent_of(distances=(2.0,), bearings=2, samples=400, readings=200)
    chosen(agent, knowledge)
    rng = np.random.default_rng(1)
    there = Imagined.here(knowledge, 400, rng)
    for command, times in agent.plan.walk:
        there = there.after(knowledge, command, rng, times, given_up=True)
    expected = expected_gain(knowledge, there, 200, rng)
    assert expected > 0.3
    assert agent.plan.expected_gain == pytest.approx(expected, abs=0.1)


# --- ways


def test_it_does_not_take_a_way_that_was_refused():
    knowledge = lost_in(corridor(8.0))
    assert knowledge.belief.place(0).refuse()
    walk = chosen(agent_of(distances=(2.0,), bearings=2), knowledge)
    assert walk.index(FORWARD) > 0


def test_it_does_not_take_a_way_that_it_sees_blocked():
    """Straight on is the better way; the belief knows nothing of what stands there."""
    knowledge = lost_in(corridor(8.0))
    agent, ahead = agent_of(distances=(2.0,), bearings=2), int(np.abs(ALL_ROUND.bearings).argmin())
    assert chosen(agent, knowledge)[0] == FORWARD
    knowledge.scan[ahead] = 0.6
    agent = agent_of(distances=(2.0,), bearings=2)
    assert agent.act({}, knowledge) != FORWARD
    places, _ = walked(corridor(8.0), (6.25, 1.25, 0.0), [*chosen(agent_of(), knowledge)])
    assert np.hypot(*(places[:, :2] - [6.85, 1.25]).T).min() > 0.15


def test_it_remembers_what_stopped_it():
    """After a turn away from an obstacle that is on no map, it does not turn back into it."""
    knowledge, agent = lost_in(corridor(8.0)), agent_of(distances=(2.0,), bearings=2)
    assert agent.act({}, knowledge) == FORWARD
    agent.act({}, replace(knowledge, touched=True, step=1))
    agent._walk.clear()
    walk = chosen(agent, knowledge)
    places, _ = walked(corridor(8.0), (6.25, 1.25, 0.0), walk)
    assert np.hypot(*(places[:, :2] - [6.45, 1.25]).T).min() > 0.15
    agent._memory = type(agent._memory)(1, 1)
    agent._walk.clear()
    assert agent.act({}, knowledge) == FORWARD


@pytest.mark.parametrize("step_cost", [0.01, 1.0])
def test_an_action_is_worth_the_best_walk_that_begins_with_it(step_cost):
    """On patrol too: at 1 nat a step nothing pays."""
    knowledge, settings = lost_in(corridor(8.0)), {"bearings": 6, "step_cost": step_cost}
    values = agent_of(**settings).action_values({}, knowledge)
    agent = agent_of(**settings)
    agent._memory.follow(knowledge)
    options = agent._options(knowledge)
    pays = max(agent._utility(option) for option in options) > 0.0
    assert pays == (step_cost < 1.0)
    worths = [agent._utility(o) for o in options] if pays else agent._novelties(options)
    for action in (LEFT, RIGHT, FORWARD):
        begun = [w for w, o in zip(worths, options, strict=True) if o.walk[0] == action]
        assert values[action] == max(begun, default=-np.inf)
    assert agent_of(**settings).act({}, knowledge) == values.argmax()
    knowledge.belief.place(0).refused[:] = True
    np.testing.assert_array_equal(agent_of().action_values({}, knowledge), [0, -np.inf, -np.inf])


HALL = from_text("########\n#......#\n#......#\n#...##.#\n########", resolution=0.5, name="hall")


def test_it_discounts_a_way_that_may_be_blocked():
    """A gain that is trusted only as far as the way is open counts that share of itself."""
    option = Option([FORWARD] * 3, np.zeros(2), Plan((), 0.0), 2.0, 0.25)
    assert agent_of(certainty_share=1.0)._utility(option) == pytest.approx(2.0 * 0.25 - 0.03)
    assert agent_of(certainty_share=0.4)._utility(option) == pytest.approx(2.0 * 0.7 - 0.03)


def test_an_option_says_how_likely_its_way_is_open():
    """Of two poses, the one has a wall half a metre ahead, the other has none."""
    poses = [(7.25, 1.25, 0.0), (15.25, 1.25, 0.0)]
    knowledge = believing(corridor(), [(pose, 0.5) for pose in poses])
    agent = agent_of(distances=(1.5,), bearings=1)
    (option,) = agent._options(knowledge)
    assert option.walk == [FORWARD] * 3
    assert option.p_open == pytest.approx(0.5, abs=0.01)


def test_what_an_obstacle_has_stopped_stays_as_it_is():
    """Of two poses, a wall stops the one; the other drives, turns left and drives on."""
    poses = [(7.25, 1.25, 0.0), (15.25, 1.25, 0.0)]
    knowledge = believing(corridor(), [(pose, 0.5) for pose in poses])
    rng, turn, drive = np.random.default_rng(0), np.array([0.5, 0, 0]), np.array([0, 0.5, 0])
    first = Imagined.here(knowledge, 100, rng).after(knowledge, drive, rng)
    there = first.after(knowledge, turn, rng, 2, given_up=True)
    assert 20 < first.stopped.sum() < 80
    expected = np.where(first.stopped[:, None], 0.0, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(there.poses - first.poses, expected, atol=1e-12)
    assert there.place_if_free.heading == pytest.approx(1.0)
    assert there.place_if_stopped.heading == 0.0
    onwards = first.after(knowledge, turn, rng, 2)
    np.testing.assert_allclose(onwards.poses - first.poses, [[0.0, 0.0, 1.0]] * 100, atol=1e-12)
    assert onwards.place_if_stopped.heading == pytest.approx(1.0)


@pytest.mark.parametrize("actions", [(0.1, 0.02), (0.5, 0.5), (2.0, 3.0), (np.pi, 100.0)])
@pytest.mark.parametrize("distances", [(1.0, 2.0, 4.0), (0.01,), (0.0,), (900.0,)])
def test_it_never_chooses_an_empty_walk(distances, actions):
    for masses in (None, [((0.75, 1.75, 0.1), 1.0)]):
        knowledge = believing(HALL, masses, actions=Actions("discrete", *actions))
        agent = ActiveMarkovAgent(distances, 7, samples=50, readings=4)
        agent.reset(np.random.default_rng(0))
        assert agent.act({}, knowledge) in {LEFT, RIGHT, FORWARD}
        knowledge.belief.place(0).refused[:] = True
        agent.reset(np.random.default_rng(0))
        assert agent.act({}, knowledge) in {LEFT, RIGHT}


# --- patrol


def test_where_nothing_pays_it_goes_where_it_has_not_been():
    agent = agent_of(patrol_cost=0.1)
    agent._memory.follow(lost_in(corridor()))
    agent._memory.follow(replace(lost_in(corridor()), u=np.array([0.0, 2.0, 0.0]), step=1))

    def option(x, y, steps, p_open=1.0):
        return Option([FORWARD] * steps, np.array([x, y]), Plan((), 0.0), 0.0, p_open)

    options = [option(2, 0, 4), option(-2, 0, 4), option(-1, 1, 4), option(0, 2, 4, 0.5)]
    np.testing.assert_allclose(agent._novelties(options), [1.6, -0.4, np.sqrt(2) - 0.4, 0.6])


def leaves_its_room(seed):
    """Whether a robot that knows where it is, in the lower room of two, goes to the upper one."""
    env = gym.make("activeloc/PositionTracking-v0", belief={"kind": "particles", **TINY}).unwrapped
    start = {"grid": TWO_ROOMS, "pose": np.array([4.25, 1.25, 0.0])}
    observation, _ = env.reset(seed=seed, options=start)
    agent = agent_of(step_cost=0.05)
    for _ in range(120):
        observation = env.step(agent.act(observation, env.knowledge))[0]
        if env.knowledge.summary.estimate[1] > 2.5:
            return True
    return False


def test_a_robot_that_is_sure_leaves_its_room():
    """It has nothing to learn where it is; the door is narrow, and found by chance."""
    assert sum(leaves_its_room(seed) for seed in range(6)) >= 3


# --- carrying it out


def scripted(monkeypatch, *walks):
    """An agent that chooses these walks, one after the other."""
    agent, left = agent_of(), iter([*map(list, walks)])
    monkeypatch.setattr(agent, "_choose", lambda knowledge: next(left))
    return agent


def told(knowledge, step):
    """The same knowledge after a move that was carried out to the letter."""
    return replace(knowledge, u=command_of(knowledge.actions, step))


def test_it_walks_all_the_way_unless_an_obstacle_ends_it(monkeypatch):
    knowledge, agent = lost_in(corridor()), scripted(monkeypatch, [0, 2], [1, 2, 2], [0])
    steps = [agent.act({}, knowledge)]
    for touched in (0, 0, 0, 1):
        steps.append(agent.act({}, replace(told(knowledge, steps[-1]), touched=bool(touched))))
    assert steps == [0, 2, 1, 2, 0]
    assert agent._walk == []


@pytest.mark.parametrize("u", [(0.0, 0.5, 0.0), (-np.pi / 6, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_it_gives_up_a_walk_that_it_is_not_on(monkeypatch, u):
    """It was told to turn left; the odometry says that it did something else."""
    agent, knowledge = scripted(monkeypatch, [0, 0, 0, 2], [1]), lost_in(corridor())
    assert agent.act({}, knowledge) == 0
    assert agent.act({}, replace(knowledge, u=np.array([np.pi / 6 + 0.2, 0.03, 0.0]))) == 0
    assert agent.act({}, replace(knowledge, u=np.array(u))) == 1


@pytest.mark.parametrize(("ahead", "then"), [(0.44, 1), (0.46, 2), (np.nan, 2), (np.inf, 2)])
def test_it_gives_up_a_drive_that_it_sees_blocked(monkeypatch, ahead, then):
    """Half a drive and its own radius are .45 m."""
    agent, knowledge = scripted(monkeypatch, [0, 2], [1]), lost_in(corridor())
    agent.act({}, knowledge)
    knowledge.scan[np.abs(ALL_ROUND.bearings).argmin()] = ahead
    assert agent.act({}, told(knowledge, 0)) == then


@pytest.mark.parametrize("kind", ["discrete", "continuous"])
def test_its_choices_follow_from_its_seed(kind):
    def steps(seed):
        env = gym.make("activeloc/GlobalLocalization-v0", map=TWO_ROOMS, actions=kind,
                       belief={"kind": "particles", **TINY}).unwrapped  # fmt: skip
        observation, _ = env.reset(seed=3)
        agent = ActiveMarkovAgent(samples=50, readings=4)
        agent.reset(np.random.default_rng(seed))
        for _ in range(25):
            step = agent.act(observation, env.knowledge)
            observation = env.step(step)[0]
            yield np.asarray(step).tolist()

    first = [*steps(0)]
    assert first == [*steps(0)]
    assert any(first != [*steps(seed)] for seed in range(1, 4))
    known = [np.asarray(action_for(Actions(kind), m)).tolist() for m in (LEFT, RIGHT, FORWARD)]
    assert all(step in known for step in first)
