"""Eight numbers at a time against numpy, one at a time."""

import numpy as np
import pytest
from numba import njit

from activeloc.beliefs import lanes
from activeloc.beliefs.lanes import N_LANES

ZERO = np.uint64(0)


@njit
def operate(a, b, c, at, out):
    x, y, z = lanes.load(a, at), lanes.load(b, at), lanes.load(c, at)
    lanes.store(out, np.uint64(0), lanes.add(x, y))
    lanes.store(out, np.uint64(8), lanes.sub(x, y))
    lanes.store(out, np.uint64(16), lanes.mul(x, y))
    lanes.store(out, np.uint64(24), lanes.at_least(x, y, z))
    lanes.store(out, np.uint64(32), lanes.fill(a[at]))
    return lanes.total(x), lanes.any_above(x, y)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("at", range(5))
def test_each_lane_is_worked_out_as_one_number(precision, at):
    rng = np.random.default_rng(at)
    a, b, c = rng.standard_normal((3, 20)).astype(precision)
    b[at : at + 3] = a[at : at + 3]
    out = np.full(50, 7.0, dtype=precision)
    total, exceeds = operate(a, b, c, np.uint64(at), out)
    x, y, z = a[at : at + N_LANES], b[at : at + N_LANES], c[at : at + N_LANES]
    expected = [x + y, x - y, x * y, np.where(x >= y, x, z), np.full(N_LANES, x[0])]
    np.testing.assert_array_equal(out, np.append(np.concatenate(expected), np.full(10, 7.0)))
    assert total == pytest.approx(x.astype(float).sum(), rel=1e-14, abs=1e-14)
    assert exceeds


@njit
def exceeds_anywhere(a, b):
    return lanes.any_above(lanes.load(a, ZERO), lanes.load(b, ZERO))


@pytest.mark.parametrize("lane", range(N_LANES))
def test_one_lane_is_enough(lane):
    a, b = np.ones(N_LANES), np.ones(N_LANES)
    assert not exceeds_anywhere(a, b)
    a[lane] = 1.5
    assert exceeds_anywhere(a, b)
    assert not exceeds_anywhere(b, a)
    a[lane] = np.nan  # Not to be lost sight of.
    assert exceeds_anywhere(a, b)


@njit
def sum_wide(a):
    sums = lanes.fill(0.0)
    for i in range(ZERO, np.uint64(len(a)), np.uint64(N_LANES)):
        sums = lanes.add(sums, lanes.widened(lanes.load(a, i)))
    return lanes.total(sums)


def test_sums_are_kept_as_float64():
    a = np.full(80_000, 0.1, dtype=np.float32)
    assert sum_wide(a) == pytest.approx(80_000 * float(np.float32(0.1)), rel=1e-12)
    assert sum_wide(a.astype(float)) == pytest.approx(80_000 * float(np.float32(0.1)), rel=1e-12)


@njit
def find(table, first, indices, at, out):
    lanes.store(out, ZERO, lanes.look_up(table, first, indices, at))


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("index", ["uint16", "uint32"])
def test_a_look_up_is_one_for_each_lane(precision, index):
    """The largest index of sixteen bits is not taken for one below zero."""
    rng = np.random.default_rng(0)
    table, out = rng.random(3 + 2**16).astype(precision), np.empty(N_LANES, dtype=precision)
    indices = rng.integers(0, 2**16, 20).astype(index)
    indices[7] = 2**16 - 1
    for first, at in ((0, 0), (3, 5), (1, 12)):
        find(table, np.uint64(first), indices, np.uint64(at), out)
        np.testing.assert_array_equal(out, table[first + indices[at : at + N_LANES].astype(int)])


@njit
def take_logarithms(x, out):
    for i in range(ZERO, np.uint64(len(x)), np.uint64(N_LANES)):
        lanes.store(out, i, lanes.log(lanes.load(x, i)))


def test_logarithms_are_those_of_the_library():
    """Of all magnitudes, and where they are small: about one, on both sides of a power of two."""
    rng = np.random.default_rng(0)
    around = 1.0 + rng.choice([-1.0, 1.0], 4000) * 10.0 ** rng.uniform(-16, -1, 4000)
    wide = 10.0 ** rng.uniform(-307, 308, 8000)
    limits = np.finfo(np.float64)
    edges = [limits.tiny, limits.max, 1.0, 2.0, 0.5, np.sqrt(0.5), np.sqrt(2.0), np.e]
    x = np.concatenate([around, around * np.sqrt(0.5), wide, edges])
    out = np.empty_like(x)
    take_logarithms(x, out)
    np.testing.assert_allclose(out, np.log(x), rtol=4e-16, atol=0)
    assert out[-6] == 0.0
