"""A managed tracker with three unlike radars, driven as a launch system would, against the truth.

The radars have rates, phases, field names and conventions of their own; one reports decibels and
azimuths from north. Everything an operator does happens on the way.
"""

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from live_radars import Health, change, options, reliable, state_of
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud, stamps
from msg_adapters.incoming import detections
from msg_adapters.targets import estimates
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.core.state_space import PLANAR, VX, VY, X, Y
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.simulation.simulate import detect

START_NS = 1_700_000_000 * 10**9
SCENE_S = 36.0
PERIOD_S = {"north": 2.0, "south": 3.0, "east": 2.5}
PHASE_S = {"north": 0.0, "south": 0.7, "east": 1.3}
CUTOFF_M = 500.0
# It is about 30 m, and more than 200 m with any one radar misread.
OSPA_BOUND_M = 100.0

MEASURES = {"range_std": 60.0, "azimuth_std_deg": 0.3, "clutter_rate": 5.0}
PARAMETERS = {
    "sensors": ["north", "south", "east"],
    "interval_s": 2.0,
    "lag_s": 5.0,
    # Far apart, so that one report separates them if its unit is right.
    "class_0": {"snr_band_db": [50.0, 70.0]},
    "class_1": {"snr_band_db": [10.0, 30.0]},
    "births": ["one", "two", "three"],
    "one": {"position": [-4e3, 4e3], "velocity": [100.0, -60.0], "std": [200.0, 20.0, 1e-3]},
    "two": {"position": [5e3, -3e3], "velocity": [-90.0, 80.0], "std": [200.0, 20.0, 1e-3]},
    "three": {"position": [-3e3, -6e3], "velocity": [60.0, 100.0], "std": [200.0, 20.0, 1e-3]},
    "north": {
        **MEASURES,
        "topic": "/drivers/north/plots",
        "position": [0.0, 9e3],
        "fields": {"range": "distance", "azimuth": "bearing", "amplitude": ""},
    },
    "south": {
        **MEASURES,
        "topic": "/drivers/south/targets",
        "position": [1e3, -9e3],
        "fields": {"range": "rho", "azimuth": "theta", "amplitude": "snr"},
        "units.amplitude": "db",
        "units.azimuth_convention": "compass_cw",
    },
    "east": {
        **MEASURES,
        "frame": "east_mount",
        "position": [9e3, 0.0],
        "yaw_deg": 150.0,
        "fields": {"amplitude": ""},
    },
}
GIVEN = dict(flatten(PARAMETERS))
MODEL = resolve(GIVEN).model

CLASS_ID = np.array([0, 1, 0])
SNR = 10.0 ** (np.array([60.0, 20.0, 60.0]) / 10.0)


def truth_at(second):
    state = np.zeros((3, len(PLANAR)))
    for row, birth in enumerate(MODEL.births):
        state[row] = birth.mean
        state[row, [X, Y]] += second * state[row, [VX, VY]]
    return Truth(START_NS + round(second * 1e9), state, np.arange(1, 4), CLASS_ID)


def as_sent(name, found, stamp_ns):
    """Return the cloud that the radar's driver would publish."""
    distance, azimuth = found.measurement.T
    if name == "north":
        return point_cloud.encode(stamp_ns, "north", {"bearing": azimuth, "distance": distance})
    if name == "south":
        from_north = np.mod(np.pi / 2.0 - azimuth, 2.0 * np.pi)
        columns = {
            "snr": 10.0 * np.log10(found.amplitude**2 / 2.0),
            "rho": distance,
            "theta": from_north,
        }
        return point_cloud.encode(stamp_ns, "south", columns)
    return detections.to_msg(found, stamp_ns, "east_mount")


def scene():
    """Return (radar's index, cloud) of every scan, in the order of the stamps."""
    rng = np.random.default_rng(5)
    reports = []
    for index, name in enumerate(PARAMETERS["sensors"]):
        for second in np.arange(PHASE_S[name], SCENE_S, PERIOD_S[name]):
            truth = truth_at(second)
            found, _ = detect(truth, SNR, MODEL.radars[index], rng)
            reports.append((truth.stamp_ns, index, as_sent(name, found, truth.stamp_ns)))
    return [(index, cloud) for _, index, cloud in sorted(reports, key=lambda report: report[:2])]


SCENE = scene()
STAMPS = [stamps.to_ns(cloud.header.stamp) for _, cloud in SCENE]


def second_half_ospa(found):
    """Return the mean OSPA over both classes and the scans of the second half."""
    scores = []
    for one in found:
        truth = truth_at((one.stamp_ns - START_NS) * 1e-9)
        if one.stamp_ns < START_NS + SCENE_S / 2 * 1e9:
            continue
        for class_id in (0, 1):
            true = truth.state[truth.class_id == class_id][:, [X, Y]]
            guess = one.state[one.class_id == class_id][:, [X, Y]]
            scores.append(ospa(true, guess, CUTOFF_M, 2.0).distance)
    assert len(scores) > 20
    return np.mean(scores)


