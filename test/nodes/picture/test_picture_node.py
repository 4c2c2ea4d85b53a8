"""The live picture of a ship's tracker: own ship, its alarms in words, and zones."""

import http.client
import json
import re

import moving
import pytest
from live_and_offline import started
from moving_messages import CLOUDS, sent
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.earth import SystemPlane

ORIGIN = [54.3, 10.2, 0.0]


@pytest.fixture
def zone(tmp_path):
    """Return a file with a zone that the ship is in."""
    x, y = [-900.0, 900.0, 900.0, -900.0], [-900.0, -900.0, 900.0, 900.0]
    latitude, longitude = SystemPlane(ORIGIN).to_geodetic([*x, x[0]], [*y, y[0]])
    polygon = {"type": "Polygon", "coordinates": [list(zip(longitude, latitude, strict=True))]}
    feature = {"type": "Feature", "properties": {"name": "harbour"}, "geometry": polygon}
    path = tmp_path / "zones.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


def test_own_ship_is_shown_with_its_alarms(processes, peer, tmp_path, zone):
    given = {
        **dict(flatten(moving.PARAMETERS)),
        "world_origin": ORIGIN,
        "conflicts.distance": [100.0],
        "zones": str(zone),
    }
    types = {CLOUDS: PointCloud2, moving.ODOMETRY: Odometry}
    outputs, found, _ = started(processes, peer, tmp_path, given, types)
    node = processes.start("picture", "--port", "0")
    port = int(re.search(r"localhost:(\d+)/", peer.said(node, "look at"))[1])
    assert peer.spin_until(lambda: outputs[moving.ODOMETRY].get_subscription_count() == 2)
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", "/events")
    reply, news = connection.getresponse(), {}
    messages = sent()
    for topic, data, stamp_ns in messages:
        outputs[topic].publish(data)
        if topic == moving.ODOMETRY:
            due = sum(other == CLOUDS and ns <= stamp_ns for other, _, ns in messages)
            assert peer.spin_until(lambda due=due: len(found) >= due)
    while not {"head", "carriers", "alarms", "tracks"} <= news.keys() or not news["alarms"]["text"]:
        line = reply.fp.readline().decode()
        if line.startswith("event: "):
            news[line[7:].strip()] = json.loads(reply.fp.readline()[6:])
    connection.close()
    head = news["head"]
    assert (head["sites"], head["radars"]) == ([], ["mast"])
    assert [each["name"] for each in head["zones"]] == ["harbour"]
    (x,), (y,) = news["carriers"]["x"], news["carriers"]["y"]
    places = [moving.ship((ns - moving.START_NS) * 1e-9).position for _, _, ns in messages]
    assert min(abs(x - a) + abs(y - b) for a, b in places) <= 1.0
    assert any(
        text.startswith("own ship in guard zone harbour: 100%") for text in news["alarms"]["text"]
    )
