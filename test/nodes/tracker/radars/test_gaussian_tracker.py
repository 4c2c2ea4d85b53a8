"""The live tracker with the engine of Gaussians."""

from diagnostic_msgs.msg import DiagnosticArray
from live_radars import RELIABLE, cloud, connected, options
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import RunEnded

COUNT = 9
RATE = "radar_1.clutter_rate"
# At the start far from what is learned, so that the changes make a difference.
GIVEN = {"lag_s": 15.0, RATE: 2000.0}
LEARN = "radar_1.learn"
CHANGES = {3: {RATE: 80.0}, 6: {RATE: 20.0, LEARN: ["clutter"]}}


def offline(changes):
    """Return the clouds of scans tracked without a node, filtered and smoothed.

    `changes` are the first radar's parameters from some scans on.
    """
    config = resolve(GIVEN)
    pipeline, found = new_pipeline(config), ([], [])

    def take(events):
        for event in events:
            found[0].extend(() if isinstance(event, RunEnded) else event.step.filtered)
            found[1].extend(event.smoothed if isinstance(event, RunEnded) else event.step.smoothed)

    for index in range(COUNT):
        if index in changes:
            other = resolve({**GIVEN, **changes[index]})
            pipeline.engine.retune(other.model, other.rule)
        for radar, layout in enumerate(config.inputs):
            report = detections.from_msg(cloud(index, radar), layout)
            take(pipeline.add(radar, report.stamp_ns, report.detections))
    take(pipeline.flush())
    return [[bytes(estimates.to_msg(one, "map").data) for one in source] for source in found]


def test_gaussians_are_tracked_live_as_offline_while_parameters_change(processes, peer):
    figures = peer.collect(DiagnosticArray, "/tracker/cardinality")
    numbers = {n: peer.collect(Float64, f"/tracker/plot/{n}") for n in ("hypotheses", "origins")}
    processes.start("tracker", "--ros-args", *options(**GIVEN), *RELIABLE)
    group = connected(peer)
    for index in range(COUNT):
        if index in CHANGES:
            changed = [Parameter(k, value=v).to_parameter_msg() for k, v in CHANGES[index].items()]
            request = SetParametersAtomically.Request(parameters=changed)
            service = "/tracker/set_parameters_atomically"
            assert peer.call(SetParametersAtomically, service, request).result.successful
        group.track(index)
    assert group.ask("flush").success
    group.until_smoothed(COUNT)
    found = [[bytes(c.data) for c in source] for source in (group.filtered, group.smoothed)]
    assert found == offline(CHANGES) != offline({})
    assert any(found[0])

    assert peer.spin_until(lambda: figures and all(numbers.values()))
    values = diagnostics.values_of(figures[-1].status[0])
    assert int(values["hypotheses"]) >= int(values["origins"]) > 0
    assert group.health.values("step time")["approximate_clusters"] == "0"
