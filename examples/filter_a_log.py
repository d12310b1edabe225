"""Filter a recorded run: ``python examples/filter_a_log.py [run.log building.yaml]``.

A particle filter that begins without any idea goes through a CARMEN log. Without one, a robot is
simulated in a small home and its ``run.log`` written: a line for each scan. Printed is, for every
tenth scan, the entropy and how far the estimate is from the pose that the log gives, then the
verdict. The same with files of results: ``activeloc localize run.log --map building.yaml --out D``.
"""

import sys
from pathlib import Path

import numpy as np

from activeloc.logs import read_log
from activeloc.maps import MapSource
from activeloc.motion import MotionModel, MotionNoise
from activeloc.replay import ReplayConfig, Score, localize, score
from activeloc.sensors import BeamModel
from activeloc.simulator import Simulator

HOME = "rooms(width=8,height=6):0"


def write_log(path: Path, scans: int, seed: int) -> None:
    """Let a robot wander in the home, and write what its laser and its wheels say."""
    rng = np.random.default_rng(seed)
    laser = BeamModel(beams=61, field_of_view=np.pi, z_max=8.0)
    robot = Simulator(1, laser, MotionModel(odometry=MotionNoise(0.1, 0.05, 0.05, 0.05)))
    robot.place(0, MapSource.parse(HOME).number(0), rng)
    x = y = theta = 0.0  # Where the wheels believe to be.
    with path.open("w") as log:
        for i in range(scans):
            scan = robot.scan(0, rng)
            ranges = " ".join(f"{z:.3f}" for z in np.where(scan < laser.z_max, scan, 81.91))
            pose = " ".join(f"{value:.4f}" for value in (*robot.poses[0], x, y, theta))
            log.write(f"FLASER {scan.size} {ranges} {pose} {i}.0 home {i}.0\n")
            blocked = scan[20:41].min() < 0.6
            u = robot.step(0, np.array([0.5, 0.0, 0.0] if blocked else [0.0, 0.3, 0.0]), rng)
            x, y = x + u[1] * np.cos(theta + u[0]), y + u[1] * np.sin(theta + u[0])
            theta += u[0] + u[2]


def main(log: Path | None = None, map: str = HOME, scans: int = 100, seed: int = 0) -> Score:
    """Filter and print; returns the verdict."""
    if log is None:
        write_log(log := Path("run.log"), scans, seed)
    grid = MapSource.parse(map).number(0)
    rows = list(localize(read_log(log), grid, ReplayConfig.of("particles"), seed))
    for row in rows[::10]:
        print(f"scan {row.scan:3d}: entropy {row.entropy:5.2f} nat, {row.error_m:5.2f} m off")
    verdict = score(rows)
    print(f"right: {verdict.right}; median error {verdict.median_m:.2f} m at the end")
    return verdict


if __name__ == "__main__":
    main(*(kind(argument) for kind, argument in zip((Path, str), sys.argv[1:], strict=False)))
