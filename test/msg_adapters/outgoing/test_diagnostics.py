import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given, settings
from hypothesis import strategies as st
from samples import STAMP_NS

from msg_adapters.encoding import stamps
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.evaluation import Evaluation

KEYS = [
    *("ospa", "localization", "cardinality"),
    *("gospa", "gospa_localization", "missed", "false"),
    *("n_true", "n_est", "cutoff", "order"),
]


def scored():
    evaluation = Evaluation(classes=2, cutoff=1000.0, order=2.0)
    truth = PointSet(np.array([[0.0, 0.0], [5e3, 0.0]]), np.array([0, 1]))
    evaluation.add_truth(STAMP_NS, truth)
    found = PointSet(np.array([[30.0, 40.0]]), np.array([0]))
    (score,) = evaluation.add_estimates("smoothed", STAMP_NS, found)
    return score


def test_score_to_msg_keeps_the_contract_of_the_topic():
    message = diagnostics.score_to_msg(scored(), 1000.0, 2.0)
    assert stamps.to_ns(message.header.stamp) == STAMP_NS
    assert [status.name for status in message.status] == [
        "smoothed/all",
        "smoothed/class_0",
        "smoothed/class_1",
    ]
    for status in message.status:
        assert [pair.key for pair in status.values] == KEYS
        assert status.hardware_id == ""
        assert status.level == DiagnosticStatus.OK


def test_score_to_msg_values_read_back_exactly():
    score = scored()
    message = diagnostics.score_to_msg(score, 1000.0, 2.0)
    for status, found in zip(message.status, score.values.values(), strict=True):
        values = diagnostics.values_of(status)
        assert (float(values.pop("cutoff")), float(values.pop("order"))) == (1000.0, 2.0)
        for name in ("missed", "false", "n_true", "n_est"):
            assert int(values[name]) == found[name]
        for name, text in values.items():
            assert float(text) == found[name]


@settings(deadline=None)
@given(st.floats())
def test_status_floats_read_back_exactly(value):
    for written in (value, np.float64(value)):
        text = diagnostics.values_of(diagnostics.status("name", {"key": written}))["key"]
        assert np.array(float(text)).tobytes() == np.array(value).tobytes() or np.isnan(value)
        assert np.isnan(float(text)) == np.isnan(value)


@settings(deadline=None)
@given(st.integers())
def test_status_integers_read_back_exactly(value):
    text = diagnostics.values_of(diagnostics.status("name", {"key": value}))["key"]
    assert int(text) == value


def test_status_has_level_message_and_hardware():
    found = diagnostics.status("name", {}, DiagnosticStatus.WARN, "silent", "radar_1")
    assert (found.name, found.level, found.message) == ("name", DiagnosticStatus.WARN, "silent")
    assert found.hardware_id == "radar_1"
    assert found.values == []


def test_array_has_no_frame():
    message = diagnostics.array(
        STAMP_NS, [diagnostics.status("a", {}), diagnostics.status("b", {})]
    )
    assert message.header == stamps.header(STAMP_NS, "")
    assert [status.name for status in message.status] == ["a", "b"]
