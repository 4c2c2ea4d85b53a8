"""The health of the ASTERIX bridge."""

import math
from collections import Counter

import asterix_records as made
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from phd_jdtc_ros.asterix.plot_stream import PlotStream
from phd_jdtc_ros.nodes import asterix
from phd_jdtc_ros.nodes.asterix import SILENT_S
from phd_jdtc_ros.nodes.common.health import Rises
from phd_jdtc_ros.nodes.common.receiving import Moment

ADDRESS = "127.0.0.1:8600"
NOW_S = 100.0


def moment(active_s=1.0, rises=None):
    return Moment("/bridge", rises or Rises(), active_s, NOW_S)


def input_status(stream, rises, active_s=1.0, inputs=(ADDRESS,)):
    return asterix.of_input(moment(active_s, rises), stream, 0, inputs)


@pytest.mark.parametrize(
    ("active_s", "inputs", "level"),
    [
        (SILENT_S - 1.0, (ADDRESS,), DiagnosticStatus.OK),
        (SILENT_S + 1.0, (ADDRESS,), DiagnosticStatus.WARN),
        (SILENT_S + 1.0, (), DiagnosticStatus.OK),
        (math.nan, (ADDRESS,), DiagnosticStatus.STALE),
    ],
)
def test_input_without_any_datagram_is_a_warning_that_names_the_address(active_s, inputs, level):
    found = input_status(PlotStream({}), Rises(), active_s, inputs)
    assert found.level == level
    if level == DiagnosticStatus.WARN:
        assert found.message.startswith(f"no datagram for 16 s on {ADDRESS}; check")


@pytest.mark.parametrize(
    ("active_s", "level"),
    [(1.0, DiagnosticStatus.OK), (20.0, DiagnosticStatus.WARN), (math.nan, DiagnosticStatus.STALE)],
)
def test_output_without_any_estimates_is_a_warning(active_s, level):
    found = asterix.of_output(moment(active_s), ADDRESS, Counter(), {}, 0, "no publisher")
    assert found.level == level
    if level == DiagnosticStatus.WARN:
        assert found.message == "no estimates for 20 s; no publisher"


def test_a_radar_is_not_silent_while_the_bridge_is_not_active():
    stream = PlotStream({})
    list(stream.feed(made.north(1000.0)))
    ((number, state),) = stream.radars.items()
    found = asterix.of_radar(moment(math.nan), number, state)
    assert (found.level, found.message) == (DiagnosticStatus.STALE, "not active")


def test_malformed_input_is_reported_while_it_comes():
    stream, rises = PlotStream({}), Rises()
    assert input_status(stream, rises).level == DiagnosticStatus.OK
    stream.feed(b"no block")
    found = input_status(stream, rises)
    assert found.level == DiagnosticStatus.WARN
    assert found.message == "malformed: block_truncated 1"
    rises, stream = Rises(), PlotStream({})
    stream.feed(b"no block")
    input_status(stream, rises)
    assert input_status(PlotStream({}), rises).level == DiagnosticStatus.OK
