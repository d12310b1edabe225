"""A sensor model of your own: ``python examples/own_sensor.py``.

Three infrared feelers that say only *near* (0 m) or *nothing* (``z_max``). One object is the truth
(``read``) and what the filter assumes (``masses``); both follow from ``p_near``. Printed is what
the two make of three ranges, which must agree, then how an episode of ``spin`` ends with it.
"""

from dataclasses import dataclass

import numpy as np

from activeloc.agents.evaluation import Player, Record, Sweep
from activeloc.maps import MapSource
from activeloc.sensors import ExpectedRangeSensor, ReadingBins
from activeloc.sensors.readings import spread_bearings


@dataclass(frozen=True)
class Feelers(ExpectedRangeSensor):
    """Map and pose matter through the exact range z* [m] alone, which the base class casts."""

    z_max: float = 2.0  # [m]
    bearings = spread_bearings(3, np.pi)  # ``(B,)``, from right to left [rad].

    def p_near(self, z_expected):
        """P(near | z*), any shape: half at one metre."""
        return 1.0 / (1.0 + np.exp((z_expected - 1.0) / 0.1))

    def masses(self, z_expected, bins):
        """P(reading in bin | z*): ``(..., Z)`` for ``(...)``; each row sums to one."""
        p = np.zeros((*np.shape(z_expected), len(bins)))
        p[..., 0] = self.p_near(z_expected)
        p[..., -1] = 1.0 - p[..., 0]
        return p

    def read(self, grid, rays, uniforms):
        """Draw a reading ``(...)`` [m] for each ray ``(..., 3)`` from ``(..., 2)`` uniforms."""
        return np.where(uniforms[..., 0] < self.p_near(self.expected(grid, rays)), 0.0, self.z_max)


def main(map: str = "rooms(width=8,height=6):0", seed: int = 3, n: int = 10_000) -> Record:
    """Compare what is read with what is assumed, then play; returns how it went."""
    maps, rng, sensor = MapSource.parse(map), np.random.default_rng(seed), Feelers()
    rays = np.array([[1.0, 1.0, angle] for angle in (2.0, 3.0, 4.0)])
    read = sensor.read(maps.number(0), np.tile(rays, (n, 1, 1)), rng.random((n, 3, 2)))
    assumed = sensor.bin_probabilities(maps.number(0), rays, ReadingBins(sensor.z_max, 0.1))
    ranges = sensor.expected(maps.number(0), rays)
    for z, near, p in zip(ranges, (read == 0.0).mean(axis=0), assumed[:, 0], strict=True):
        print(f"{z:.2f} m: near in {near:.3f} of the readings, the filter assumes {p:.3f}")
    settings = {"sensor": sensor}
    sweep = Sweep("activeloc/GlobalLocalization-v0", maps, {"spin": {}}, settings, seed=seed)
    record = Player(sweep).play("spin", 0)
    print(f"right: {record.success}, wrong: {record.wrong}, after {record.played} steps")
    return record


if __name__ == "__main__":
    main()
