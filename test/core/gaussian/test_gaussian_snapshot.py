import numpy as np
import pytest
from runs import assert_same, equal, restored_after, stepped, stored_and_read
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.simulation.simulate import simulate

SCANS = [scan for _, scan in simulate(short_scenario(10), 3)]
CASES = [
    {"lag": lag, **given}
    for lag in (0, 3)
    for given in (
        {},
        {"amplitude": "band"},
        {"spawn.rate": 0.0, "births": [], "detection_births.rates": [0.1, 0.1]},
    )
]
NAN, INF = float("nan"), float("inf")


def gaussian(given=None):
    # Motion modes are mixed, so that the backward step has to compare pairs of them.
    common = {"lag": 2, "accuracy": "fast"}
    return new_engine(small({**common, **(given or {})}))


@pytest.mark.parametrize("given", CASES, ids=lambda given: "-".join(map(str, given.values())))
def test_restored_engine_goes_on_as_if_it_had_never_stopped_bit_by_bit(given):
    first, second = restored_after([0, 1, 6], lambda: new_engine(small(given)), SCANS)
    assert equal(first.flush(), second.flush())


def test_snapshot_is_not_changed_by_what_the_engine_does_later():
    tracker = new_engine(small({"lag": 2}))
    stepped(tracker, SCANS[:4])
    snapshot = tracker.snapshot()
    before = stored_and_read(snapshot)
    stepped(tracker, SCANS[4:])
    assert_same(snapshot, before)


@pytest.fixture(scope="module")
def stored():
    """The arrays and facts of an engine in mid run, as a snapshot to copy."""
    engine = gaussian()
    stepped(engine, SCANS[:6])
    return engine.snapshot()


def changed(name, function):
    """Return a change that replaces an array by a function of it."""

    def change(snapshot):
        snapshot.arrays[name] = function(np.array(snapshot.arrays[name]))

    return change


def put(name, value):
    """Return a change that writes a value into the first entry of an array."""

    def written(array):
        array.flat[0] = value
        return array

    return changed(name, written)


def put_matrix(name, matrix):
    """Return a change that writes a matrix over the first one, by its upper left corner."""

    def written(array):
        first = array.reshape(-1, *array.shape[-2:])[0]
        size = len(matrix)
        first[:] = np.diag(np.diag(first))
        first[:size, :size] = matrix
        return array

    return changed(name, written)


# Correlations of x, vx and y: each pair is possible, but not all three at a time.
INDEFINITE = 1e4 * np.array([[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]])
ASYMMETRIC = 1e4 * np.array([[1.0, 0.5], [-0.5, 1.0]])
LINK = "stored.1.link"
FORGERIES = {
    **{
        f"{part} {value}": put(f"{where}.{part}", value)
        for where, parts in {
            "stored.1": {
                "weight": (NAN, INF, -1e-3, 1e9),
                "mean": (NAN, INF, 1e300),
                "covariance": (NAN, INF, -1.0, 1e300),
                "origin": (-5, 2**62),
            },
            LINK: {
                "survival": (NAN, 1.5, -0.5),
                "change": (NAN, 1.5, -0.5),
                "mean": (-INF, 2e300),
                "place": (-7, 10**6),
                "factored": (-7, 10**6),
                "factor": (NAN, INF, 1e300),
                "gain": (NAN, INF, 1e300),
                "base": (NAN, INF),
                "share": (NAN, -0.5, 2.0),
                "child": (-1, 10**6),
                "parent": (-7, 10**6),
            },
        }.items()
        for part, values in parts.items()
        for value in values
    },
    "an indefinite covariance": put_matrix("stored.1.covariance", INDEFINITE),
    "an asymmetric covariance": put_matrix("stored.1.covariance", ASYMMETRIC),
    "one mean less": changed("stored.1.mean", lambda a: a[:-1]),
    "means of other axes": changed("stored.1.mean", lambda a: a[..., :3]),
    "weights of other classes": changed("stored.1.weight", lambda a: a[..., :1]),
    "other cells": changed("stored.1.snr", lambda a: a[..., :1]),
    "weights of other modes": changed("stored.1.weight", lambda a: a[:, :1]),
    "weights as whole numbers": changed("stored.1.weight", lambda a: a.astype("i8")),
    "weights as text": changed("stored.1.weight", lambda a: a.astype("U8")),
    "origins as numbers": changed("stored.1.origin", lambda a: a.astype("f8")),
    "a flat covariance": changed("stored.1.covariance", np.ravel),
    "one child less": changed(f"{LINK}.child", lambda a: a[:-1]),
    "one share less": changed(f"{LINK}.share", lambda a: a[:-1]),
    "one gain less": changed(f"{LINK}.gain", lambda a: a[:-1]),
    "no gain": lambda snapshot: snapshot.arrays.pop(f"{LINK}.gain"),
    "no covariance": lambda snapshot: snapshot.arrays.pop("stored.0.covariance"),
    "no filter": lambda snapshot: snapshot.arrays.pop("filter.scan_index"),
    "no window": lambda snapshot: snapshot.arrays.pop("window.entries"),
}


