import logging
import os
import pickle
import stat
from dataclasses import replace

import numpy as np
import pytest
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.nodes.tracker import checkpoint
from phd_jdtc_ros.nodes.tracker.checkpoint import MAGIC, CheckpointError
from phd_jdtc_ros.simulation.simulate import simulate

CONFIGURATION = {"lag": 5, "sensors": ["north", "south"], "seed": 0}


def snapshot():
    arrays = {
        "a.state": np.arange(10.0).reshape(2, 5).T,
        "a.mode": np.array([1, 2], dtype=np.uint8),
        "a.none": np.zeros((0, 3)),
        "a.count": np.array(7),
    }
    return Snapshot(42, arrays, {"big": 1 << 127})


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "tracker.ckpt"
    checkpoint.write(path, snapshot(), CONFIGURATION)
    return path


def test_checkpoint_comes_back_as_it_was_with_its_configuration(path):
    found = checkpoint.read(path, CONFIGURATION)
    assert found.json_values == snapshot().json_values
    assert found.arrays.keys() == snapshot().arrays.keys()
    for name, array in snapshot().arrays.items():
        np.testing.assert_array_equal(found.arrays[name], array)
        assert found.arrays[name].dtype == array.dtype
    with pytest.raises(CheckpointError, match="another lag, seed"):
        checkpoint.read(path, {**CONFIGURATION, "lag": 4, "seed": 1})


def test_every_flipped_byte_and_every_truncation_is_refused(path):
    whole = path.read_bytes()
    places = np.linspace(0, len(whole) - 1, 200).astype(int)
    for place in places:
        for damaged in (
            whole[:place],
            whole[:place] + bytes([whole[place] ^ 0x40]) + whole[place + 1 :],
        ):
            path.write_bytes(damaged)
            with pytest.raises(CheckpointError, match=r"tracker\.ckpt"):
                checkpoint.read(path, CONFIGURATION)


@pytest.mark.parametrize("after_s", [-1e3, 1e3])
def test_numbers_of_a_checkpoint_of_another_time_are_not_used_again(tmp_path, after_s):
    run = [scan for _, scan in simulate(short_scenario(8), 0)]
    later = [replace(scan, stamp_ns=scan.stamp_ns + round(after_s * 1e9)) for scan in run]
    path, log = tmp_path / "tracker.ckpt", logging.getLogger("tracker")
    before, restarted, cold = (new_engine(small({"lag": 2})) for _ in range(3))
    found = [before.step(scan).filtered[0] for scan in run]
    checkpoint.write(path, before.snapshot(), CONFIGURATION)
    stored = checkpoint.Checkpoints(path, 0, 60.0, CONFIGURATION, log)
    stored.resume(restarted, later[0].stamp_ns)
    used = {number for each in found for number in each.track_id.tolist()} - {0}
    assert used
    for scan in later:
        (ours,), (theirs,) = restarted.step(scan).filtered, cold.step(scan).filtered
        np.testing.assert_array_equal(ours.state, theirs.state)
        assert not used & {*ours.track_id.tolist()}


def test_code_in_a_checkpoint_is_not_executed(tmp_path):
    ran = tmp_path / "ran"

    class Hostile:
        """Makes a directory when it is unpickled."""

        def __reduce__(self):
            return os.mkdir, (str(ran),)

    body = pickle.dumps(Hostile())
    path = tmp_path / "hostile"
    path.write_bytes(MAGIC + checkpoint.hashlib.sha256(body).digest() + body)
    with pytest.raises(CheckpointError):
        checkpoint.read(path, CONFIGURATION)
    assert not ran.exists()


def test_a_checkpoint_of_another_version_is_a_cold_start_with_one_line(path):
    log = Log()
    path.write_bytes(path.read_bytes().replace(MAGIC, b"phd_jdtc_ros checkpoint 3\n", 1))
    checkpoint.Checkpoints(path, 0, 60.0, CONFIGURATION, log)
    (line,) = log.lines
    assert line == f"starting cold: {path}: not a checkpoint of this version"