class Operator:
    """Drives a live tracker: its life, its parameters, its radars."""

    def __init__(self, peer):
        self.peer = peer
        topics = [radar.topic for radar in resolve(GIVEN).inputs]
        self.outputs = [peer.publisher(PointCloud2, topic, 50) for topic in topics]
        self.filtered = peer.collect(PointCloud2, "/tracker/filtered/estimates")
        self.smoothed = peer.collect(PointCloud2, "/tracker/smoothed/estimates")
        self.health = Health(peer)

    def set(self, **values):
        """Set parameters together; a double underscore stands for the dot."""
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(name.replace("__", "."), value=value).to_parameter_msg()
                for name, value in values.items()
            ]
        )
        service = "/tracker/set_parameters_atomically"
        return self.peer.call(SetParametersAtomically, service, request).result

    def get(self, *names):
        request = GetParameters.Request(names=names)
        reply = self.peer.call(GetParameters, "/tracker/get_parameters", request)
        return [parameter_value_to_python(value) for value in reply.values]

    def connect(self):
        assert self.peer.spin_until(
            lambda: (
                all(output.get_subscription_count() for output in self.outputs)
                and self.peer.node.count_publishers("/tracker/smoothed/estimates")
            )
        )
        self.peer.meet()

    def send(self, first, last):
        """Send scans one by one; wait each time for the estimates of the scan before."""
        for k in range(first, last):
            index, cloud = SCENE[k]
            self.outputs[index].publish(cloud)
            before = START_NS if k == first else STAMPS[k - 1]
            assert k == first or self.peer.spin_until(
                lambda before=before: self.filtered and stamp_of(self.filtered[-1]) >= before
            ), f"scan {k}"


def stamp_of(cloud):
    return stamps.to_ns(cloud.header.stamp)


def test_tracker_follows_its_operators_transitions(processes, peer, tmp_path):
    profile = tmp_path / "radars.yaml"
    profile.write_text(yaml.safe_dump({"/**/tracker": {"ros__parameters": PARAMETERS}}))
    words = (
        *options(autostart=False),
        *reliable(*(radar.topic for radar in resolve(GIVEN).inputs)),
    )
    tracker = processes.start("tracker", "--ros-args", "--params-file", profile, *words)
    operator = Operator(peer)
    half = len(SCENE) // 2

    # Unconfigured it has no topics and reports its state.
    assert state_of(peer) == "unconfigured"
    assert not peer.node.count_subscribers("/drivers/north/plots")
    words = "the tracker is unconfigured"
    assert operator.health.until_level("south", DiagnosticStatus.STALE, words)
    # Not every transition is there from every state; asking for another does no harm.
    assert not change(peer, "ACTIVATE")

    # Inactive it receives nothing.
    assert change(peer, "CONFIGURE")
    operator.connect()
    for index, cloud in SCENE[:4]:
        operator.outputs[index].publish(cloud)
    peer.meet(times=len(SCENE[:4]))
    assert not operator.filtered

    assert change(peer, "ACTIVATE")
    assert state_of(peer) == "active"
    operator.send(0, half)

    # A change is refused whole, with every reason.
    result = operator.set(existence=[0.9], north__clutter_rate=-1.0, lag=9)
    assert not result.successful
    assert "north.clutter_rate: -1.0 given, must be a finite number, at least 0" in result.reason
    assert "lag: cannot change while the tracker is configured" in result.reason
    assert operator.get("existence", "north.clutter_rate") == [[0.0, 0.0], 5.0]

    # An accepted one holds from the next scan on: nothing is that likely.
    never = {"existence": [1.0, 1.0]}
    assert operator.set(**never, east__clutter_rate=6).successful
    assert operator.get(*never, "east.clutter_rate") == [[1.0, 1.0], 6.0]
    operator.send(half, half + 2)
    assert operator.set(existence=[0.0, 0.0], east__clutter_rate=5.0).successful
    assert peer.spin_until(lambda: stamp_of(operator.filtered[-1]) >= STAMPS[half])
    widths = {stamp_of(cloud): cloud.width for cloud in operator.filtered}
    assert widths[STAMPS[half - 2]] == 3
    assert widths[STAMPS[half]] == 0

    operator.send(half + 2, len(SCENE))
    operator.health.fresh("south")
    assert {found[-1].level for found in operator.health.all().values()} <= {
        DiagnosticStatus.OK,
        DiagnosticStatus.STALE,  # Nothing is sent while this waits for the report
    }

    # Deactivating brings out what was held back.
    assert change(peer, "DEACTIVATE")
    assert peer.spin_until(lambda: len(operator.smoothed) == len(SCENE))
    operator.outputs[0].publish(SCENE[0][1])
    peer.meet(times=2)
    assert [stamp_of(cloud) for cloud in operator.filtered] == STAMPS
    assert [stamp_of(cloud) for cloud in operator.smoothed] == STAMPS

    for source in (operator.filtered, operator.smoothed):
        found = [
            estimates.from_msg(cloud)
            for cloud in source
            if stamp_of(cloud) not in STAMPS[half - 1 : half + 2]
        ]
        assert second_half_ospa(found) < OSPA_BOUND_M

    assert change(peer, "CLEANUP")
    assert peer.spin_until(lambda: not peer.node.count_publishers("/tracker/filtered/estimates"))
    assert change(peer, "UNCONFIGURED_SHUTDOWN")
    assert state_of(peer) == "finalized"
    tracker.terminate()
    assert tracker.wait(5.0) == 0
    assert "Traceback" not in tracker.log.read_text()
