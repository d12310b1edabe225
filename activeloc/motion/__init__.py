"""Motion: what a command or an odometry reading does to a pose.

A motion is a rotation, a translation and a second rotation ``(rot1 [rad], trans [m], rot2 [rad])``.
The robot carries a command out with *actuation* noise and is stopped where its disc touches an
obstacle; its *odometry* then reads what was carried out, with noise of its own. Filters never see
the command: their control u is the odometry's reading, so a robot stuck at a wall is known to be
stuck. One kernel, :func:`drive`, moves the simulated robot and every hypothesis of every filter.

Noise comes in as standard normal numbers; nothing here draws any.
"""

from activeloc.motion.driving import MARGIN, drive, free_way, move
from activeloc.motion.model import BLUNDER_ANGLE, SLIP_ANGLE, SLIP_TRAVEL, MotionModel, slipped
from activeloc.motion.noise import MotionNoise
from activeloc.motion.terrain import Terrain, wrap

__all__ = [
    "BLUNDER_ANGLE",
    "MARGIN",
    "SLIP_ANGLE",
    "SLIP_TRAVEL",
    "MotionModel",
    "MotionNoise",
    "Terrain",
    "drive",
    "free_way",
    "move",
    "slipped",
    "wrap",
]
