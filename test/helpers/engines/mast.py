"""A sensor of positions on a mast, and its model without compiled functions."""

from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Linearised
from phd_jdtc_ros.core.sensors.position import Area, PositionSensor, WatchedArea

REACH = 2e4


class LinearisedPositions(PositionSensor):
    """A sensor of positions whose measurements of Gaussians are those of the base class."""

    @property
    def of_gaussians(self):
        return Linearised(self)


def mast(std=5.0, sensor=PositionSensor, **changed):
    """Return a sensor in a square of 2 `REACH`, with the noise `std` along both axes."""
    usual = {
        "name": "mast",
        "position": (500.0, -300.0),
        "yaw": 0.0,
        "threshold": 3.0,
        "clutter_rate": 4.0,
        "visibility": WatchedArea(Area.rectangle(-REACH, -REACH, REACH, REACH), 0.9),
        "std": (std, std),
    }
    return sensor(**{**usual, **changed})