def test_snapshot_that_is_not_forged_is_taken(stored):
    engine = gaussian()
    engine.restore(stored_and_read(stored))
    assert len(engine.step(SCANS[6]).filtered[0]) > 0


@pytest.mark.parametrize("name", FORGERIES)
def test_forged_snapshot_is_an_error_and_leaves_a_new_engine(stored, name):
    snapshot = stored_and_read(stored)
    FORGERIES[name](snapshot)
    engine = gaussian()
    with pytest.raises(ValueError, match="snapshot: "):
        engine.restore(snapshot)
    assert_same(engine.snapshot(), gaussian().snapshot())


@pytest.mark.parametrize("matrix", [INDEFINITE, ASYMMETRIC])
def test_forged_filtered_covariance_is_an_error(stored, matrix):
    snapshot, engine = stored_and_read(stored), gaussian()
    put_matrix(f"filtered.{stored.stamp_ns}.covariance", matrix)(snapshot)
    with pytest.raises(ValueError, match="snapshot: "):
        engine.restore(snapshot)


@pytest.mark.parametrize(
    "other",
    [
        {"amplitude": "band"},
        {"class_1.survival_probability": 0.9},
        {"bounds.most": 100, "bounds.hypotheses": 1},
    ],
    ids=["cells", "motions", "bound"],
)
def test_snapshot_of_another_structure_is_an_error(stored, other):
    snapshot = stored_and_read(stored)
    if "bounds.most" in other:
        snapshot.arrays["stored.1.origin"] = np.zeros(101, dtype=np.int64)
    with pytest.raises(ValueError, match="snapshot: "):
        gaussian(other).restore(snapshot)


def test_forged_snapshot_that_is_taken_gives_only_finite_estimates(stored):
    # Values that the engine could have stored, in places where it did not.
    rng = np.random.default_rng(0)
    taken = 0
    for _ in range(25):
        snapshot = stored_and_read(stored)
        name = rng.choice([n for n, a in snapshot.arrays.items() if a.size and n[0] == "s"])
        array = np.array(snapshot.arrays[name])
        low = rng.integers(array.size)
        part = array.flat[low : low + 7]
        array.flat[low : low + len(part)] = rng.choice(array.ravel(), len(part))
        snapshot.arrays[name] = array
        engine = gaussian()
        try:
            engine.restore(snapshot)
        except ValueError:
            continue
        taken += 1
        for scan in SCANS[6:8]:
            step = engine.step(scan)
            for found in (*step.filtered, *step.smoothed):
                sound(found)
    assert taken > 5


@pytest.mark.parametrize("matrix", [INDEFINITE, ASYMMETRIC, -1e6 * np.eye(5)])
def test_forged_base_of_a_backward_step_gives_only_sound_estimates(stored, matrix):
    snapshot, engine = stored_and_read(stored), gaussian()
    put_matrix(f"{LINK}.base", matrix)(snapshot)
    engine.restore(snapshot)
    step = engine.step(SCANS[6])
    for found in (*step.filtered, *step.smoothed, *engine.flush()):
        sound(found)


@pytest.mark.parametrize("matrix", [INDEFINITE, np.zeros((5, 5)), -np.eye(5)])
def test_forged_factor_of_a_pair_of_modes_gives_only_sound_estimates(stored, matrix):
    snapshot, engine = stored_and_read(stored), gaussian()
    factor = np.array(snapshot.arrays[f"{LINK}.factor"])
    factor[..., : len(matrix), : len(matrix)] = matrix
    snapshot.arrays[f"{LINK}.factor"] = factor
    try:
        engine.restore(snapshot)
    except ValueError:
        return
    step = engine.step(SCANS[6])
    for found in (*step.filtered, *step.smoothed, *engine.flush()):
        sound(found)


def sound(found):
    """Check that estimates are finite and their covariances no less than nothing."""
    assert np.isfinite(found.state).all()
    assert np.isfinite(found.covariance).all()
    assert np.isfinite(found.weight).all()
    assert np.isfinite(found.class_probability).all()
    variance = np.diagonal(found.covariance, axis1=1, axis2=2)
    assert (variance >= 0.0).all()
    scale = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    correlation = found.covariance / scale[:, :, None] / scale[:, None, :]
    assert np.linalg.eigvalsh(correlation).min(initial=0.0) > -1e-6
