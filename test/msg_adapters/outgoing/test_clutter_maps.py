import numpy as np
import pytest

from msg_adapters.encoding import interfaces, names
from msg_adapters.encoding.errors import RejectedMessageError
from msg_adapters.outgoing import clutter_maps
from phd_jdtc_ros.core.models.clutter_raster import ClutterRaster

SHOWN = ClutterRaster((-1500.0, 300.0), 50.0, np.array([[0.0, 0.01, 0.1], [1.0, 1000.0, 1e5]]))


def test_values_are_twenty_to_a_factor_of_ten():
    message = clutter_maps.to_msg(SHOWN, 1_500_000_000, "map")
    assert list(message.data) == [0, 0, 20, 40, 100, 100]
    assert (message.info.width, message.info.height, message.info.resolution) == (3, 2, 50.0)
    assert message.header.frame_id == "map"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    origin = message.info.origin
    assert (origin.position.x, origin.position.y, origin.orientation.w) == (-1500.0, 300.0, 1.0)


def test_a_recorded_message_is_the_picture_again():
    data = interfaces.encode(clutter_maps.to_msg(SHOWN, 1, "map"))
    found = clutter_maps.from_msg(interfaces.decode(data, names.GRID))
    assert (found.corner, found.cell) == (SHOWN.corner, SHOWN.cell)
    np.testing.assert_allclose(found.density, [[0.0, 0.0, 0.1], [1.0, 1000.0, 1000.0]])


def _smaller(message):
    message.info.width = 2


def _empty(message):
    message.info.width, message.data = 0, []


def _nowhere(message):
    message.info.origin.position.x = float("nan")


def _flat(message):
    message.info.resolution = 0.0


@pytest.mark.parametrize(
    ("change", "reason"),
    [(_smaller, "schema"), (_empty, "schema"), (_nowhere, "not_finite"), (_flat, "not_finite")],
)
def test_a_message_that_is_no_picture_is_refused(change, reason):
    message = clutter_maps.to_msg(SHOWN, 1, "map")
    change(message)
    with pytest.raises(RejectedMessageError) as caught:
        clutter_maps.from_msg(message)
    assert caught.value.reason == reason
