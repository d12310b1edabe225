"""The three problems: when a robot has declared, whether it was right, who carried it off."""

import itertools

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401  (registers the ids)
from activeloc.beliefs import Summary
from activeloc.beliefs.settings import HistogramConfig, ParticleConfig
from activeloc.envs.episodes import EpisodeConfig, Episodes
from activeloc.envs.rewards import RewardWeights
from activeloc.envs.tasks import Task, Watch, carried, is_near, pose_error
from activeloc.errors import ActionError, ConfigError, MapError
from activeloc.maps import from_text
from activeloc.motion import move

MAP = "rooms(width=6,height=5,resolution=0.1):1"
HALL = from_text(
    """
####################
#........#.........#
#..................#
#...............#..#
#........#......#..#
####..####......#..#
#........#.........#
#........#......####
####################
""",
    resolution=0.4,
    origin=(1.0, -3.0),
    name="hall",
)
BELIEFS = {
    "histogram": {"kind": "histogram", "cell_size": 0.25, "headings": 36},
    "particles": {"kind": "particles", "n_min": 1_000, "n_max": 2_000},
}
IDS = sorted(id for id in gym.registry if id.startswith("activeloc/") and "Maze" not in id)
GLOBAL = "activeloc/GlobalLocalization-v0"
TRACKING = "activeloc/PositionTracking-v0"
KIDNAPPED = "activeloc/KidnappedRobot-v0"


class Scripted:
    """A belief that says what a script tells it to: masses, and how far off the estimate is."""

    impossible, leap, within_leap = (), Task().leap, ()

    def __init__(self, episodes, masses, offset=(0.0, 0.0, 0.0), entropies=None):
        self.simulator = episodes.simulator
        self.script = list(masses)
        self.entropies = list(entropies or [2.0] * len(self.script))
        self.offset = np.asarray(offset)

    def reset(self, robot, grid, rng):
        self.step = 0

    def reset_near(self, robot, grid, rng, pose, sigma):
        self.step, self.told, self.sigma = 0, pose, sigma

    def predict(self, robot, u, touched):
        self.step += 1

    def correct(self, robot, scan):
        return -np.inf if self.step in self.impossible else 0.0

    def mass_near(self, robot, pose, radius, angle):
        assert (radius, angle) == (self.leap, np.pi)
        script = self.within_leap or self.script
        return script[min(self.step, len(script) - 1)]

    def summarise(self, robot):
        i = min(self.step, len(self.script) - 1)
        estimate = self.simulator.poses[robot] + self.offset
        return Summary(self.entropies[i], 4.0, estimate, self.script[i])


def scripted(masses, offset=(0.0, 0.0, 0.0), entropies=None, reward=None, seed=0, **task):
    """Episodes of one robot in the hall whose belief follows a script; reset already."""
    config = EpisodeConfig.build({"task": task, "map": HALL, "belief": "particles",
                                  "reward": reward})  # fmt: skip
    episodes = Episodes(config, 1)
    episodes.belief = Scripted(episodes, masses, offset, entropies)
    episodes.belief.leap = config.task.leap
    episodes.reset(0, np.random.default_rng(seed))
    return episodes


def play(episodes, steps):
    """Turn on the spot; the step after which the episode ended, or None."""
    for step in range(1, steps + 1):
        episodes.step(0, 0)
        if episodes.terminated(0):
            return step
    return None


def hall_env(id=GLOBAL, belief="histogram", **settings):
    belief = belief if isinstance(belief, dict) else BELIEFS[belief]
    return gym.make(id, map=HALL, belief=belief, **settings).unwrapped


# --- declarations


@pytest.mark.parametrize(
    ("masses", "hold", "end"),
    [
        ([0.1, 0.96, 0.96, 0.96], 3, 3),
        ([1.0, 0.96, 0.96, 0.96], 3, 3),  # The first scan is no step.
        ([0.1, 0.96, 0.96, 0.94, 0.96, 0.96, 0.96], 3, 6),  # A doubt starts the count anew.
        ([0.1, 0.96, 0.94] * 8, 2, None),
        ([0.1, 0.94, 0.96], 1, 2),
        ([0.1, 0.95], 1, 1),  # At least the confidence.
        ([0.1] + [0.9499] * 9, 1, None),
    ],
    ids=str,
)
def test_a_declaration_takes_confidence_for_some_steps_running(masses, hold, end):
    assert play(scripted(masses, hold=hold), len(masses) - 1) == end


