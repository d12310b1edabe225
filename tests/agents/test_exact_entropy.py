import numpy as np
import pytest

from activeloc.agents import imagination
from activeloc.agents.imagination import Imagined, expected_entropy
from activeloc.envs.localization import LocalizationEnv


def one_beam(field_of_view=0.0):
    sensor = {"beams": 1, "field_of_view": field_of_view, "z_max": 1.5}
    env = LocalizationEnv(map="rooms(width=6,height=5):1", sensor=sensor)
    env.reset(seed=0)
    return env.knowledge


@pytest.mark.parametrize("command", [(0.5, 0.0, 0.0), (0.0, 0.5, 0.0)])
def test_the_sum_over_readings_is_what_many_draws_tend_to(command, monkeypatch):
    knowledge, rng = one_beam(), np.random.default_rng(0)
    imagined = Imagined.here(knowledge, 300, rng).after(knowledge, np.array(command), rng)
    exact = expected_entropy(knowledge, imagined, 1, rng)
    monkeypatch.setattr(imagination, "EXACT_UP_TO", 0)
    drawn = [expected_entropy(knowledge, imagined, 300, rng) for _ in range(20)]
    error = np.std(drawn) / np.sqrt(len(drawn))
    assert exact == pytest.approx(np.mean(drawn), abs=5 * error + 1e-3)
    assert error < 0.02


def test_it_needs_no_chance():
    knowledge = one_beam()
    imagined = Imagined.here(knowledge, 200, np.random.default_rng(1))
    first = expected_entropy(knowledge, imagined, 4, np.random.default_rng(2))
    assert first == expected_entropy(knowledge, imagined, 4, np.random.default_rng(3))
