"""Range sensors: p(z | x, m).

A sensor says where its beams point, what a reading may be, how probable each reading is, and draws
readings for the simulator: the same object for both, unless a study asks for two.

========================  =========================================================================
:class:`BeamModel`        A mixture of hit, short, max and random around the exact expected range.
:class:`ProximityModel`   A known or an unknown obstacle, step of range by step of range.
:class:`Sonar`            The proximity model with a cone of rays for each beam; the nearest wins.
:class:`LikelihoodField`  The distance of a beam's end point to the nearest obstacle, normalised.
:class:`DepthSensor`      Counts cells to the wall ahead; errors by a confusion matrix.
========================  =========================================================================

A scan is ``(B,)`` of ranges [m]. NaN means that a beam gave no reading, +inf a maximum-range
reading; anything else outside ``[0, z_max]`` is refused.

Filters weigh a reading by the bin that it falls into (:class:`ReadingBins`): the probability of a
bin given a pose is a probability, sums to one, and is what the planners sum over.
"""

from activeloc.sensors.beam import BeamModel
from activeloc.sensors.depth import DepthSensor
from activeloc.sensors.field import LikelihoodField
from activeloc.sensors.proximity import ProximityModel
from activeloc.sensors.readings import ExpectedRangeSensor, RangeSensor, ReadingBins
from activeloc.sensors.sonar import Sonar

__all__ = [
    "BeamModel",
    "DepthSensor",
    "ExpectedRangeSensor",
    "LikelihoodField",
    "ProximityModel",
    "RangeSensor",
    "ReadingBins",
    "Sonar",
]
