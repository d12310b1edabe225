"""Threads of the vector environment: the same bits for any number, in any process."""

import gc
import multiprocessing
import pickle
import threading

import gymnasium as gym
import numpy as np
import pytest

import activeloc  # noqa: F401  (registers the ids)
from activeloc.envs import maze_kernels
from activeloc.envs.maze_kernels import help_out
from activeloc.errors import ConfigError, MapError
from activeloc.sharing import (
    ASLEEP,
    CLOSED,
    DONE,
    LIMIT,
    PATIENCE,
    Helpers,
    Pool,
    finish,
    is_worth_waiting,
    new_board,
    place_of,
    publish,
    take,
    wait_for_others,
)

ROOMS = "rooms(width=6,height=5,resolution=0.1):0-1"
CASES = {
    "maze": ("activeloc/Maze7-v0", {"observation": {"view": True, "radius": 3}}),
    "noisy maze": ("activeloc/NoisyMaze9-v0", {}),
    "histogram": (
        "activeloc/GlobalLocalization-v0",
        {"map": ROOMS, "belief": {"kind": "histogram", "cell_size": 0.25, "headings": 36}},
    ),
    "particles": (
        "activeloc/KidnappedRobot-v0",
        {"map": ROOMS, "belief": {"kind": "particles", "n_min": 200, "n_max": 500}},
    ),
}
every_case = pytest.mark.parametrize("case", CASES)


def make(case, threads, n=5, mode="SAME_STEP"):
    id, settings = CASES[case]
    return gym.make_vec(
        id, num_envs=n, threads=threads, max_episode_steps=6, autoreset_mode=mode, **settings
    )


def played(env, steps=14, seed=3):
    """Everything that an environment says in some steps, as bytes."""
    n, said = env.num_envs, []
    rng = np.random.default_rng(seed)
    results = [env.reset(seed=seed)]
    results += [env.step(rng.integers(3, size=n)) for _ in range(steps)]
    for result in results:
        for part in (result[0], result[-1], result[-1].get("final_info", {})):
            plain = {key: part[key] for key in part if not key.startswith("final")}
            said += [plain[key].tobytes() for key in sorted(plain)]
        for last in result[-1].get("final_obs", []):
            said += [] if last is None else [last[key].tobytes() for key in sorted(last)]
        said += [part.tobytes() for part in result[1:-1]]
    return said


def helpers():
    return [one for one in threading.enumerate() if one.name.startswith("activeloc")]


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
@every_case
def test_results_are_the_same_bits_for_any_number_of_threads(case, mode):
    expected = played(make(case, 1, mode=mode))
    for threads in (2, 3, 7):
        env = make(case, threads, mode=mode)
        assert played(env) == expected
        env.close()


@every_case
def test_one_robot_needs_no_threads(case):
    known = set(helpers())
    env = make(case, 4, n=1)
    assert played(env) == played(make(case, 1, n=1))
    assert set(helpers()) <= known
    env.close()


@every_case
def test_threads_are_made_when_they_are_needed_and_end_with_the_environment(case):
    known = set(helpers())
    env = make(case, 3)
    assert set(helpers()) <= known
    played(env, steps=2)
    ours = set(helpers()) - known
    assert 1 <= len(ours) <= 2
    env.close()
    for one in ours:
        one.join(timeout=20.0)
        assert not one.is_alive()


@every_case
def test_threads_end_with_an_environment_that_is_dropped(case):
    env = make(case, 3)
    known = set(helpers())
    played(env, steps=2)
    ours = set(helpers()) - known
    assert ours
    del env
    gc.collect()
    for one in ours:
        one.join(timeout=20.0)
        assert not one.is_alive()


@every_case
def test_a_copy_makes_its_own_threads(case):
    env = make(case, 3)
    played(env, steps=2)
    twin = pickle.loads(pickle.dumps(env.unwrapped))
    assert played(twin) == played(env)
    env.close()
    twin.close()


def child(case, threads, connection):
    env = make(case, threads)
    connection.send(played(env))
    env.close()


def go_on(env, connection):
    connection.send(played(env))


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
@every_case
def test_an_environment_with_threads_goes_on_in_a_forked_process(case):
    """The child has none of the threads, whatever they were doing."""
    env = make(case, 3)
    expected = played(env)
    context = multiprocessing.get_context("fork")
    for target, given in ((go_on, (env,)), (child, (case, 2))):
        ours, theirs = context.Pipe()
        process = context.Process(target=target, args=(*given, theirs), daemon=True)
        process.start()
        assert ours.poll(20.0)
        assert ours.recv() == expected
        process.join(timeout=20.0)
        assert process.exitcode == 0
    assert played(env) == expected
    env.close()


