"""One tracker of a name; a second ends by itself."""

import signal
import time

import pytest
from live_radars import FAST, RELIABLE, SCANS, Radars
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

CLAIMS = "/tracker/_instance"
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEEP = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEADLINE_S = 60.0
SAID = "another tracker runs as /tracker: this one ends"


def start(processes, *arguments):
    return processes.start("tracker", "--ros-args", *FAST, *RELIABLE, *arguments)


def tracking(peer, process):
    return peer.spin_until(lambda: "tracking" in process.log.read_text())


def holders(peer, topic=CLAIMS):
    """Return the claims, as they come, of trackers that hold the name and no longer give way."""
    found = []
    peer.node.create_subscription(
        String, topic, lambda claim: claim.data.startswith("holds ") and found.append(claim), DEEP
    )
    return found


def ended(process, timeout=15.0):
    end = time.monotonic() + timeout
    while process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    return process.poll()


@pytest.mark.parametrize("newcomer", [True, False])
def test_second_tracker_of_the_same_name_ends_with_an_error(processes, peer, newcomer):
    first = start(processes)
    assert tracking(peer, first)
    if not newcomer:
        holding = holders(peer)
        assert peer.spin_until(lambda: holding)
    radars = Radars(peer)
    radars.connect()
    radars.track(0)
    second = start(processes)
    assert ended(second) == 2
    text = second.log.read_text()
    assert text.count(SAID) == 1
    assert SAID in text.splitlines()[-1]
    assert "Traceback" not in text
    # The first has not noticed.
    radars.track(1)
    assert first.poll() is None


def test_second_tracker_ends_beside_one_that_is_busy(processes, peer):
    # With so many particles it would answer a request only after several scans.
    first = start(processes, "-p", "particles_per_target:=30000")
    assert tracking(peer, first)
    radars = Radars(peer)
    radars.connect()
    sent, end = 10, time.monotonic() + DEADLINE_S
    # Its queue holds as many, so that it is busy before the second comes.
    for index in range(sent):
        radars.send(index)
    second = start(processes)
    while second.poll() is None and time.monotonic() < end:
        stamp_ns = SCANS[0].stamp_ns + sent * (SCANS[1].stamp_ns - SCANS[0].stamp_ns)
        radars.send(sent % len(SCANS), stamp_ns=stamp_ns)
        sent += 1
        peer.pace(0.15)
    assert second.poll() == 2
    assert len(radars.filtered) < sent - 1  # busy to the end
    assert first.poll() is None


def test_one_of_several_trackers_started_at_once_stays(processes, peer):
    holding = holders(peer)
    together = [start(processes) for _ in range(3)]
    assert peer.spin_until(lambda: sum(process.poll() is None for process in together) <= 1)
    assert peer.spin_until(lambda: holding)
    status = sorted(str(process.poll()) for process in together)
    assert status == ["2", "2", "None"]
    (stays,) = [process for process in together if process.poll() is None]
    assert tracking(peer, stays)


def test_killed_tracker_does_not_hold_up_its_restart(processes, peer):
    killed = start(processes)
    assert tracking(peer, killed)
    holding = holders(peer)
    assert peer.spin_until(lambda: holding)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    again = start(processes)
    assert tracking(peer, again)
    radars = Radars(peer)
    # The killed one is in the graph still.
    assert peer.spin_until(lambda: peer.node.count_publishers(CLAIMS) == 2)
    radars.connect(before=(0, 0, 0))
    radars.track(0)
    assert peer.spin_until(lambda: len({claim.data for claim in holding}) == 2)
    assert again.poll() is None
    assert SAID not in again.log.read_text()


def test_trackers_of_other_names_or_namespaces_run_side_by_side(processes, peer):
    names = ("/tracker", "/tracker_2", "/north/tracker")
    holding = [holders(peer, f"{name}/_instance") for name in names]
    others = [start(processes, "-r", other) for other in ("__node:=tracker_2", "__ns:=/north")]
    together = [start(processes), *others]
    assert all(tracking(peer, process) for process in together)
    assert peer.spin_until(lambda: all(holding))
    assert [process.poll() for process in together] == [None] * 3


def test_second_tracker_leaves_the_checkpoint_alone(processes, peer, tmp_path):
    path = tmp_path / "tracker.ckpt"
    option = ("-p", f"checkpoint.path:={path}")
    first = start(processes, *option)
    assert tracking(peer, first)
    radars = Radars(peer)
    radars.connect()
    radars.track(0)
    assert peer.call(Trigger, "/tracker/checkpoint").success
    before = path.read_bytes()
    assert ended(start(processes, *option)) == 2
    assert path.read_bytes() == before


def test_what_is_no_claim_of_an_older_node_ends_none(processes, peer):
    output = peer.publisher(String, CLAIMS, LATCHED)
    tracker = start(processes)
    assert tracking(peer, tracker)
    assert peer.spin_until(output.get_subscription_count)
    younger = f"claims {time.time_ns() + 10**12:020d} {0:032x}"
    for data in ("", "holds", "holds  ", "holds 1 2", "claims 0 0", "claims\n0 0", younger):
        output.publish(String(data=data))
    peer.meet(times=10)
    assert tracker.poll() is None


def test_bytes_that_are_no_string_end_no_node(processes, peer):
    output = peer.publisher(String, CLAIMS, LATCHED)
    tracker = start(processes)
    assert tracking(peer, tracker)
    assert peer.spin_until(output.get_subscription_count)
    head = b"\x00\x01\x00\x00"
    for body in (
        b"",
        b"\xff\xff\xff\xff",
        b"\x06\x00\x00\x00hol\xff\xfe\x00",
        b"\x03\x00\x00\x00abc",
    ):
        output.publish(head + body)
    peer.meet(times=10)
    assert tracker.poll() is None
    assert "Traceback" not in tracker.log.read_text()