@pytest.mark.parametrize("confidence", [0.5, 0.99])
def test_the_confidence_is_a_setting(confidence):
    masses = [0.0, confidence - 1e-6, confidence, confidence - 1e-6, confidence]
    assert play(scripted(masses, confidence=confidence, hold=1), 4) == 2


NEAR = [(0.49, 0.0, 0.0), (0.0, -0.49, 0.0), (0.35, 0.35, 0.3), (0.0, 0.0, np.deg2rad(-19.9))]
FAR = [(0.51, 0.0, 0.0), (0.0, -0.51, 0.0), (0.36, 0.36, 0.0), (0.0, 0.0, np.deg2rad(20.1)),
       (0.0, 0.0, np.pi), (3.0, 0.0, 0.0)]  # fmt: skip


@pytest.mark.parametrize(
    ("offset", "right"), [*((o, True) for o in NEAR), *((o, False) for o in FAR)], ids=str
)
def test_a_declaration_is_right_if_the_truth_is_near_the_estimate(offset, right):
    episodes = scripted([0.1, 1.0, 1.0], offset, hold=2)
    assert play(episodes, 2) == 2
    info = episodes.info(0)
    assert (info["is_success"], info["wrong"]) == (right, not right)
    assert info["reward_success"] == (1.0 if right else 0.0)
    assert info["reward_wrong"] == (0.0 if right else -1.0)
    assert info["error_m"] == pytest.approx(np.hypot(*offset[:2]))
    assert info["error_rad"] == pytest.approx(min(abs(offset[2]), 2 * np.pi - abs(offset[2])))


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
def test_before_a_declaration_nobody_is_right_or_wrong(offset):
    episodes = scripted([0.1, 1.0, 1.0, 1.0], offset)
    for _ in range(2):
        info = episodes.info(0)
        assert not info["is_success"]
        assert not info["wrong"]
        assert info["reward_success"] == info["reward_wrong"] == 0.0
        episodes.step(0, 0)


def test_impossible_scans_are_counted():
    episodes = scripted([0.5])
    episodes.belief.impossible = (0, 2, 3)
    episodes.reset(0, np.random.default_rng(0))
    counts = [episodes.info(0)["impossible"]]
    for _ in range(4):
        episodes.step(0, 0)
        counts.append(episodes.info(0)["impossible"])
    assert counts == [1, 1, 2, 3, 3]


def test_after_a_declaration_there_is_no_step():
    episodes = scripted([0.1, 1.0], hold=1)
    assert play(episodes, 1) == 1
    before = episodes.info(0)
    with pytest.raises(ActionError, match="ended"):
        episodes.step(0, 0)
    assert episodes.info(0) == before
    episodes.reset(0, np.random.default_rng(1))
    assert not episodes.terminated(0)
    episodes.step(0, 0)


@pytest.mark.parametrize("half_turns", [-3, -1, 1, 3])
def test_an_angle_s_error_is_taken_the_short_way(half_turns):
    estimate = np.array([1.0, 2.0, 3.1])
    truth = np.array([1.3, 1.6, 3.1 + half_turns * np.pi + 0.2])
    metres, radians = pose_error(estimate, truth)
    assert metres == pytest.approx(0.5)
    assert radians == pytest.approx(np.pi - 0.2)


def test_near_means_within_both_bounds():
    assert is_near(0.5, np.deg2rad(20.0))
    assert not is_near(0.5 + 1e-9, 0.0)
    assert not is_near(0.0, np.deg2rad(20.0) + 1e-9)


# --- tracking


def test_tracking_never_ends_and_success_follows_the_error():
    episodes = scripted([1.0], kind="tracking", hold=1)
    for offset in [*NEAR, *FAR, *NEAR]:
        episodes.belief.offset = np.asarray(offset)
        episodes.step(0, 0)
        info = episodes.info(0)
        assert not episodes.terminated(0)
        assert info["is_success"] == (offset in NEAR)
        assert info["wrong"] == (offset in FAR)
        assert info["reward_success"] == info["reward_wrong"] == 0.0


