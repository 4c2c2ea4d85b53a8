import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from samples import STAMP_NS, estimates
from std_msgs.msg import Float64

from msg_adapters.outgoing import plots
from phd_jdtc_ros.configuration.engines import ENGINES
from phd_jdtc_ros.core.engine import Step
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.evaluation import Evaluation


def received(messages):
    """Return what arrives, by name."""
    return {
        name: deserialize_message(serialize_message(message), Float64).data
        for name, message in messages.items()
    }


def of_step(step, engine):
    names = plots.of_tracker(2, engine)
    return received({name: plots.step_to_msg(step, 12.5, name) for name in names})


def test_step_is_one_number_for_each_quantity_of_the_tracker():
    figures = {"particles": 1754, "effective_share": np.float64(0.5), "orphans": 3}
    step = Step(estimates(), (), np.array([2.25, 1.5]), figures)
    found = of_step(step, "particles")
    assert found == {
        "cardinality/total": 3.75,
        "cardinality/class_0": 2.25,
        "cardinality/class_1": 1.5,
        "step_ms": 12.5,
        "particles": 1754.0,
        "effective_share": 0.5,
    }


def test_step_of_each_engine_has_its_own_figures():
    figures = {"hypotheses": 31, "origins": 6, "approximate_clusters": 0}
    step = Step(estimates(), (), np.array([2.25, 1.5]), figures)
    found = of_step(step, "gaussian")
    assert (found["hypotheses"], found["origins"]) == (31.0, 6.0)
    assert set(plots.FIGURES) <= set(ENGINES)


def test_score_is_one_number_for_each_quantity_of_the_evaluator():
    evaluation = Evaluation(classes=2, cutoff=1000.0, order=2.0)
    evaluation.add_truth(STAMP_NS, PointSet(np.array([[0.0, 0.0]]), np.array([0])))
    found = {}
    for source in ("filtered", "smoothed"):
        estimate = PointSet(np.array([[30.0, 40.0]]), np.array([0]))
        (score,) = evaluation.add_estimates(source, STAMP_NS, estimate)
        found |= received(plots.score_to_msgs(score))
    assert set(found) == set(plots.of_evaluator(2))
    assert found["smoothed/all/ospa"] == found["filtered/class_0/localization"] == 50.0
    assert (found["filtered/all/n_true"], found["filtered/class_1/n_est"]) == (1.0, 0.0)
