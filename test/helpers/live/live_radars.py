"""Two radars that send the reference scenario to a live tracker, and what it takes to start one."""

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from reference import resolve
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters.encoding import names
from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate


def options(**values):
    """Return the ROS arguments that set parameters."""
    return [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]


def reliable(*topics):
    """Return the ROS arguments with which a node subscribes to topics reliably."""
    return options(**{f"qos_overrides.{t}.subscription.reliability": "reliable" for t in topics})


FAST = options(accuracy="fast", lag=2)
TOPICS = tuple(names.detections(radar) for radar in ("radar_1", "radar_2"))
RELIABLE = reliable(*TOPICS)
SCANS = [scan for _, scan in simulate(paper_scenario(resolve({}).model.radars), 0)]


def cloud(index, radar, found=None, stamp_ns=None, frame=None):
    """Return a radar's cloud of a scan; other detections, another stamp or frame if given."""
    scan = SCANS[index]
    found = scan.detections[radar] if found is None else found
    return detections.to_msg(found, stamp_ns or scan.stamp_ns, frame or f"radar_{radar + 1}")


class Health:
    """The statuses that a node reports on ``/diagnostics``."""

    def __init__(self, peer, node=names.TRACKER):
        self.peer, self.node = peer, node
        self.reports = peer.collect(DiagnosticArray, names.DIAGNOSTICS, 100)

    def all(self):
        """Return all statuses of the node so far, by name without the node's, in order."""
        found = {}
        for status in (status for report in self.reports for status in report.status):
            node, _, name = status.name.partition(": ")
            if node == self.node:
                found.setdefault(name, []).append(status)
        return found

    def until(self, name, fits):
        """Wait for a status that fits, with its values; return it."""

        def latest():
            return self.all().get(name, [None])[-1]

        def fitting():
            status = latest()
            return status is not None and fits(status, diagnostics.values_of(status))

        assert self.peer.spin_until(fitting), latest()
        return latest()

    def until_level(self, name, level, words=""):
        """Wait for a status of a level with these words; return it."""
        return self.until(name, lambda status, _: status.level == level and words in status.message)

    def fresh(self, name):
        """Return a status of the next report but one, which was made after this call."""
        before = len(self.all().get(name, ()))
        assert self.peer.spin_until(lambda: len(self.all().get(name, ())) > before + 1)
        return self.all()[name][-1]

    def values(self, name):
        """Return the values of a `fresh` status."""
        return diagnostics.values_of(self.fresh(name))


class Radars:
    """Publishes clouds to a live tracker and receives its outputs."""

    def __init__(self, peer):
        self.peer = peer
        self.outputs = [peer.publisher(PointCloud2, topic, 50) for topic in TOPICS]
        self.filtered = peer.collect(PointCloud2, "/tracker/filtered/estimates")
        self.smoothed = peer.collect(PointCloud2, "/tracker/smoothed/estimates")
        self.health = Health(peer)

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
        for radar in radars:
            self.outputs[radar].publish(cloud(index, radar, stamp_ns=stamp_ns))

    def track(self, index, radars=(0, 1), stamp_ns=None):
        """Send a scan and wait for its estimate; return its bytes."""
        before = len(self.filtered)
        self.send(index, radars, stamp_ns)
        assert self.peer.spin_until(lambda: len(self.filtered) > before), f"scan {index}"
        return bytes(self.filtered[-1].data)

    def track_all(self, *indices):
        """Track scans; return the bytes of their estimates."""
        return [self.track(index) for index in indices]

    def ask(self, service):
        """Call one of the tracker's services; return the reply."""
        return self.peer.call(Trigger, f"/tracker/{service}")

    def until_smoothed(self, count):
        assert self.peer.spin_until(lambda: len(self.smoothed) >= count)


def change(peer, *transitions, node=names.TRACKER):
    """Ask a node for transitions of its lifecycle by name; return whether all were made."""
    ids = (getattr(Transition, f"TRANSITION_{name}") for name in transitions)
    requests = (ChangeState.Request(transition=Transition(id=number)) for number in ids)
    return all(peer.call(ChangeState, f"{node}/change_state", each).success for each in requests)


def start_tracker(processes, *arguments, qos=RELIABLE, **environment):
    """Start a tracker with short steps; return its process."""
    return processes.start("tracker", "--ros-args", *FAST, *qos, *arguments, **environment)


def state_of(peer):
    return peer.call(GetState, "/tracker/get_state").current_state.label


def connected(peer):
    """Return two radars that a tracker has found."""
    group = Radars(peer)
    group.connect()
    return group