def test_tracking_is_not_wrong_while_it_doubts():
    episodes = scripted([0.94], (3.0, 0.0, 0.0), kind="tracking")
    episodes.step(0, 0)
    info = episodes.info(0)
    assert not info["is_success"]
    assert not info["wrong"]


@pytest.mark.parametrize("belief", BELIEFS)
def test_a_robot_that_is_tracked_still_knows_where_it_is(belief):
    """Sensor and filter share one model, so the error stays small in most episodes."""
    n_right = 0
    for seed in range(20):
        env = hall_env(TRACKING, belief)
        env.reset(seed=seed)
        for action in (0, 0, 2, 2, 0, 2, 1, 2, 2, 0) * 2:
            info = env.step(action)[-1]
        n_right += info["is_success"]
    assert n_right >= 17


@pytest.mark.parametrize("kind", ["tracking", "kidnapped"])
def test_a_known_start_is_known_as_well_as_is_said(kind):
    """The prior's centre strays from the truth by the sigmas; the filter is told the same."""
    offsets = []
    for seed in range(400):
        episodes = scripted([1.0], kind=kind, sigma_xy=0.4, sigma_theta=0.3, seed=seed)
        offsets.append(episodes.belief.told - episodes.simulator.poses[0])
    assert episodes.belief.sigma == (0.4, 0.3)
    spread, error = np.std(offsets, axis=0), 4.0 / np.sqrt(2 * 400)
    np.testing.assert_allclose(spread / [0.4, 0.4, 0.3], 1.0, atol=error)
    np.testing.assert_allclose(np.mean(offsets, axis=0) / [0.4, 0.4, 0.3], 0.0, atol=4 / 20)


@pytest.mark.parametrize("belief", BELIEFS)
def test_how_sure_each_task_starts(belief):
    """A blind sensor leaves the priors to be seen: one pose, or every pose."""
    blind = {"kind": "beam", "w_hit": 0.0, "w_short": 0.0, "w_max": 1.0, "w_rand": 0.0}
    sure = {"sigma_xy": 0.01, "sigma_theta": 0.01}
    entropy = {}
    for id in (GLOBAL, TRACKING, KIDNAPPED):
        task = {"kind": gym.spec(id).kwargs["task"], **sure}
        env = hall_env(id, belief, task=task, sensor=blind)
        entropy[id] = env.reset(seed=1)[1]["entropy_fraction"]
    # 500 particles in some 1500 bins say less than log 1500.
    assert entropy[GLOBAL] == pytest.approx(1.0, abs=1e-6 if belief == "histogram" else 0.25)
    assert max(entropy[TRACKING], entropy[KIDNAPPED]) < 0.3


# --- the kidnapped robot


def test_a_robot_is_carried_off_once_and_is_not_told():
    """The pose after that step owes nothing to the odometry; before and after it does."""
    jumps = []
    for seed in range(30):
        task = {"kind": "kidnapped", "kidnap_first": 4, "kidnap_last": 4}
        episodes = scripted([0.5], seed=seed, **task)
        for step in range(1, 9):
            before = episodes.simulator.poses[0].copy()
            episodes.step(0, 0)
            jump = np.hypot(*(episodes.simulator.poses[0] - before)[:2])
            assert episodes.info(0)["kidnapped"] == (step >= 4)
            assert abs(episodes.episode(0).u[0] - np.pi / 6) < 0.6
            if step == 4:
                jumps.append(jump)
            else:
                assert jump == 0.0
    # Two poses of this hall are 3.7 m apart on the average.
    assert 2.5 < np.mean(jumps) < 5.0
    assert min(jumps) > 0.0


def test_every_step_in_the_span_is_as_likely():
    task = {"kind": "kidnapped", "kidnap_first": 3, "kidnap_last": 6}
    steps = [scripted([0.5], seed=seed, **task).episode(0).kidnap_step for seed in range(400)]
    count = np.bincount(steps, minlength=8)
    assert count.sum() == count[3:7].sum()
    assert np.abs(count[3:7] - 100).max() < 4 * np.sqrt(400 * 0.25 * 0.75)


@pytest.mark.parametrize("id", [GLOBAL, TRACKING])
def test_nobody_else_is_carried_off(id):
    env = hall_env(id, "particles")
    env.reset(seed=2)
    before = env.pose
    for _ in range(20):
        assert not env.step(0)[-1]["kidnapped"]
        if env._episodes.terminated(0):
            env.reset()
            before = env.pose
    np.testing.assert_array_equal(env.pose[:2], before[:2])


