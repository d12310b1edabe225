"""What honesty costs: the filters that are compared, and that all of them are timed."""

import numpy as np

from activeloc.beliefs.histogram import HistogramConfig
from activeloc.beliefs.particles import ParticleConfig
from activeloc.maps import MapSource
from benchmarks.honesty import filters, milliseconds
from benchmarks.selective import walk


def test_the_defaults_are_held_against_filters_that_take_everything_at_its_word():
    beliefs = filters()
    assert beliefs["histogram"].config == HistogramConfig()
    assert beliefs["particles"].config == ParticleConfig()
    for name in ("histogram, plain", "particles, plain"):
        config = beliefs[name].config
        assert (config.likelihood_power, config.sigma_factor, config.slip) == (1.0, 1.0, 0.0)
        assert (config.leak, config.repetition) == (0.0, np.inf)


def test_every_filter_is_timed_at_every_step():
    path = walk(MapSource.parse("rooms(width=4,height=3,smallest=1.5):0").number(0), 3, seed=0)
    for known in (True, False):
        took = milliseconds(path, known, 0, 3)
        assert set(took) == set(filters())
        assert all(ms.shape == (3,) and (ms > 0.0).all() for ms in took.values())
