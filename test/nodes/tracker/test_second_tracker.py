"""One tracker of a name; a second ends by itself."""

import signal
import time

import reference
from live_radars import SCANS, connected, options, start_tracker
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

CLAIMS = "/tracker/_instance"
LATCHED = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# With so many particles a step takes seconds.
BUSY = {"engine": "phd", "particles": [30000]}
SAID = "another tracker runs as /tracker: this one ends"


def started(processes, peer, *arguments):
    """Start a tracker; return its process once it tracks."""
    process = start_tracker(processes, *arguments)
    peer.said(process, "tracking")
    return process


def holders(peer, topic=CLAIMS):
    """Return the claims, as they come, of trackers that hold the name and no longer give way."""
    found = []
    peer.node.create_subscription(
        String,
        topic,
        lambda claim: claim.data.startswith("holds ") and found.append(claim),
        LATCHED,
    )
    return found


def test_second_tracker_of_a_name_ends_and_leaves_the_checkpoint(processes, peer, tmp_path):
    path = tmp_path / "tracker.ckpt"
    own = options(**{"checkpoint.path": path, "checkpoint.every": 0})
    first = started(processes, peer, *own)
    radars = connected(peer)
    radars.track(0)
    assert radars.ask("checkpoint").success
    before = path.read_bytes()
    holding = holders(peer)
    # Beside a newcomer, and beside one that holds the name.
    for index in (1, 2):
        second = start_tracker(processes, *own)
        assert second.wait(15.0) == 2
        text = second.log.read_text()
        assert text.count(SAID) == 1
        assert SAID in text.splitlines()[-1]
        assert "Traceback" not in text
        assert path.read_bytes() == before
        # The first has not noticed.
        radars.track(index)
        assert first.poll() is None
        assert peer.spin_until(lambda: holding)


def test_second_tracker_ends_beside_one_that_is_busy(processes, peer):
    # With so many particles it would answer a request only after several scans.
    first = started(processes, peer, *options(**reference.parameters(BUSY)))
    radars = connected(peer)
    sent, end = 10, time.monotonic() + 60.0
    # Its queue holds as many, so that it is busy before the second comes.
    for index in range(sent):
        radars.send(index)
    second = start_tracker(processes)
    while second.poll() is None and time.monotonic() < end:
        stamp_ns = SCANS[0].stamp_ns + sent * (SCANS[1].stamp_ns - SCANS[0].stamp_ns)
        radars.send(sent % len(SCANS), stamp_ns=stamp_ns)
        sent += 1
        peer.pace(0.15)
    assert second.poll() == 2
    assert len(radars.filtered) < sent - 1  # Busy to the end
    assert first.poll() is None


def test_one_of_several_trackers_started_at_once_stays(processes, peer):
    holding = holders(peer)
    together = [start_tracker(processes) for _ in range(3)]
    assert peer.spin_until(lambda: sum(process.poll() is None for process in together) <= 1)
    assert peer.spin_until(lambda: holding)
    status = sorted(str(process.poll()) for process in together)
    assert status == ["2", "2", "None"]
    (stays,) = [process for process in together if process.poll() is None]
    peer.said(stays, "tracking")


def test_killed_tracker_does_not_hold_up_its_restart(processes, peer):
    killed = started(processes, peer)
    holding = holders(peer)
    assert peer.spin_until(lambda: holding)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    again = started(processes, peer)
    # The killed one is in the graph still.
    assert peer.spin_until(lambda: peer.node.count_publishers(CLAIMS) == 2)
    connected(peer).track(0)
    assert peer.spin_until(lambda: len({claim.data for claim in holding}) == 2)
    assert again.poll() is None
    assert SAID not in again.log.read_text()


def test_trackers_of_other_names_or_namespaces_run_side_by_side(processes, peer):
    names = ("/tracker", "/tracker_2", "/north/tracker")
    holding = [holders(peer, f"{name}/_instance") for name in names]
    remapped = ((), ("-r", "__node:=tracker_2"), ("-r", "__ns:=/north"))
    together = [start_tracker(processes, *words) for words in remapped]
    for process in together:
        peer.said(process, "tracking")
    assert peer.spin_until(lambda: all(holding))
    assert [process.poll() for process in together] == [None] * 3


def test_what_is_no_claim_of_an_older_node_ends_none(processes, peer):
    output = peer.publisher(String, CLAIMS, LATCHED)
    tracker = started(processes, peer)
    assert peer.spin_until(output.get_subscription_count)
    younger = f"claims {time.time_ns() + 10**12:020d} {0:032x}"
    for data in ("", "holds", "holds  ", "holds 1 2", "claims 0 0", "claims\n0 0", younger):
        output.publish(String(data=data))
    # Bytes that are no string.
    head = b"\x00\x01\x00\x00"
    for body in (b"", b"\xff" * 4, b"\x06\x00\x00\x00hol\xff\xfe\x00", b"\x03\x00\x00\x00abc"):
        output.publish(head + body)
    peer.meet(times=20)
    assert tracker.poll() is None
    assert "Traceback" not in tracker.log.read_text()