@pytest.mark.parametrize(
    ("masses", "end"),
    [
        ([1.0] * 12, None),  # It has never let go: it believes what it believed before.
        ([1.0, 1.0, 0.2] + [1.0] * 9, None),  # A doubt from before it was carried off.
        ([1.0] * 4 + [0.2, 1.0, 1.0, 1.0, 1.0], 7),  # A doubt, then sure for three steps.
        ([1.0] * 6 + [0.2, 0.2, 1.0, 1.0, 1.0], 10),
    ],
    ids=str,
)
def test_a_kidnapped_robot_is_wrong_only_once_it_has_let_go(masses, end):
    task = {"kind": "kidnapped", "kidnap_first": 3, "kidnap_last": 3, "leap": 1e3}
    assert play(scripted(masses, FAR[-1], **task), len(masses) - 1) == end


@pytest.mark.parametrize("belief", BELIEFS)
def test_the_filter_expects_to_be_carried_off_only_where_that_happens(belief):
    kidnapped = hall_env(KIDNAPPED, belief, task={"kind": "kidnapped", "kidnap_leak": 0.02})
    assert kidnapped.reset(seed=0)
    assert kidnapped.knowledge.belief.config.leak == 0.02
    own = hall_env(KIDNAPPED, {**BELIEFS[belief], "leak": 0.1})
    assert own.reset(seed=0)
    assert own.knowledge.belief.config.leak == 0.1
    plain = hall_env(GLOBAL, belief)
    assert plain.reset(seed=0)
    default = {"histogram": HistogramConfig, "particles": ParticleConfig}[belief]()
    assert plain.knowledge.belief.config.leak == default.leak
    assert default.leak <= 1e-3


def mass_at_the_truth(leak, seed):
    """What a robot gives its true pose, 40 steps after it was carried off at the third."""
    task = {"kind": "kidnapped", "kidnap_first": 3, "kidnap_last": 3, "kidnap_leak": leak,
            "hold": 1000}  # fmt: skip
    env = hall_env(KIDNAPPED, {**BELIEFS["histogram"], "leak": leak}, task=task)
    env.reset(seed=seed)
    for action in (2, 0, 0, *(0,) * 12, *(2, 2, 0) * 10):
        env.step(action)
    return env.knowledge.belief.mass_near(0, env.pose)


def test_the_leak_lets_the_belief_recover():
    with_leak = [mass_at_the_truth(1e-3, seed) for seed in range(6)]
    without = [mass_at_the_truth(0.0, seed) for seed in range(6)]
    assert np.median(with_leak) > 0.6
    assert np.median(without) < 0.05


# --- when and where it is carried off


def kidnap_steps(n, limit=40, **task):
    """The step at which each of n robots is carried off; 0 for not within the limit."""
    task = {"kind": "kidnapped", **task}
    steps = []
    for seed in range(n):
        episodes, step = scripted([0.5], seed=seed, **task), 0
        while step < limit and not episodes.info(0)["kidnapped"]:
            episodes.step(0, 0)
            step += 1
        steps.append(step if episodes.info(0)["kidnapped"] else 0)
    return np.array(steps)


def test_a_robot_that_is_never_carried_off_is_not():
    assert not kidnap_steps(20, kidnap="never").any()


def test_a_rate_waits_as_long_as_coins_do():
    """The step is geometric: compared by its mean and by the share carried off at the first."""
    n, rate = 2000, 0.2
    task = Task(kind="kidnapped", kidnap="rate", kidnap_rate=rate)
    steps = np.array([task.kidnap_step(np.random.default_rng(seed)) for seed in range(n)])
    assert steps.min() == 1
    assert steps.mean() == pytest.approx(1 / rate, abs=4 * np.sqrt((1 - rate) / n) / rate)
    share = np.mean(steps == 1)
    assert share == pytest.approx(rate, abs=4 * np.sqrt(rate * (1 - rate) / n))
    played = kidnap_steps(20, kidnap="rate", kidnap_rate=rate)
    assert len(set(played)) > 4
    assert played.max() < 40


