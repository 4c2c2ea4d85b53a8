"""Runs of any engine: its estimates, its snapshots on their way through a file, and equality."""

import json

import numpy as np

from phd_jdtc_ros.core.snapshot import Snapshot

NAMES = ("state", "covariance", "weight", "class_probability", "class_id", "track_id")


def alike(a, b):
    """Return whether estimates, or sequences of them, are the same but for the track numbers."""
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(alike, a, b))
    return equal(a, b.changed(track_id=a.track_id)) if len(a) == len(b) else False


def equal(a, b):
    """Return whether estimates, or sequences of them, are the same bit by bit."""
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(equal, a, b))
    return (a.stamp_ns, a.lag) == (b.stamp_ns, b.lag) and all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in NAMES
    )


def learned(engine, kind):
    """Return the factor of a kind of each sensor that has it, by the sensor's name."""
    factors = engine.forward.factors
    found = {name: factors.find(name, kind) for name in factors.by_sensor}
    return {name: factor for name, factor in found.items() if factor is not None}


def stepped(engine, scans):
    """Return the filtered and the smoothed estimates of an engine that steps through scans."""
    steps = [engine.step(scan) for scan in scans]
    return [e for step in steps for e in step.filtered], [
        e for step in steps for e in step.smoothed
    ]


def stored_and_read(snapshot):
    """Return a snapshot after conversion to JSON and bytes and back."""
    arrays = {
        name: np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape)
        for name, array in snapshot.arrays.items()
    }
    return Snapshot(snapshot.stamp_ns, arrays, json.loads(json.dumps(snapshot.json_values)))


def assert_same(ours, theirs):
    """Assert that two snapshots are the same, bit by bit."""
    assert (ours.stamp_ns, ours.json_values) == (theirs.stamp_ns, theirs.json_values)
    assert ours.arrays.keys() == theirs.arrays.keys()
    for name, array in ours.arrays.items():
        np.testing.assert_array_equal(array, theirs.arrays[name])


def restored_after(stops, new, scans, same=equal):
    """Check that engines that are restored in the middle go on as one that never stopped.

    Estimates and all learned values must be the same bit by bit. `new` makes an engine, and `stops`
    are the numbers of scans before the snapshots. Returns the engine that never stopped and the
    last one that was restored, after the last scan.
    """
    first, restored = new(), []
    for index, scan in enumerate(scans):
        if index in stops:
            restored.append(new())
            restored[-1].restore(stored_and_read(first.snapshot()))
        one = first.step(scan)
        for other in (each.step(scan) for each in restored):
            assert same(one.filtered, other.filtered)
            assert same(one.smoothed, other.smoothed)
            np.testing.assert_array_equal(one.class_mass, other.class_mass)
    for engine in restored:
        assert_same(first.snapshot(), engine.snapshot())
    return first, restored[-1]


def reprocessed_from(first, new, scans):
    """Check that an engine that reprocesses the scans from `first` on knows the same afterwards.

    `new` makes an engine. Returns the one that stepped through the scans once.
    """
    straight, late, states = new(), new(), []
    stepped(straight, scans)
    for index, scan in enumerate(scans):
        if index >= first:
            states.append((late.save_state(), scan))
        late.step(scan)
    late.reprocess(states)
    assert_same(straight.snapshot(), late.snapshot())
    return straight
