"""Snapshots on their way through a file, and equality of estimates, for the tests of any engine."""

import json

import numpy as np

from phd_jdtc_ros.core.snapshot import Snapshot

NAMES = ("state", "covariance", "weight", "class_probability", "class_id", "track_id")


def equal(a, b):
    return (a.stamp_ns, a.lag) == (b.stamp_ns, b.lag) and all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in NAMES
    )


def stored_and_read(snapshot):
    """Return a snapshot after conversion to JSON and bytes and back."""
    arrays = {
        name: np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape)
        for name, array in snapshot.arrays.items()
    }
    return Snapshot(snapshot.stamp_ns, arrays, json.loads(json.dumps(snapshot.facts)))


def assert_same(ours, theirs):
    """Assert that two snapshots are the same, bit by bit."""
    assert (ours.stamp_ns, ours.facts) == (theirs.stamp_ns, theirs.facts)
    assert ours.arrays.keys() == theirs.arrays.keys()
    for name, array in ours.arrays.items():
        np.testing.assert_array_equal(array, theirs.arrays[name])