def test_until_it_is_carried_off_a_robot_lives_the_same_episode():
    """Never, in a range or at a rate: luck before the kidnapping does not depend on it."""
    seen = {}
    for kidnap in ("never", "range", "rate"):
        task = {"kind": "kidnapped", "kidnap": kidnap, "kidnap_first": 9, "kidnap_last": 9,
                "kidnap_rate": 1e-9}  # fmt: skip
        episodes = scripted([0.5], **task)
        seen[kidnap] = []
        for _ in range(8):
            episodes.step(0, 2)
            seen[kidnap].append(episodes.episode(0).scan.tolist())
    assert seen["never"] == seen["range"] == seen["rate"]


def jump(seed, **task):
    """Where a robot was carried off from and to, at its first step."""
    task = {"kind": "kidnapped", "kidnap_first": 1, "kidnap_last": 1, **task}
    episodes = scripted([0.5], seed=seed, **task)
    before = episodes.simulator.poses[0].copy()
    episodes.step(0, 0)
    return before[:2], episodes.simulator.poses[0, :2].copy()


def test_it_is_carried_at_least_as_far_as_is_said():
    """And where the first place drawn is far enough, it is that place."""
    n_moved = 0
    for seed in range(60):
        start, anywhere = jump(seed)
        same_start, far = jump(seed, kidnap_distance=3.0)
        np.testing.assert_array_equal(start, same_start)
        assert np.hypot(*(far - start)) >= 3.0
        if np.hypot(*(anywhere - start)) >= 3.0:
            np.testing.assert_array_equal(anywhere, far)
        else:
            n_moved += 1
    assert n_moved > 10


def test_far_places_are_uniform_among_the_far():
    """From one start, the share in the far half is that of the open ground's cells."""
    task = Task(kidnap_distance=3.0)
    terrain = scripted([0.5]).simulator.terrain(0)
    pose = np.array([1.6, -2.4, 0.0])
    cells = terrain.grid.to_metres(terrain.open_cells[:, ::-1] + 0.5)
    far = cells[np.hypot(*(cells - pose[:2]).T) >= 3.0]
    rng = np.random.default_rng(0)
    places = np.array([task.kidnap_pose(terrain, pose, pose, rng) for _ in range(800)])
    east = np.mean(far[:, 0] > 6.0)
    assert np.mean(places[:, 0] > 6.0) == pytest.approx(east, abs=4 * np.sqrt(0.25 / 800) + 0.03)
    assert 0.2 < east < 0.8


def test_where_nothing_is_far_enough_it_is_carried_about_as_far_as_can_be():
    start, far = jump(0, kidnap_distance=1000.0)
    cells = scripted([0.5]).simulator.terrain(0)
    corners = cells.grid.to_metres(cells.open_cells[:, ::-1] + 0.5)
    farthest = np.hypot(*(corners - start).T).max()
    assert np.hypot(*(far - start)) > farthest - 0.6


def test_a_caller_says_where_it_is_carried_to():
    place = np.array([6.0, -2.0, 0.5])
    env = hall_env(KIDNAPPED, "particles",
                   task={"kind": "kidnapped", "kidnap_first": 2, "kidnap_last": 2,
                         "kidnap_distance": 1e5})  # fmt: skip
    for options in ({"kidnap_pose": place}, {"kidnap_pose": [*place[:2], 0.5 + 2 * np.pi]}):
        env.reset(seed=3, options=options)
        env.step(0)
        assert np.abs(env.pose - place).max() > 1e-3
        env.step(0)
        np.testing.assert_allclose(env.pose, place, atol=1e-12)
    env.reset(seed=3)
    env.step(0)
    env.step(0)
    assert np.abs(env.pose - place).max() > 1e-3


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (99.0, 0.0, 0.0), (1.0, 2.0), "there", np.nan])
def test_no_robot_is_carried_into_a_wall(pose):
    with pytest.raises(MapError, match="kidnap_pose"):
        hall_env(KIDNAPPED, "particles").reset(seed=0, options={"kidnap_pose": pose})


@pytest.mark.parametrize("id", [GLOBAL, TRACKING])
def test_who_is_not_kidnapped_is_not_carried_anywhere(id):
    with pytest.raises(ConfigError, match="kidnap_pose is for a kidnapped robot"):
        hall_env(id, "particles").reset(seed=0, options={"kidnap_pose": (6.0, -2.0, 0.5)})


