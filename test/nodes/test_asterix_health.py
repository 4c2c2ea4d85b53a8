# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The health of the ASTERIX bridge."""

from diagnostic_msgs.msg import DiagnosticStatus

from phd_jdtc_ros.asterix.plot_stream import PlotStream
from phd_jdtc_ros.nodes.asterix import health
from phd_jdtc_ros.nodes.common.seen import Seen


def input_status(stream, seen):
    return health.of_input("/bridge", stream, 0, True, seen)


def test_malformed_input_is_said_while_it_comes():
    stream, seen = PlotStream({}), Seen()
    assert input_status(stream, seen).level == DiagnosticStatus.OK
    stream.feed(b"no block")
    found = input_status(stream, seen)
    assert found.level == DiagnosticStatus.WARN
    assert found.message == "malformed: block_truncated 1"


def test_a_bridge_that_begins_again_has_nothing_to_warn_of():
    seen, stream = Seen(), PlotStream({})
    stream.feed(b"no block")
    input_status(stream, seen)
    assert input_status(PlotStream({}), seen).level == DiagnosticStatus.OK


def test_counts_that_begin_again_rise_as_at_first():
    seen = Seen()
    assert not seen.rose("plots", 0)
    assert seen.rose("plots", 5)
    assert not seen.rose("plots", 0)
    assert seen.rose("plots", 2)
