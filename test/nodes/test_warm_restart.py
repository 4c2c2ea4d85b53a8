"""A tracker that is killed goes on where its checkpoint ends."""

import subprocess
import sys

import pytest
from live_radars import FAST, RELIABLE, Radars
from std_srvs.srv import Trigger

from phd_jdtc_ros.configuration.engines import ENGINES

KILLED_AFTER, SCANS = 5, 8


def start(processes, path, every=1, *others):
    options = [f"checkpoint.path:={path}", f"checkpoint.every:={every}", *others]
    words = [word for option in options for word in ("-p", option)]
    return processes.start("tracker", "--ros-args", *FAST, *RELIABLE, *words)


def tracked(peer, processes, first, last, *arguments):
    """Track some scans with a new tracker; return it, its radars and its estimates of each."""
    group = Radars(peer)
    # A killed one stays in the graph for a while.
    peer.settled(*group.outputs)
    before = group.known()
    process = start(processes, *arguments)
    group.connect(before)
    for index in range(first, last):
        group.track(index)
    return process, group, [bytes(cloud.data) for cloud in group.filtered]


def end(peer, process, group, kill=False):
    (process.kill if kill else process.terminate)()
    process.wait(10.0)
    for output in group.outputs:
        peer.node.destroy_publisher(output)
    topic = "/tracker/filtered/estimates"
    subscription = next(s for s in peer.node.subscriptions if s.topic_name == topic)
    peer.node.destroy_subscription(subscription)


@pytest.mark.parametrize("engine", ENGINES)
def test_killed_tracker_goes_on_as_if_it_had_never_stopped(processes, peer, tmp_path, engine):
    chosen = 1, f"engine:={engine}"
    process, group, whole = tracked(peer, processes, 0, SCANS, tmp_path / "other", *chosen)
    end(peer, process, group)
    path = tmp_path / "tracker.ckpt"
    process, group, _ = tracked(peer, processes, 0, KILLED_AFTER, path, *chosen)
    peer.meet()  # it is written after the estimates have gone out
    end(peer, process, group, kill=True)
    assert path.exists()
    process, group, rest = tracked(peer, processes, KILLED_AFTER, SCANS, path, *chosen)
    assert rest == whole[KILLED_AFTER:]
    assert "going on from" in process.log.read_text()
    assert peer.call(Trigger, "/tracker/flush").success
    assert not path.exists()  # a run that has ended has nothing to go on from


def test_stopped_tracker_leaves_a_checkpoint_and_its_service_replies_whether_it_wrote_one(
    processes, peer, tmp_path
):
    path = tmp_path / "tracker.ckpt"
    process, group, _ = tracked(peer, processes, 0, 3, path, 0)
    assert not path.exists()
    assert peer.call(Trigger, "/tracker/checkpoint").success
    assert path.exists()
    path.unlink()
    end(peer, process, group)
    assert process.returncode == 0
    assert path.exists()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:-7]), "damaged"),
        (lambda path: path.write_bytes(b"something else"), "not a checkpoint"),
    ],
    ids=["damaged", "foreign"],
)
def test_unusable_checkpoint_is_refused_with_a_reason(processes, peer, tmp_path, spoil, said):
    path = tmp_path / "tracker.ckpt"
    process, group, first = tracked(peer, processes, 0, 2, path)
    end(peer, process, group)
    spoil(path)
    process, group, again = tracked(peer, processes, 0, 2, path)
    assert again == first
    log = process.log.read_text()
    assert "starting cold" in log
    assert said in log


def test_stale_checkpoint_and_one_of_another_tracker_are_refused(processes, peer, tmp_path):
    path = tmp_path / "tracker.ckpt"
    process, group, _ = tracked(peer, processes, 0, 2, path)
    end(peer, process, group)
    process, group, _ = tracked(peer, processes, 14, 15, path, 0)
    end(peer, process, group)
    assert "at most 60 s are allowed" in process.log.read_text()
    process, group, _ = tracked(peer, processes, 2, 3, path, 0, "lag:=3")
    assert "another lag" in process.log.read_text()


@pytest.mark.parametrize("engine", ENGINES)
def test_checkpoint_of_another_engine_is_refused_with_a_reason(processes, peer, tmp_path, engine):
    (other,) = ENGINES.keys() - {engine}
    path = tmp_path / "tracker.ckpt"
    process, group, _ = tracked(peer, processes, 0, 2, path, 1, f"engine:={other}")
    end(peer, process, group)
    process, group, _ = tracked(peer, processes, 2, 3, path, 1, f"engine:={engine}")
    log = process.log.read_text()
    assert "starting cold" in log
    assert "of a tracker with another engine" in log


def test_checkpoint_older_than_the_longest_gap_is_refused(processes, peer, tmp_path):
    path, limit = tmp_path / "tracker.ckpt", "max_gap_scans:=2"
    process, group, _ = tracked(peer, processes, 0, 2, path, 1, limit)
    end(peer, process, group)
    process, group, _ = tracked(peer, processes, 4, 5, path, 1, limit)
    assert "at most 12 s are allowed" in process.log.read_text()


def test_missing_directory_is_a_bad_parameter(processes, tmp_path):
    process = start(processes, tmp_path / "none" / "tracker.ckpt")
    assert process.wait(20.0) == 2
    assert "checkpoint.path" in process.log.read_text()


def test_directory_is_a_bad_parameter(processes, tmp_path):
    process = start(processes, tmp_path)
    assert process.wait(20.0) == 2
    assert f"checkpoint.path: {tmp_path} given, must be a file" in process.log.read_text()


# A step that fails when all of it but the last line is done.
FAILING = """
import sys
from phd_jdtc_ros.core.smc.engine import ParticleEngine
from phd_jdtc_ros.nodes.tracker import node
step = ParticleEngine.step
def fail(engine, scan, scans=[]):
    scans.append(scan)
    found = step(engine, scan)
    if len(scans) == 3:
        raise ArithmeticError("half-way")
    return found
ParticleEngine.step = fail
sys.exit(node.main(sys.argv[1:]))
"""


def test_tracker_that_fails_half_way_leaves_the_checkpoint_before_it(peer, tmp_path):
    path = tmp_path / "tracker.ckpt"
    options = ("-p", f"checkpoint.path:={path}", "-p", "checkpoint.every:=2")
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", FAILING, "--ros-args", *FAST, *RELIABLE, *options],
            stderr=log,
        )
    try:
        group = Radars(peer)
        group.connect()
        group.track(0)
        group.track(1)
        assert peer.spin_until(path.exists)
        before = path.read_bytes()
        group.send(2)
        # The scan is closed by both radars.
        assert peer.spin_until(lambda: process.poll() is not None)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 1
    assert "half-way" in (tmp_path / "log").read_text()
    assert path.read_bytes() == before
