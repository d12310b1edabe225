"""A belief stood for by n like hypotheses, the same ones every time it is asked.

Pointers at equal distances go through the cumulative weights, as in systematic resampling, but from
a fixed start: no random number is used up, and what each weight gets differs from its share by less
than one hypothesis.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def thin_weights(
    weights: NDArray[np.floating], index: NDArray[np.int64], count: NDArray[np.int64]
) -> int:
    """Give n hypotheses to N weights.

    Args:
        weights: ``(N,)``, not negative, their sum positive.
        index: ``(n,)``, overwritten with the weights that get any, ascending.
        count: ``(n,)``, overwritten with how many each of them gets.

    Returns:
        How many weights that are; their counts sum to n.
    """
    n, total = index.shape[0], 0.0
    for i in range(weights.shape[0]):
        total += weights[i]
    chosen, pointer, cumulative, last = 0, 0, 0.0, 0
    for i in range(weights.shape[0]):
        if weights[i] <= 0.0:
            continue
        cumulative += weights[i]
        last = i
        if (pointer + 0.5) * total >= cumulative * n:
            continue
        met = 0
        while pointer < n and (pointer + 0.5) * total < cumulative * n:
            pointer += 1
            met += 1
        index[chosen], count[chosen] = i, met
        chosen += 1
        if pointer == n:
            return chosen
    index[chosen], count[chosen] = last, n - pointer  # Only if the sum was rounded.
    return chosen + 1