def test_what_the_robot_knows_does_not_depend_on_the_kidnapping():
    """All that it knows, but for the scan and what follows of it, is as if nothing had happened."""
    known = {}
    for kidnap in ("never", "range"):
        task = {"kind": "kidnapped", "kidnap": kidnap, "kidnap_first": 1, "kidnap_last": 1}
        blind = {"kind": "beam", "w_hit": 0.0, "w_short": 0.0, "w_max": 1.0, "w_rand": 0.0}
        env = hall_env(KIDNAPPED, "histogram", task=task, sensor=blind)
        env.reset(seed=4)
        observation, reward, *_ = env.step(0)
        knowledge = env.knowledge
        names = [name for name in knowledge.__slots__ if name not in ("belief", "summary")]
        known[kidnap] = [str({name: getattr(knowledge, name) for name in names}), reward,
                         knowledge.summary.entropy, knowledge.summary.mass,
                         {key: value.tolist() for key, value in observation.items()}]  # fmt: skip
        names = [*knowledge.__slots__, *vars(knowledge.belief)]
        assert not [name for name in names if "kidnap" in name or "watch" in name]
    assert known["never"] == known["range"]


# --- what is told of it

SURE, DOUBT, LOST = 0.96, 0.94, 0.29


@pytest.mark.parametrize(
    ("masses", "notice", "recover"),
    [
        # It is carried off at step 3.
        ([SURE] * 12, -1, -1),
        ([SURE] * 3 + [LOST] + [SURE] * 3, 0, 3),
        ([LOST, LOST, SURE, SURE, SURE, LOST, SURE, SURE, SURE], 2, 5),
        ([SURE] * 3 + [DOUBT, 0.3] * 2 + [SURE] * 5, -1, -1),  # Less than sure is not let go.
        ([SURE] * 5 + [LOST] * 4 + [SURE] * 3, 2, 8),
        ([SURE] * 5 + [LOST] + [SURE, SURE, DOUBT] * 3, 2, -1),
    ],
    ids=str,
)
def test_steps_are_counted_from_the_kidnapping(masses, notice, recover):
    task = {"kind": "kidnapped", "kidnap_first": 3, "kidnap_last": 3, "leap": 1e3}
    episodes = scripted(masses, FAR[0], **task)
    play(episodes, 2)
    assert not episodes.info(0)["noticed"]
    play(episodes, len(masses) - 3)
    info = episodes.info(0)
    assert (info["noticed"], info["notice_steps"]) == (notice >= 0, notice)
    assert (info["recover_steps"], info["is_success"]) == (-1, False)
    assert (info["wrong"], episodes.terminated(0)) == (recover >= 0, recover >= 0)
    assert not recover >= 0 or episodes.episode(0).step == 3 + recover


@pytest.mark.parametrize(
    ("masses", "notice", "recover"),
    [
        ([SURE] * 12, -1, 2),  # Followed to where it was carried.
        ([DOUBT] * 5 + [SURE] * 7, -1, 4),
        ([SURE] * 3 + [DOUBT] * 9, -1, -1),
        ([SURE] * 3 + [LOST] + [SURE] * 3, 0, 3),
        ([SURE] * 4 + [LOST] * 4 + [SURE] * 3, 1, 7),
    ],
    ids=str,
)
def test_a_robot_that_is_right_has_recovered_whether_it_noticed_or_not(masses, notice, recover):
    task = {"kind": "kidnapped", "kidnap_first": 3, "kidnap_last": 3, "leap": 1e3}
    episodes = scripted(masses, **task)
    play(episodes, len(masses) - 1)
    info = episodes.info(0)
    assert (info["notice_steps"], info["recover_steps"]) == (notice, recover)
    assert (info["is_success"], info["wrong"]) == (recover >= 0, False)


@pytest.mark.parametrize(
    ("mass", "within_leap", "lets_go"),
    [(LOST, SURE, False), (LOST, 0.3, False), (SURE, LOST, True), (LOST, LOST, True)],
)
@pytest.mark.parametrize("kidnap", ["range", "never"])
def test_a_belief_lets_go_by_what_it_holds_within_a_leap(mass, within_leap, lets_go, kidnap):
    task = {"kind": "kidnapped", "kidnap": kidnap, "kidnap_first": 4, "kidnap_last": 4}
    episodes = scripted([SURE] * 4 + [mass] * 3, FAR[0] if kidnap == "range" else NEAR[0],
                        **task, leap=1e3)  # fmt: skip
    episodes.belief.within_leap = [1.0] * 4 + [within_leap] * 3
    play(episodes, 6)
    info = episodes.info(0)
    assert info["noticed"] == (kidnap == "range" and lets_go)
    assert info["false_alarm"] == (kidnap == "never" and lets_go)


