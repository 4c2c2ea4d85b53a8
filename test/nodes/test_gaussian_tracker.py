"""The live tracker with the engine of Gaussians."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_radars import RELIABLE, SCANS, Radars
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from msg_adapters import detections, diagnostics, estimates
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import RunEnded

COUNT = 8
GAUSSIAN = {"engine": "gaussian"}


@pytest.fixture
def tracker(processes, peer):
    """Return a function that starts a tracker with parameters, and its radars."""

    def start(**changes):
        group = Radars(peer)
        given = {**GAUSSIAN, **changes}
        words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
        processes.start("tracker", "--ros-args", *words, *RELIABLE)
        group.connect()
        return group

    return start


def offline(changes, later=None, since=COUNT):
    """Return the clouds of scans tracked without a node, filtered and smoothed.

    From the scan `since` on, with the parameters `later`.
    """
    config = resolve({**GAUSSIAN, **changes})
    pipeline, found = new_pipeline(config), ([], [])

    def take(events):
        for event in events:
            found[0].extend(() if isinstance(event, RunEnded) else event.step.filtered)
            found[1].extend(event.smoothed if isinstance(event, RunEnded) else event.step.smoothed)

    for index, scan in enumerate(SCANS[:COUNT]):
        if index == since:
            other = resolve({**GAUSSIAN, **changes, **later})
            pipeline.engine.retune(other.model, other.rule)
        for radar, input_ in enumerate(config.inputs):
            cloud = detections.to_msg(scan.detections[radar], scan.stamp_ns, input_.frame)
            report = detections.from_msg(cloud, input_)
            take(pipeline.add(radar, report.stamp_ns, report.detections))
    take(pipeline.flush())
    return [[bytes(estimates.to_msg(one, "map").data) for one in source] for source in found]


def received(group):
    """Return the clouds of a tracker after its flush."""
    assert group.peer.call(Trigger, "/tracker/flush").success
    assert group.peer.spin_until(lambda: len(group.smoothed) == COUNT)
    return [[bytes(cloud.data) for cloud in source] for source in (group.filtered, group.smoothed)]


@pytest.mark.parametrize(
    "changes",
    [{"lag": 0}, {"lag": 3}, {"lag": "15 s"}, {"lag": 1, "radar_1.clutter_rate": "auto"}],
    ids=str,
)
def test_gaussians_are_tracked_live_as_offline(tracker, changes):
    group = tracker(**changes)
    for index in range(COUNT):
        group.track(index)
    found = received(group)
    assert found == offline(changes)
    assert any(found[0])


NUMBER = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=80.0)
WORD = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="auto")


@pytest.mark.parametrize(("value", "given"), [(NUMBER, 80.0), (WORD, "auto")], ids=["80", "auto"])
def test_gaussians_take_a_change_while_they_are_tracked(value, given, tracker, peer):
    # Far from what is learned, so that it makes a difference.
    before = {"lag": 3, "radar_1.clutter_rate": 2000.0}
    group = tracker(**before)
    for index in range(COUNT):
        if index == 5:
            changed = Parameter(name="radar_1.clutter_rate", value=value)
            request = SetParametersAtomically.Request(parameters=[changed])
            service = "/tracker/set_parameters_atomically"
            assert peer.call(SetParametersAtomically, service, request).result.successful
        group.track(index)
    later = {"radar_1.clutter_rate": given}
    assert received(group) == offline(before, later, since=5) != offline(before)


def test_figures_and_health_are_those_of_gaussians(tracker, peer):
    figures = peer.collect(DiagnosticArray, "/tracker/cardinality")
    numbers = {n: peer.collect(Float64, f"/tracker/plot/{n}") for n in ("hypotheses", "origins")}
    group = tracker(lag=1)
    assert peer.spin_until(
        lambda: all(peer.node.count_publishers(f"/tracker/plot/{name}") for name in numbers)
    )
    for index in range(3):
        group.track(index)
    assert peer.spin_until(lambda: figures and all(numbers.values()))
    values = diagnostics.values_of(figures[-1].status[0])
    assert int(values["hypotheses"]) >= int(values["origins"]) > 0
    assert "particles" not in values
    assert peer.node.count_publishers("/tracker/plot/particles") == 0
    before = len(group.health)
    assert peer.spin_until(lambda: len(group.health) > before + 1)
    (pace,) = [s for s in group.health[-1].status if s.name == "/tracker: step time"]
    assert diagnostics.values_of(pace)["approximate_clusters"] == "0"
