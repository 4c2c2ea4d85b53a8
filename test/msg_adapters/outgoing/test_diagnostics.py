import json
import sys
from types import SimpleNamespace

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from samples import STAMP_NS, estimates
from std_msgs.msg import Float64

from msg_adapters.encoding import interfaces, stamps
from msg_adapters.outgoing import diagnostics, outputs
from msg_adapters.targets.tracks import Trails
from phd_jdtc_ros.configuration.engines import ENGINES
from phd_jdtc_ros.core.engine import Step
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.parameter_files import node_tables

KEYS = [
    *("ospa", "localization", "cardinality"),
    *("gospa", "gospa_localization", "missed", "false"),
    *("n_true", "n_est", "cutoff", "order"),
]
# The switch of what is no row of the table: the radars' frames.
OTHERS = {"frames"}


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


def test_figures_to_cdr_equals_the_serialised_objects():
    values = {"total": 2.5, "unresolved": 3, "läufer": np.float64(0.1), "": 1e-300}
    status = diagnostics.status("tracker/cardinality", values)
    expected = interfaces.encode(diagnostics.array(STAMP_NS, [status]))
    assert diagnostics.figures_to_cdr(STAMP_NS, values) == expected


def received(messages):
    """Return what arrives, by name."""
    return {
        name: deserialize_message(serialize_message(message), Float64).data
        for name, message in messages.items()
    }


def of_step(step, engine):
    names = diagnostics.of_tracker(2, engine)
    numbers = diagnostics.of_step(step, 12.5)
    return received({name: diagnostics.to_msg(numbers[name]) for name in names})


def test_step_is_one_number_for_each_quantity_of_the_tracker():
    figures = {"particles": 1754, "effective_sample_size": np.float64(871.5), "orphans": 3}
    step = Step(estimates(), (), np.array([2.25, 1.5]), figures)
    found = of_step(step, "phd")
    assert found == {
        "cardinality/total": 3.75,
        "cardinality/class_0": 2.25,
        "cardinality/class_1": 1.5,
        "step_ms": 12.5,
        "particles": 1754.0,
        "effective_sample_size": 871.5,
    }


def test_step_of_each_engine_has_its_own_figures():
    figures = {"hypotheses": 31, "origins": 6, "approximate_clusters": 0}
    step = Step(estimates(), (), np.array([2.25, 1.5]), figures)
    found = of_step(step, "gaussian")
    assert (found["hypotheses"], found["origins"]) == (31.0, 6.0)
    assert set(diagnostics.FIGURES) <= set(ENGINES)


def test_score_is_one_number_for_each_quantity_of_the_evaluator():
    evaluation = Evaluation(classes=2, cutoff=1000.0, order=2.0)
    evaluation.add_truth(STAMP_NS, PointSet(np.array([[0.0, 0.0]]), np.array([0])))
    found = {}
    for source in ("filtered", "smoothed"):
        estimate = PointSet(np.array([[30.0, 40.0]]), np.array([0]))
        (score,) = evaluation.add_estimates(source, STAMP_NS, estimate)
        found |= received(diagnostics.score_to_msgs(score))
    assert set(found) == set(diagnostics.of_evaluator(2))
    assert found["smoothed/all/ospa"] == found["filtered/class_0/localization"] == 50.0
    assert (found["filtered/all/n_true"], found["filtered/class_1/n_est"]) == (1.0, 0.0)


def switches(rows):
    return {row.switch for row in rows if row.switch}


def test_usual_outputs_are_on_by_default_and_no_switch_is_of_unusual_rows_too():
    usual = {row for row in outputs.table(1) if row.usual}
    assert switches(usual) == {*node_tables.Node().outputs} - OTHERS
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
