import json
import sys
from types import SimpleNamespace

from samples import estimates

from msg_adapters.encoding import interfaces
from msg_adapters.outgoing import outputs
from msg_adapters.outgoing.trails import Trails
from phd_jdtc_ros.configuration.parameters import tracker_node
from phd_jdtc_ros.earth import SystemPlane

# The switch of what is no row of the table: the radars' frames.
OTHERS = {"frames"}


def switches(rows):
    return {row.switch for row in rows if row.switch}


def test_usual_outputs_are_on_by_default_and_no_switch_is_of_unusual_rows_too():
    usual = {row for row in outputs.table(1) if row.usual}
    assert switches(usual) == {*tracker_node.Node().outputs} - OTHERS
    rows = outputs.table(1)
    usual = switches(row for row in rows if row.usual)
    assert not usual & switches(row for row in rows if not row.usual)


def test_geojson_is_the_text_of_a_message(monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove_msgs.msg", SimpleNamespace(GeoJSON=SimpleNamespace))
    (row,) = (row for row in outputs.table(2) if row.switch == "geojson")
    view = outputs.View("map", ("a", "b"), (), SystemPlane((52.3, 4.8, 5.0)), Trails(3))
    (message,) = row.encode(estimates(), view)
    interfaces.message_class.cache_clear()
    assert json.loads(message.geojson)["type"] == "FeatureCollection"