def make(path, kind):
    """Put what is no checkpoint at a path; return how it is called."""
    path.unlink(missing_ok=True)
    if kind == "file":
        path.write_text("/tracker: {ros__parameters: {lag: 3}}\n")
        return "a file that is no checkpoint"
    if kind == "empty file":
        path.touch()
        return "a file that is no checkpoint"
    if kind == "link":
        path.symlink_to(path.parent / "nowhere")
        return "a symbolic link"
    if kind == "pipe":
        os.mkfifo(path)
        return "a pipe"
    path.mkdir()
    return "a directory"


@pytest.mark.parametrize("kind", ["file", "empty file", "link", "pipe", "directory"])
def test_what_is_no_checkpoint_is_neither_replaced_nor_deleted(path, kind):
    log = Log()
    kept = checkpoint.Checkpoints(path, 1, 60.0, CONFIGURATION, log)
    found = make(path, kind)
    before = path.lstat()
    kept.note_step(Engine())
    fault = f"{path}: {found} is there, only a checkpoint is replaced"
    assert log.lines == [f"no checkpoint: {fault}"]
    assert kept.fault == f"no checkpoint: {fault}"
    kept.discard()
    assert log.lines[1:] == [f"the checkpoint of the ended run was not deleted: {fault}"]
    assert path.lstat() == before
    assert [each for each in path.parent.iterdir() if each != path] == []
    (path.rmdir if kind == "directory" else path.unlink)()
    kept.note_step(Engine())
    assert kept.fault == ""
    assert checkpoint.read(path, CONFIGURATION).stamp_ns == 42


def test_checkpoint_of_another_version_is_replaced(path):
    path.write_bytes(path.read_bytes().replace(MAGIC, b"phd_jdtc_ros checkpoint 3\n", 1)[:-9])
    checkpoint.write(path, snapshot(), CONFIGURATION)
    assert checkpoint.read(path, CONFIGURATION).stamp_ns == 42


@pytest.mark.parametrize("kind", ["pipe", "directory", "large"])
def test_what_is_no_file_of_a_sane_size_is_refused_and_not_waited_for(tmp_path, kind):
    path = tmp_path / "x"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "directory":
        path.mkdir()
    else:
        path.touch()
        os.truncate(path, 1 << 40)
    with pytest.raises(CheckpointError, match=r"not a regular file|at most 120 MB"):
        checkpoint.read(path, CONFIGURATION)


def test_what_a_killed_tracker_left_half_written_is_deleted_after_a_while(path):
    old, young = (path.parent / f".{path.name}.{name}.tmp" for name in ("old", "young"))
    for rest in (old, young):
        rest.touch()
    os.utime(old, (0, 0))
    checkpoint.Checkpoints(path, 1, 60.0, CONFIGURATION, Log())
    assert not old.exists()
    assert young.exists()


def test_a_failed_write_leaves_the_one_before_and_no_rest(path, monkeypatch):
    before = path.read_bytes()

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint.os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        checkpoint.write(path, snapshot(), {"other": 1})
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_an_unwritable_directory_is_an_error_of_the_system(tmp_path):
    if os.geteuid() == 0:
        pytest.skip("root may write anywhere")
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(OSError, match="Permission denied"):
        checkpoint.write(tmp_path / "x", snapshot(), CONFIGURATION)


class Log:
    """Keeps what is logged."""

    def __init__(self):
        self.lines = []

    def warning(self, text, **_):
        self.lines.append(text)

    error = warning


class Engine:
    """Has the same state in every scan."""

    def snapshot(self):
        return snapshot()


def test_other_configurations_and_missing_files_are_cold_starts(tmp_path):
    log = Log()
    checkpoint.Checkpoints(tmp_path / ("x" * 300), 1, 60.0, CONFIGURATION, log)
    assert len(log.lines) == 1
    assert "File name too long" in log.lines[0]
    log = Log()
    checkpoint.Checkpoints(tmp_path / "none", 1, 60.0, CONFIGURATION, log)
    assert log.lines == []
    with pytest.raises(CheckpointError, match="No such file"):
        checkpoint.read(tmp_path / "none", CONFIGURATION)
