"""Calibration: is a belief as sure as it is right?

Draw the truth from the prior, let it live in the world that the filter assumes, run the filter on
what the robot reads. Where the filter is the Bayes filter of that world, the truth is one more draw
from its posterior, and four things follow; each is tested here.

====================  ==========================================================================
ranks                 The truth's rank in the posterior is uniform, whatever is ranked: x, y, the
                      heading, the posterior probability itself, the last scan's likelihood.
                      Simulation-based calibration:
                      Talts et al., "Validating Bayesian inference algorithms" (2018), and Modrák
                      et al., "Simulation-based calibration checking" (2023), for the last two.
credible sets         A set of highest probability that holds p of the belief holds the truth in
                      a share p of the runs.
NEES                  The squared error, normalised by the belief's own covariance, is 3 on average
                      (Bar-Shalom, Li & Kirubarajan, *Estimation*, 2001, section 5.4).
declarations          Of the robots that are p sure of where they are, a share p are right.
====================  ==========================================================================

In a world that is not the filter's (its default rules, the odometry's reading as control) the same
figures say by how much it errs, and on which side.
"""

from activeloc.calibration.defects import DEFECTS
from activeloc.calibration.experiment import Experiment
from activeloc.calibration.report import Report
from activeloc.calibration.runner import calibrate

__all__ = ["DEFECTS", "Experiment", "Report", "calibrate"]
