"""A live tracker and a radar on the round earth, over DDS; and the same clouds offline."""

import json
from pathlib import Path

import numpy as np
import pytest
from live_and_offline import assert_same, tracked_live, tracked_offline
from pyproj import Geod, Transformer
from sensor_msgs.msg import NavSatFix

from msg_adapters import names, point_cloud, stamps
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import from_arguments

pytestmark = pytest.mark.live
PROFILE = Path(__file__).parents[2] / "config" / "air_traffic.yaml"
ORIGIN, PLACE = [50.0, 8.5, 100.0], [50.9, 10.6, 180.0]
GIVEN = {
    "world_origin": ORIGIN,
    "approach.geodetic": PLACE,
    "approach.rotation_s": 0.0,
    "approach.fields.time": "",
    "approach.fields.height": "height",
    "approach.azimuth_unit": "deg",
    "approach.max_range": 200e3,
    "approach.clutter_max_range": 200e3,
    "estimates_period_s": 0.0,
}
SCANS, INTERVAL_S, HEIGHT = 10, 4.0, 10e3
TOPOCENTRIC = Transformer.from_pipeline(
    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
    "+step +proj=cart +ellps=WGS84 "
    f"+step +proj=topocentric +ellps=WGS84 +lat_0={PLACE[0]} +lon_0={PLACE[1]} +h_0={PLACE[2]}"
)


def truth():
    """Return the latitudes and longitudes of an aircraft that flies to the north-west."""
    along = 220.0 * INTERVAL_S * np.arange(SCANS)
    count = np.ones(SCANS)
    east, north, _ = Geod(ellps="WGS84").fwd(11.9 * count, 51.3 * count, 310.0 * count, along)
    return north, east


def clouds(radar):
    """Return what the radar publishes of the aircraft: slant ranges, compass degrees, heights."""
    north, east = truth()
    x, y, up = TOPOCENTRIC.transform(east, north, np.full(SCANS, HEIGHT))
    slant, compass = np.sqrt(x**2 + y**2 + up**2), np.degrees(np.arctan2(x, y)) % 360.0
    return [
        point_cloud.encode(
            round((1000.0 + scan * INTERVAL_S) * 1e9),
            radar.frame,
            {
                "range": slant[[scan]],
                "azimuth": compass[[scan]],
                "height": np.array([HEIGHT]),
            },
        )
        for scan in range(SCANS)
    ]


def test_live_tracks_on_the_earth_are_those_of_offline_ones_and_where_the_aircraft_is(
    processes, peer
):
    config = resolve({**from_arguments.load(PROFILE), **GIVEN}, SystemPlane)
    (radar,) = config.inputs
    sent = clouds(radar)
    fixes = peer.collect(NavSatFix, f"{names.TRACKER}/navsat")
    words = [f"{name}:={json.dumps(value)}" for name, value in GIVEN.items()]
    found = tracked_live(
        *(processes, peer, radar, sent),
        *("--params-file", PROFILE, "-p", "outputs:=[navsat]"),
        *(word for text in words for word in ("-p", text)),
    )

    assert_same(found, tracked_offline(config, sent))
    assert len(found) == SCANS
    last_ns = found[-1].stamp_ns
    assert peer.spin_until(lambda: any(stamps.to_ns(fix.header.stamp) == last_ns for fix in fixes))
    (fix,) = (fix for fix in fixes if stamps.to_ns(fix.header.stamp) == last_ns)
    assert fix.header.frame_id == "track_1"
    north, east = truth()
    apart = Geod(ellps="WGS84").inv(fix.longitude, fix.latitude, east[-1], north[-1])[2]
    # The plots have no noise; a curved way in the plane is taken for a straight one.
    assert apart < 10.0