@pytest.mark.parametrize("case", ["maze", "particles"])
def test_a_spawned_process_has_threads_of_its_own(case):
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=child, args=(case, 2, theirs), daemon=True)
    process.start()
    assert ours.poll(120.0)
    assert ours.recv() == played(make(case, 1))
    process.join(timeout=20.0)
    assert process.exitcode == 0


@every_case
@pytest.mark.parametrize("threads", [0, -1, 2.5, "a", True, None, 257])
def test_numbers_of_threads_that_are_none_are_refused(case, threads):
    with pytest.raises(ConfigError, match=r"threads must be an integer in \[1, 256\]; got"):
        make(case, threads)


def test_environments_with_threads_may_be_stepped_by_threads():
    """Four environments at once, each with helpers, by four threads of the caller's."""
    expected, found = played(make("maze", 1)), {}

    def play(i):
        env = make("maze", 3)
        found[i] = played(env) == expected
        env.close()

    callers = [threading.Thread(target=play, args=(i,)) for i in range(4)]
    for one in callers:
        one.start()
    for one in callers:
        one.join()
    assert found == dict.fromkeys(range(4), True)


def test_helpers_do_what_the_caller_would_do():
    """Every share done by a helper, none by the caller: no luck decides who does what."""
    ours, theirs = (make("maze", threads).unwrapped for threads in (1, 3))
    episodes = theirs._episodes
    batch, board = episodes._batch, new_board(2)

    def helpers_only(batch, _, n_each):
        publish(board, n_each)
        help_out(batch, n_each, board, 2)
        assert board[DONE] == 3 * board[LIMIT]
        assert board[place_of(2, ASLEEP)] >= 1

    with pytest.MonkeyPatch.context() as patch:
        expected = played(ours)
        patch.setattr(maze_kernels, "run", helpers_only)
        assert played(theirs) == expected
    assert board[LIMIT] >= 15 * episodes._shares
    assert (batch.steps > 0).any()
    theirs.close()


def test_the_caller_compiles_what_its_helpers_do():
    """A process that ends while a thread compiles is aborted; so no thread is the first."""
    threads, closed = [], []

    def work(board, helper):
        threads.append(threading.get_ident())
        closed.append(bool(board[CLOSED]))
        while is_worth_waiting(board, helper, PATIENCE):
            pass

    helpers = Helpers(1, work)
    helpers.call()
    helpers.close()
    assert threads[0] == threading.get_ident()
    assert closed[0]


def test_every_share_is_taken_once_whoever_takes_it():
    """Many threads on one board, some not there: no share is lost or done twice, time and again."""
    for there in ((0, 1, 2, 3), (0, 2), (3,), (0,)):
        board, taken = new_board(3), {i: [] for i in there}

        def work(i, board=board, taken=taken):
            while (share := take(board, i, 500)) >= 0:
                taken[i].append(share)
                finish(board)

        for _ in range(3):
            publish(board, 500)
            callers = [threading.Thread(target=work, args=(i,)) for i in there]
            for one in callers:
                one.start()
            wait_for_others(board)
            for one in callers:
                one.join()
            assert sorted(share for one in taken.values() for share in one) == list(range(2000))
            for one in taken.values():
                one.clear()


def test_a_thread_takes_its_own_shares_first_the_same_ones_each_time():
    board = new_board(2)
    for _ in range(3):
        publish(board, 2)
        assert [take(board, 1, 2) for _ in range(3)] == [2, 3, 4]
        assert take(board, 0, 2) == 0
        assert [take(board, 2, 2) for _ in range(3)] == [5, 1, -1]


def test_observations_are_new_at_every_step():
    """They are drawn by all threads into arrays that nobody has seen before."""
    env = make("maze", 2)
    first = env.reset(seed=1)[0]
    kept = {name: value.copy() for name, value in first.items()}
    second = env.step(np.zeros(5, dtype=int))[0]
    for name, value in first.items():
        np.testing.assert_array_equal(value, kept[name])
        assert not np.shares_memory(value, second[name])
        assert value.flags.c_contiguous
        assert value.flags.owndata
    env.close()


def test_what_a_task_raises_is_raised_when_nobody_works_any_more():
    pool, seen = Pool(3), []

    def task(robot):
        seen.append(robot)
        if robot == 2:
            raise MapError("here")

    with pytest.raises(MapError, match="here"):
        pool.each(task, range(9))
    assert sorted(seen) == sorted(set(seen))
    assert 2 in seen
    pool.each(seen.append, range(100, 104))
    assert sorted(seen)[-4:] == [100, 101, 102, 103]
    pool.close()
