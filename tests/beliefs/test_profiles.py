"""Profiles of ray classes: told apart, and counted and rounded as one does it by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from activeloc.beliefs.profiles import LEVELS, Profiles


def profiles_of(classes, is_open, n_classes):
    """Row of each cell, and the rows, of classes ``(A, S, C)`` of uint8 or uint16."""
    layout = SimpleNamespace(size=classes.shape[2], place=np.arange(classes.shape[2]))
    profiles = Profiles(n_classes, is_open, layout)
    row = np.empty(classes.shape[2], dtype=np.int32)
    profiles.assign(classes, row)
    return row, profiles.shares


def by_largest_remainder(counts):
    exact = counts * LEVELS / counts.sum()
    rounded = np.floor(exact).astype(int)
    for _ in range(LEVELS - rounded.sum()):
        rounded[np.argmax(exact - rounded)] += 1
    return rounded / LEVELS


@pytest.mark.parametrize(("n_classes", "dtype"), [(7, np.uint8), (61, np.uint8), (900, np.uint16)])
def test_rows_are_rounded_counts_of_open_rays(n_classes, dtype):
    rng = np.random.default_rng(0)
    few = rng.integers(0, n_classes, (4, 3000))
    classes = few[rng.integers(0, 4, (3, 16, 3000)), np.arange(3000)].astype(dtype)
    is_open = rng.random((3000, 16)) < 0.8
    is_open[:, 5] = True
    row, shares = profiles_of(classes, is_open, n_classes)
    for c in range(0, 3000, 7):
        counts = np.bincount(classes[:, is_open[c], c].ravel(), minlength=n_classes)
        np.testing.assert_allclose(shares[row[c]], by_largest_remainder(counts), atol=1e-12)
    assert len(np.unique(shares, axis=0)) == len(shares)


def test_no_two_small_sums_of_hashes_are_equal():
    """Of up to 24 rays of one class and 24 of another; a hash too regular fails: 6 a was 3 b."""
    pairs = np.array([(p, q) for p in range(61) for q in range(p)])
    sums = [np.zeros(1, np.uint64)]
    classes = np.arange(61, dtype=np.uint8)[None, None]
    layout = SimpleNamespace(size=61, place=np.arange(61))
    profiles = Profiles(61, np.ones((61, 1), dtype=bool), layout)
    profiles.assign(classes, np.empty(61, dtype=np.int32))
    hashes = profiles._high.astype(np.uint64) << np.uint64(32) | profiles._low
    for n, m in np.ndindex(25, 25):
        if n and m:
            high = n * (hashes >> 32)[pairs[:, 0]] + m * (hashes >> 32)[pairs[:, 1]]
            low = n * (hashes % 2**32)[pairs[:, 0]] + m * (hashes % 2**32)[pairs[:, 1]]
            sums.append(high % 2**32 << 32 | low % 2**32)
        elif n:
            sums.append(n * (hashes >> 32) % 2**32 << 32 | n * (hashes % 2**32) % 2**32)
    sums = np.concatenate(sums)
    assert len(np.unique(sums)) == len(sums)
