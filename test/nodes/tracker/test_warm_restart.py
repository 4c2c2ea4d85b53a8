"""A tracker that is killed goes on where its checkpoint ends."""

import os

import reference
from altered_nodes import failing_tracker
from live_radars import FAST, RELIABLE, Radars, connected, options, start_tracker
from std_srvs.srv import Trigger

KILLED_AFTER, SCANS = 5, 8


def storing(path, every=None, **others):
    asked = {} if every is None else {"checkpoint.every": every}
    return options(**{"checkpoint.path": path, **asked, **others})


def tracked(peer, processes, first, last, *arguments):
    """Track some scans with a new tracker; return it, its radars and its estimates of each."""
    group = Radars(peer)
    # A killed one stays in the graph for a while.
    peer.settled(*group.outputs)
    before = group.known()
    process = start_tracker(processes, *arguments)
    group.connect(before)
    return process, group, group.track_all(*range(first, last))


def end(peer, process, group, kill=False):
    (process.kill if kill else process.terminate)()
    process.wait(10.0)
    for output in group.outputs:
        peer.node.destroy_publisher(output)
    topic = "/tracker/filtered/estimates"
    subscription = next(s for s in peer.node.subscriptions if s.topic_name == topic)
    peer.node.destroy_subscription(subscription)


def test_killed_tracker_goes_on_as_if_it_had_never_stopped(processes, peer, tmp_path):
    process, group, whole = tracked(peer, processes, 0, SCANS)
    end(peer, process, group)
    path = tmp_path / "tracker.ckpt"
    process, group, _ = tracked(peer, processes, 0, KILLED_AFTER, *storing(path))
    peer.meet()  # It is written after the estimates have gone out
    end(peer, process, group, kill=True)
    assert path.exists()
    process, group, rest = tracked(peer, processes, KILLED_AFTER, SCANS, *storing(path))
    assert rest == whole[KILLED_AFTER:]
    assert "continuing from" in process.log.read_text()
    assert peer.call(Trigger, "/tracker/flush").success
    assert not path.exists()  # A run that has ended has nothing to go on from.


def test_stopped_tracker_leaves_a_checkpoint_that_others_refuse(processes, peer, tmp_path):
    path = tmp_path / "tracker.ckpt"
    process, group, first = tracked(peer, processes, 0, 2, *storing(path, 0))
    assert not path.exists()
    # The service replies whether it wrote one.
    assert group.ask("checkpoint").success
    assert path.exists()
    path.unlink()
    end(peer, process, group)
    assert process.returncode == 0
    stored = path.read_bytes()
    for spoilt, at, given, said in (
        (stored[:-7], 0, {}, "damaged"),
        (stored, 14, {}, "at most 60 s are allowed"),
        (stored, 2, {"interval_s": 7.0}, "of a tracker with another interval_s"),
    ):
        path.write_bytes(spoilt)
        process, group, found = tracked(peer, processes, at, at + 2, *storing(path, 0, **given))
        end(peer, process, group)
        log = process.log.read_text()
        assert "starting cold" in log
        assert said in log
        assert at or found == first
    path.unlink()
    limited = storing(path, max_gap_scans=2)
    end(peer, *tracked(peer, processes, 0, 2, *limited)[:2])
    process, *_ = tracked(peer, processes, 4, 5, *limited)
    assert "at most 12 s are allowed" in process.log.read_text()


def test_checkpoint_path_of_something_else_is_a_bad_parameter(processes, tmp_path):
    mine, pipe = tmp_path / "mine.yaml", tmp_path / "pipe"
    mine.write_text("mine")
    os.mkfifo(pipe)
    for path, fault in (
        (tmp_path / "none" / "x", f"{tmp_path / 'none'} is no directory"),
        (tmp_path, "a directory is there, only a checkpoint is replaced"),
        (mine, "a file that is no checkpoint is there, only a checkpoint is replaced"),
        (pipe, "a pipe is there, only a checkpoint is replaced"),
    ):
        process = start_tracker(processes, *storing(path))
        assert process.wait(20.0) == 2
        assert f"checkpoint.path: {path} given, {fault}\n" in process.log.read_text()
    assert mine.read_text() == "mine"


def test_checkpoint_of_a_filter_that_keeps_no_state_is_a_bad_parameter(processes, tmp_path):
    path = tmp_path / "tracker.ckpt"
    known = {**reference.parameters(), "engine": "phd_gaussian"}
    process = start_tracker(processes, *storing(path, **known))
    assert process.wait(20.0) == 2
    fault = f"checkpoint.path: {path} given, must be empty with engine phd_gaussian\n"
    assert fault in process.log.read_text()


def test_tracker_goes_on_where_something_else_took_the_place_of_its_checkpoint(
    processes, peer, tmp_path
):
    path = tmp_path / "tracker.ckpt"
    process, group, _ = tracked(peer, processes, 0, 2, *storing(path))
    peer.meet()
    path.unlink()
    os.mkfifo(path)
    assert len(group.track_all(2, 3)) == 2
    done = group.ask("checkpoint")
    fault = f"no checkpoint: {path}: a pipe is there, only a checkpoint is replaced"
    assert (done.success, done.message) == (False, fault)
    assert process.log.read_text().count(fault) == 1
    assert path.is_fifo()


def test_tracker_that_fails_half_way_leaves_the_checkpoint_before_it(processes, peer, tmp_path):
    path = tmp_path / "tracker.ckpt"
    words = ["--ros-args", *FAST, *RELIABLE, *storing(path, 2)]
    process = processes.start(failing_tracker, *words)
    group = connected(peer)
    group.track_all(0, 1)
    assert peer.spin_until(path.exists)
    before = path.read_bytes()
    group.send(2)
    # The scan is closed by both radars.
    assert peer.spin_until(lambda: process.poll() is not None)
    assert process.returncode == 1
    assert "half-way" in process.log.read_text()
    assert path.read_bytes() == before