@pytest.mark.parametrize(("metres", "leapt"), [(0.0, False), (1.99, False), (2.0, True)])
@pytest.mark.parametrize("kidnapped", [True, False])
def test_an_estimate_that_leaps_has_let_go(metres, leapt, kidnapped):
    watch = Watch(Task(kind="kidnapped"), kidnapped_at=4 if kidnapped else -1)
    for step in (4, 5, 6):
        watch.see(step, True, SURE, near=True, leapt=metres if step == 5 else 0.0)
    assert watch.noticed == (kidnapped and leapt)
    assert watch.notice_steps == (1 if kidnapped and leapt else -1)


@pytest.mark.parametrize(
    ("masses", "alarm"),
    [
        ([SURE] * 9, None),
        ([SURE, SURE, SURE, LOST, SURE], 3),  # The first scan counts among the three.
        ([SURE, SURE, LOST, SURE, SURE, SURE, LOST], 6),
        ([SURE, SURE, SURE, 0.3, DOUBT, SURE, SURE], None),  # The level is not under it.
        ([DOUBT, DOUBT, LOST, SURE, SURE, LOST, LOST], None),  # It was never sure for long.
    ],
    ids=str,
)
@pytest.mark.parametrize("kidnap", ["never", "range", "rate"])
def test_an_alarm_is_false_where_the_belief_gave_up_what_it_knew(masses, alarm, kidnap):
    task = {"kind": "kidnapped", "kidnap": kidnap, "kidnap_first": 99, "kidnap_last": 99,
            "kidnap_rate": 1e-9}  # fmt: skip
    episodes = scripted(masses, **task)
    for step in range(1, len(masses)):
        episodes.step(0, 0)
        assert episodes.info(0)["false_alarm"] == (alarm is not None and step >= alarm)
    info = episodes.info(0)
    assert (info["noticed"], info["notice_steps"], info["recover_steps"]) == (False, -1, -1)


