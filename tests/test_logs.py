"""The reader of CARMEN logs, and what a recording says of its motions."""

import os

import numpy as np
import pytest

from activeloc.errors import ConfigError, LogError
from activeloc.logs import Recording, carmen, controls_between, read_log
from activeloc.motion import wrap

TAIL = "{t} host {t}"


def flaser(t=1.0, ranges="1 2 3", n=None, poses="1 2 0.5 4 5 0.6", name="FLASER"):
    n = len(ranges.split()) if n is None else n
    return f"{name} {n} {ranges} {poses} {TAIL.format(t=t)}"


def robotlaser(t=1.0, ranges="1 2 3", remissions="0", longest=50, tail="0 0 0 0 0"):
    n = len(ranges.split())
    head = f"ROBOTLASER1 0 -1.0 2.0 1.0 {longest} 0.01 0 {n} {ranges}"
    return f"{head} {remissions} 1 2 0.5 4 5 0.6 {tail} {TAIL.format(t=t)}"


@pytest.fixture
def write(tmp_path):
    def write_log(*lines):
        path = tmp_path / "run.log"
        content = b"\n".join(x if isinstance(x, bytes) else x.encode() for x in lines)
        path.write_bytes(content + b"\n" if lines else b"")
        return path

    return write_log


def test_a_front_laser_line_has_two_poses_and_a_time(write):
    run = read_log(
        write("# a comment", "", flaser(1.5), flaser(2.0, "4 5 6", poses="0 0 7 1 1 -7"))
    )
    np.testing.assert_array_equal(run.scans, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(run.reference, [[1, 2, 0.5], [0, 0, 7 - 2 * np.pi]])
    np.testing.assert_allclose(run.odometry, [[4, 5, 0.6], [1, 1, 2 * np.pi - 7]])
    np.testing.assert_array_equal(run.times, [1.5, 2.0])
    np.testing.assert_array_equal(run.scan_numbers, [0, 1])
    assert (run.name, len(run), run.seconds) == ("run", 2, 0.5)


@pytest.mark.parametrize(
    ("n", "first", "last"),
    [(180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90), (1, 0, 0), (2, -90, 0)],
)
def test_a_front_laser_looks_over_half_a_turn(write, n, first, last):
    run = read_log(write(flaser(ranges=" ".join(["1"] * n))))
    np.testing.assert_allclose(np.rad2deg(run.bearings[[0, -1]]), [first, last])


def test_a_robotlaser_line_says_its_own_angles_and_range(write):
    lines = [
        robotlaser(1, "1 49.9 50"),
        robotlaser(2, "1 2 3", remissions="3 7 8 9"),
        robotlaser(3, "3 2 1", remissions="", tail="0 0 0 0"),
    ]
    run = read_log(write(*lines))
    np.testing.assert_array_equal(run.scans, [[1, 49.9, np.inf], [1, 2, 3], [3, 2, 1]])
    np.testing.assert_allclose(run.bearings, [-1, 0, 1])
    np.testing.assert_allclose(run.reference, [[1, 2, 0.5]] * 3)
    np.testing.assert_allclose(run.odometry, [[4, 5, 0.6]] * 3)


def test_readings_at_the_longest_range_and_above_are_infinite(write):
    path = write(flaser(ranges="79.99 80 81.83"))
    np.testing.assert_array_equal(read_log(path).scans, [[79.99, np.inf, np.inf]])
    np.testing.assert_array_equal(read_log(path, 81.0).scans, [[79.99, 80, np.inf]])
    np.testing.assert_array_equal(
        read_log(write(robotlaser(ranges="1 2 3")), 2).scans[0][1:], np.inf
    )


def test_other_messages_are_skipped(write):
    run = read_log(
        write(
            "PARAM robot_width 0.6 nohost 0",
            f"ODOM 1 2 3 0 0 0 {TAIL.format(t=9)}",
            flaser(1),
            flaser(5, name="RLASER", ranges="9"),
            "SYNC here",
            "TRUEPOS anything goes",
            robotlaser(1),
            flaser(2),
        )
    )
    assert len(run) == 2
    assert run.scans.max() == 3


def test_windows_line_ends_and_no_last_line_end(tmp_path):
    path = tmp_path / "dos.log"
    path.write_bytes(f"{flaser(1)}\r\n{flaser(2)}".encode())
    assert len(read_log(path)) == 2


GOOD = flaser(1)
DAMAGED = {
    "empty file": ([], "no FLASER or ROBOTLASER1 line"),
    "comments alone": (["# a", "# b"], "no FLASER or ROBOTLASER1 line"),
    "odometry alone": ([f"ODOM 1 2 3 0 0 0 {TAIL.format(t=9)}"], "no FLASER"),
    "rear laser alone": ([flaser(name="RLASER")], "1 RLASER lines look backwards"),
    "unknown word": ([GOOD, "FLASSER 1 2"], ":2: message: unknown name 'FLASSER'; did you mean"),
    "prose": (["Dear robot,"], ":1: message: unknown name 'Dear'"),
    "table": (["1.0 2.0 3.0"], ":1: message: unknown name '1.0'"),
    "lower case": (["flaser 1 1"], ":1: message: unknown name 'flaser'"),
    "name alone": (["FLASER"], ":1: FLASER: n is ''; expected an integer in [1, 4096]"),
    "n is a word": ([flaser(n="three")], ":1: FLASER: n is 'three'"),
    "n is a fraction": ([flaser(n="3.0")], "n is '3.0'"),
    "n is negative": ([flaser(n="-3")], "n is '-3'"),
    "n is signed": ([flaser(n="+3")], "n is '+3'"),
    "n has an underscore": ([flaser(n="0_3")], "n is '0_3'"),
    "n in other digits": ([flaser(n="٣")], "n is '٣'"),
    "n is zero": ([flaser(n=0, ranges="")], "n is '0'"),
    "n is huge": ([flaser(n=10**9)], "n is '1000000000'"),
    "n is absurd": ([flaser(n="9" * 1000)], "n is '9999999999"),
    "n is nan": ([flaser(n="nan")], "n is 'nan'"),
    "n too small": ([flaser(n=2)], ":1: FLASER: 13 fields; expected 12"),
    "n too large": ([flaser(n=4)], ":1: FLASER: 13 fields; expected 14"),
    "truncated in the ranges": ([GOOD, GOOD[:10]], ":2: FLASER: 2 fields; expected 13"),
    "truncated in the poses": ([" ".join(GOOD.split()[:-5])], "8 fields; expected 13"),
    "truncated in the times": ([" ".join(GOOD.split()[:-1])], "12 fields; expected 13"),
    "one field too many": ([GOOD + " 1"], "14 fields; expected 13"),
    "two lines in one": ([GOOD + " " + GOOD], "27 fields; expected 13"),
    "range nan": ([flaser(ranges="1 nan 3")], ":1: FLASER: range 1 is 'nan'; expected a finite"),
    "range inf": ([flaser(ranges="1 2 inf")], "range 2 is 'inf'"),
    "range minus inf": ([flaser(ranges="-inf 2 3")], "range 0 is '-inf'"),
    "range overflows": ([flaser(ranges="1e999 2 3")], "range 0 is '1e999'"),
    "range negative": ([flaser(ranges="1 2 -0.01")], "range 2 is -0.01; expected a number from 0"),
    "range is a word": ([flaser(ranges="1 x 3")], "range 1 is 'x'"),
    "range with a comma": ([flaser(ranges="1 2,5 3")], "range 1 is '2,5'"),
    "range with an underscore": ([flaser(ranges="1 2_5 3")], "range 1 is '2_5'"),
    "pose nan": ([flaser(poses="1 2 nan 4 5 6")], "pose field 2 is 'nan'"),
    "pose is a word": ([flaser(poses="1 2 3 4 five 6")], "pose field 4 is 'five'"),
    "pose far away": ([flaser(poses="1 2 3 4 1e7 6")], "a pose holds 1e+07; expected at most"),
    "heading absurd": ([flaser(poses="1 2 1e300 4 5 6")], "a pose holds 1e+300"),
    "time nan": ([flaser("nan")], ":1: FLASER: time 0 is 'nan'"),
    "time is a word": ([flaser("noon")], "time 0 is 'noon'"),
    "logger time is a word": ([GOOD.replace("host 1", "host x")], "time 1 is 'x'"),
    "times run backwards": ([flaser(2), flaser(1.5)], ":2: time 1.500000 s; the scan before was"),
    "mixed n": ([flaser(1), flaser(2, "1 2")], ":2: 2 beams at other angles than the 3"),
    "rear laser damaged": ([GOOD, flaser(name="RLASER", n=9)], ":2: RLASER: 13 fields"),
    "odometry short": ([GOOD, "ODOM 1 2 3"], ":2: ODOM: 3 fields; expected 9"),
    "odometry nan": ([GOOD, "ODOM 1 nan 3 0 0 0 1 h 1"], ":2: ODOM: reading 1 is 'nan'"),
    "parameter without value": ([GOOD, "PARAM robot_width"], ":2: PARAM: 1 fields"),
    "robotlaser short": (["ROBOTLASER1 0 -1 2 1 50"], "5 fields; expected 8 before the ranges"),
    "robotlaser n": ([robotlaser().replace(" 0 3 1 2 3", " 0 x 1 2 3")], "readings is 'x'"),
    "robotlaser range": ([robotlaser(ranges="1 nan 3")], "ROBOTLASER1: range 1 is 'nan'"),
    "robotlaser remissions": ([robotlaser(remissions="2 7")], "27 fields; expected 28"),
    "robotlaser remission count": ([robotlaser(remissions="x")], "remissions is 'x'"),
    "robotlaser remission": ([robotlaser(remissions="1 nan")], "remission 0 is 'nan'"),
    "robotlaser step": ([robotlaser().replace("2.0 1.0", "2.0 0")], "expected a positive step"),
    "robotlaser turns": ([robotlaser().replace("2.0 1.0", "2.0 3.15")], "at most a full turn"),
    "robotlaser geometry": ([robotlaser().replace("-1.0", "nan")], "geometry 0 is 'nan'"),
    "robotlaser longest": ([robotlaser(longest=0)], "longest range 0 m"),
    "robotlaser velocity": ([robotlaser(tail="0 inf 0 0 0")], "velocity or distance 1 is 'inf'"),
    "robotlaser angles change": (
        [robotlaser(1), robotlaser(2).replace("-1.0", "-1.1")],
        ":2: 3 beams at other angles",
    ),
    "binary": ([bytes(range(200, 256))], ":1: not UTF-8 text"),
    "zeros": ([b"\0" * 100], ":1: control characters"),
    "zeros in the middle": ([GOOD, GOOD.replace("2 3", "2\0003")], ":2: control characters"),
    "latin-1": ([GOOD, "# höme".encode("latin-1")], ":2: not UTF-8 text"),
    "utf-16": ([GOOD.encode("utf-16")], ":1: not UTF-8 text"),
    "byte order mark": (["\ufeff" + GOOD], "unknown name"),
    "giant line": ([GOOD, "FLASER " + "1 " * carmen.MAX_LINE], ":2: line is longer than 131072"),
    "giant line without end": ([b"#" * (carmen.MAX_LINE + 5)], ":1: line is longer"),
    "giant word": ([GOOD, "x" * 10_000], ":2: message: unknown name 'xxxx"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damage_is_refused_with_file_and_line(write, name):
    lines, message = DAMAGED[name]
    path = write(*lines)
    with pytest.raises(LogError) as refused:
        read_log(path)
    assert str(refused.value).startswith(str(path))
    assert message in str(refused.value)
    assert len(str(refused.value)) < len(str(path)) + 700


def test_what_is_no_readable_file_is_refused(tmp_path, write):
    for path, message in [
        (tmp_path, "must be a regular file"),
        (tmp_path / "lost.log", "cannot read: No such file"),
        (write(GOOD) / "run.log", "cannot read: Not a directory"),
        ("\0", "cannot read"),
    ]:
        with pytest.raises(LogError, match=message):
            read_log(path)


def test_a_pipe_is_refused_rather_than_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.log")
    with pytest.raises(LogError, match="must be a regular file"):
        read_log(tmp_path / "pipe.log")


def test_a_huge_file_is_refused_unread(tmp_path):
    path = tmp_path / "huge.log"
    with path.open("wb") as file:
        file.truncate(carmen.MAX_BYTES + 1)
    with pytest.raises(LogError, match=r"1073741825 bytes; at most 1073741824"):
        read_log(path)


def test_a_longest_range_must_be_positive(write):
    with pytest.raises(ConfigError, match=r"max_range must be a number in \(0"):
        read_log(write(GOOD), 0.0)


def drive(pose, u):
    """Rotate, travel, rotate: the motion model of the textbook."""
    x, y, theta = pose
    heading = theta + u[0]
    return np.array([x + u[1] * np.cos(heading), y + u[1] * np.sin(heading), heading + u[2]])


def recording(poses, **given):
    n = len(poses)
    fields = {
        "scans": np.arange(3.0 * n).reshape(n, 3),
        "bearings": np.array([-1.0, 0.0, 1.0]),
        "reference": poses,
        "odometry": poses,
        "times": np.arange(n) * 2.0,
    }
    return Recording(**{**fields, **given})


def wander(n, seed=0):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(size=(n, 3)), axis=0)


def test_controls_lead_from_pose_to_pose():
    poses = wander(200)
    controls = recording(poses).controls()
    assert controls.shape == (199, 3)
    for start, u, end in zip(poses[:-1], controls, poses[1:], strict=True):
        reached = drive(start, u)
        np.testing.assert_allclose(reached[:2], end[:2], atol=1e-9)
        assert wrap(reached[2] - end[2]) == pytest.approx(0.0, abs=1e-9)
    assert (np.abs(controls[:, 0]) <= np.pi / 2 + 1e-12).all()
    assert (controls[:, 1] < 0.0).any()
    assert (np.abs(controls[:, 2]) <= np.pi).all()


@pytest.mark.parametrize(
    ("end", "expected"),
    [
        ([1, 0, 0], [0, 1, 0]),
        ([-1, 0, 0], [0, -1, 0]),
        ([-1, 0.1, 0.3], [-np.arctan(0.1), -np.hypot(1, 0.1), 0.3 + np.arctan(0.1)]),
        ([0, 1, np.pi / 2], [np.pi / 2, 1, 0]),
        ([0, 0, 3], [0, 0, 3]),
        ([0, 0, -3.5], [0, 0, 2 * np.pi - 3.5]),
        ([0.001, 0.01, 0.5], [0, 0.001, 0.5]),
        ([-0.01, 0.001, 0.5], [0, -0.01, 0.5]),
    ],
)
def test_controls_of_known_motions(end, expected):
    (u,) = controls_between(np.array([[0, 0, 0], end], dtype=float))
    np.testing.assert_allclose(u, expected, atol=1e-9)


def test_controls_do_not_depend_on_the_odometrys_frame():
    poses = wander(50)
    turned = poses @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [5, -7, np.pi / 2]
    np.testing.assert_allclose(controls_between(poses), controls_between(turned), atol=1e-9)


def test_a_cut_carries_the_robot_and_the_wheels_do_not_turn():
    poses = wander(20)
    whole = recording(poses)
    cut = whole.cut(5, 12)
    kept = np.r_[0:5, 12:20]
    np.testing.assert_array_equal(cut.scan_numbers, kept)
    np.testing.assert_array_equal(cut.reference, poses[kept])
    np.testing.assert_array_equal(cut.scans, whole.scans[kept])
    expected = np.concatenate([whole.controls()[:4], np.zeros((1, 3)), whole.controls()[12:]])
    np.testing.assert_allclose(cut.controls(), expected, atol=1e-9)
    assert whole.seconds == 38.0
    assert cut.seconds == 2.0 * (4 + 7)


def test_parts_of_a_recording():
    whole = recording(wander(20))
    part = whole.from_scan(4).until(3)
    np.testing.assert_array_equal(part.scan_numbers, [4, 5, 6])
    np.testing.assert_array_equal(part.scans, whole.scans[4:7])
    np.testing.assert_array_equal(part.times, [8, 10, 12])
    assert len(whole.until(1000)) == 20
    with pytest.raises(ValueError, match="read-only"):
        part.scans[0, 0] = 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: r.from_scan(-1), r"first scan must be an integer in \[0, 9\]; got -1"),
        (lambda r: r.from_scan(10), "first scan"),
        (lambda r: r.from_scan(1.0), "first scan"),
        (lambda r: r.until(0), "number of scans"),
        (lambda r: r.cut(0, 3), "kidnapped at scan"),
        (lambda r: r.cut(3, 3), "set down at scan"),
        (lambda r: r.cut(3, 10), "set down at scan"),
        (lambda r: r.cut(9, 10), "kidnapped at scan"),
    ],
)
def test_parts_that_are_not_there_are_refused(call, message):
    with pytest.raises(ConfigError, match=message):
        call(recording(wander(10)))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("scans", np.zeros((9, 3)), r"scans must be \(10, 3\)"),
        ("scans", np.full((10, 3), -1.0), "ranges must be in"),
        ("scans", np.full((10, 3), np.nan), "ranges must be in"),
        ("reference", np.zeros((10, 2)), r"reference must be \(10, 3\)"),
        ("odometry", np.full((10, 3), np.inf), "odometry must be finite"),
        ("times", np.arange(10.0)[::-1], "must ascend"),
        ("times", np.zeros(0), "not empty"),
        ("bearings", np.zeros(3), "must ascend"),
        ("numbers", np.zeros(3, dtype=int), "numbers must be"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(field, value, message):
    with pytest.raises(LogError, match=message):
        recording(wander(10), **{field: value})
