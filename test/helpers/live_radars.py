"""Two radars that send the reference scenario to a live tracker, and what it takes to start one."""

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import PointCloud2

from msg_adapters import detections
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

FAST = (
    *("-p", "engine:=particles", "-p", "particles_per_target:=200"),
    *("-p", "particles_per_birth:=256", "-p", "lag:=2"),
)
RELIABLE = [
    word
    for radar in ("radar_1", "radar_2")
    for word in ("-p", f"qos_overrides./{radar}/detections.subscription.reliability:=reliable")
]
SCANS = [scan for _, scan in simulate(paper_scenario(resolve({}).model.radars), 0)]


class Radars:
    """Publishes clouds to a live tracker and receives its outputs."""

    def __init__(self, peer):
        self.peer = peer
        self.outputs = [peer.publisher(PointCloud2, f"/radar_{k}/detections", 50) for k in (1, 2)]
        self.filtered = peer.collect(PointCloud2, "/tracker/filtered/estimates")
        self.smoothed = peer.collect(PointCloud2, "/tracker/smoothed/estimates")
        self.health = peer.collect(DiagnosticArray, "/diagnostics")

    def known(self):
        """Return how many trackers subscribe to each radar, and how many publish."""
        answer = self.peer.node.count_publishers("/tracker/smoothed/estimates")
        return [*(output.get_subscription_count() for output in self.outputs), answer]

    def connect(self, before=(0, 0, 0)):
        """Wait for one tracker more than before."""
        assert self.peer.spin_until(
            lambda: all(now > then for now, then in zip(self.known(), before, strict=True))
        )
        self.peer.meet()

    def send(self, index, radars=(0, 1), stamp_ns=None):
        scan = SCANS[index]
        for radar in radars:
            cloud = detections.to_msg(
                scan.detections[radar], stamp_ns or scan.stamp_ns, f"radar_{radar + 1}"
            )
            self.outputs[radar].publish(cloud)

    def track(self, index, radars=(0, 1)):
        """Send a scan and wait for its estimate."""
        before = len(self.filtered)
        self.send(index, radars)
        assert self.peer.spin_until(lambda: len(self.filtered) > before), f"scan {index}"

    def drops(self, radar):
        """Wait for the next health report and return a radar's status."""
        before = len(self.health)
        assert self.peer.spin_until(lambda: len(self.health) > before + 1)
        return next(s for s in self.health[-1].status if s.name == f"/tracker: radar_{radar}")


def change(peer, transition):
    """Ask the tracker for a transition of its lifecycle; return whether it was made."""
    request = ChangeState.Request(transition=Transition(id=transition))
    return peer.call(ChangeState, "/tracker/change_state", request).success


def start_tracker(processes, *arguments, qos=RELIABLE):
    """Start a tracker with few particles; return its process."""
    return processes.start("tracker", "--ros-args", *FAST, *qos, *arguments)


def options(**values):
    """Return the ROS arguments that set parameters."""
    return [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]


def status_of(group, name):
    """Return the tracker's status of that name in the next health report but one."""
    before = len(group.health)
    assert group.peer.spin_until(lambda: len(group.health) > before + 1)
    return next(s for s in group.health[-1].status if s.name == f"/tracker: {name}")


def wait_for_level(group, name, level):
    """Wait until a status of the tracker has a level; return whether it has."""

    def reached():
        return any(s.name == f"/tracker: {name}" and s.level == level for s in statuses())

    def statuses():
        return group.health[-1].status if group.health else ()

    return group.peer.spin_until(reached)


def state_of(peer):
    """Return the tracker's lifecycle state."""
    return peer.call(GetState, "/tracker/get_state").current_state.label


def connected(peer):
    """Return two radars that a tracker has found."""
    group = Radars(peer)
    group.connect()
    return group