@pytest.mark.parametrize(
    ("path", "alarm"),
    [
        ([(2.0, 0.0, 0.0)], True),
        ([(1.3, -1.6, 0.0)], True),
        ([(1.99, 0.0, 0.0)], False),  # A belief that is bent, and comes back.
        ([(0.0, 0.0, np.pi)], False),  # It forgot how it is turned.
        ([(1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (3.0, 0.0, 0.0)], False),  # It drifts.
        ([(1.5, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, 0.0, 0.0)], False),  # It leaps to the truth.
        ([(1.5, 0.0, 0.0), (0.0, 1.5, 0.0)], True),
    ],
    ids=str,
)
def test_an_alarm_is_false_where_the_estimate_leapt_off_the_truth(path, alarm):
    still = {"odometry": {}, "actuation": {}}
    config = EpisodeConfig.build({"task": {"kind": "kidnapped", "kidnap": "never"}, "map": HALL,
                                  "belief": "particles", "motion": still})  # fmt: skip
    episodes = Episodes(config, 1)
    episodes.belief = Scripted(episodes, [SURE])
    episodes.reset(0, np.random.default_rng(0))
    play(episodes, 3)
    for offset in path:
        episodes.belief.offset = np.asarray(offset)
        play(episodes, 1)
    assert episodes.info(0)["false_alarm"] == alarm
    episodes.belief.offset = np.zeros(3)
    play(episodes, 1)
    assert episodes.info(0)["false_alarm"] == alarm
    assert episodes.info(0)["is_success"] == (not alarm)


def test_who_was_wrong_all_along_gave_no_alarm():
    episodes = scripted([SURE], FAR[-1], kind="kidnapped", kidnap="never")
    play(episodes, 4)
    episodes.belief.offset = np.array([-2.0, 0.0, 0.0])
    play(episodes, 2)
    assert not episodes.info(0)["false_alarm"]
    assert episodes.info(0)["wrong"]


def test_letting_go_after_the_kidnapping_is_no_false_alarm():
    task = {"kind": "kidnapped", "kidnap_first": 5, "kidnap_last": 5}
    episodes = scripted([SURE] * 5 + [LOST] * 9, **task)
    play(episodes, 9)
    assert episodes.info(0)["noticed"]
    assert not episodes.info(0)["false_alarm"]


@pytest.mark.parametrize("kidnap", ["never", "rate"])
def test_who_is_not_carried_off_is_judged_at_the_limit(kidnap):
    task = {"kind": "kidnapped", "kidnap": kidnap, "kidnap_rate": 1e-9}
    episodes = scripted([SURE] * 3 + [DOUBT] + [SURE], **task)
    assert play(episodes, 20) is None
    assert episodes.info(0)["is_success"]
    lost = scripted([SURE] * 5 + [LOST] + [SURE] * 20, **task)
    assert play(lost, 20) is None
    assert not lost.info(0)["is_success"]
    assert not lost.info(0)["wrong"]


@pytest.mark.parametrize("kind", ["global", "tracking"])
def test_no_other_task_speaks_of_kidnapping(kind):
    episodes = scripted([SURE] * 2 + [LOST] * 9, kind=kind, kidnap_first=1, kidnap_last=1, hold=2)
    play(episodes, 5)
    info = episodes.info(0)
    told = [info[name] for name in ("kidnapped", "noticed", "false_alarm")]
    assert told == [False, False, False]
    assert info["notice_steps"] == info["recover_steps"] == -1


@pytest.mark.parametrize("belief", BELIEFS)
def test_a_robot_left_alone_has_the_kidnapped_one_s_filter(belief):
    env = hall_env(KIDNAPPED, belief, task={"kind": "kidnapped", "kidnap": "never"})
    env.reset(seed=0)
    assert env.knowledge.belief.config.leak == 1e-3


@pytest.mark.parametrize("u", [(0.4, 0.5, -0.2), (-3.0, 0.0, 0.0), (0.0, -0.7, 3.0)])
def test_dead_reckoning_is_what_a_robot_in_the_open_does(u):
    terrain = scripted([0.5]).simulator.terrain(0)
    pose = np.array([[6.0, -1.9, 2.9]])
    np.testing.assert_allclose(carried(pose[0], np.array(u)), move(terrain, pose, u)[0][0])


# --- the reward


@pytest.mark.parametrize(("id", "belief"), list(itertools.product(IDS, BELIEFS)))
def test_information_terms_sum_to_what_was_removed_in_all(id, belief):
    weight = 2.5
    env = gym.make(id, map=MAP, belief=BELIEFS[belief], reward={"information": weight})
    info = env.reset(seed=3)[1]
    first, total, over = info["entropy_fraction"], 0.0, False
    uniform = env.unwrapped.knowledge.summary.uniform_entropy
    nats = info["entropy"]
    for action in (0, 2, 2, 1, 2, 2, 0, 0, 2) * 5:
        _, reward, over, _, info = env.step(action)
        total += info["reward_information"]
        assert reward == sum(v for k, v in info.items() if k.startswith("reward_"))
        if over:
            break
    assert total == pytest.approx(weight * (first - info["entropy_fraction"]), abs=1e-9)
    assert total == pytest.approx(weight * (nats - info["entropy"]) / uniform, abs=1e-9)


def test_every_term_has_its_weight():
    reward = {"information": 3.0, "step": -0.5, "success": 7.0, "wrong": -11.0}
    entropies = [2.0, 1.0, 1.5]
    for offset, last in (((0.0, 0.0, 0.0), 7.0), ((2.0, 0.0, 0.0), -11.0)):
        episodes = scripted([0.1, 0.1, 1.0], offset, entropies, reward, hold=1)
        episodes.step(0, 0)
        assert episodes.reward(0) == pytest.approx(3.0 * 0.25 - 0.5)
        episodes.step(0, 0)
        assert episodes.reward(0) == pytest.approx(-3.0 * 0.125 - 0.5 + last)


def test_a_weight_must_be_a_number():
    with pytest.raises(ConfigError, match=r"reward\.wrong must be a number"):
        RewardWeights(wrong=np.nan)


def test_a_span_of_steps_runs_upwards():
    with pytest.raises(ConfigError, match="kidnap_first must be at most"):
        Task(kidnap_first=9, kidnap_last=3)
