import numpy as np
import pytest
from held import equal, stored_and_read
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.simulation.simulate import simulate

SCANS = [scan for _, scan in simulate(short_scenario(10), 3)]


@pytest.mark.parametrize("name", ["particles", "phd"])
@pytest.mark.parametrize(
    ("lag", "extraction"), [(0, "components"), (3, "components"), (2, "clusters")]
)
@pytest.mark.parametrize("stop", [0, 1, 6])
def test_restored_tracker_goes_on_as_if_it_had_never_stopped(name, lag, extraction, stop):
    config = small({"lag": lag, "recursion.extraction": extraction, "engine": name, "seed": 5})
    first, second = new_engine(config), new_engine(config)
    for scan in SCANS[:stop]:
        first.step(scan)
    second.restore(stored_and_read(first.snapshot()))
    for scan in SCANS[stop:]:
        one, other = first.step(scan), second.step(scan)
        assert equal(one.filtered[0], other.filtered[0])
        assert len(one.smoothed) == len(other.smoothed)
        assert all(equal(a, b) for a, b in zip(one.smoothed, other.smoothed, strict=True))
    assert all(equal(a, b) for a, b in zip(first.flush(), second.flush(), strict=True))


def half_way():
    engine = new_engine(small({"lag": 2}))
    for scan in SCANS[:4]:
        engine.step(scan)
    return engine.snapshot()


def without(name):
    def change(snapshot):
        del snapshot.arrays[name]

    return change


def shortened(name):
    def change(snapshot):
        snapshot.arrays[name] = snapshot.arrays[name][:-1]

    return change


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (without("stored.0.mode"), "stored.0.mode"),
        (without("stored.1.components.indptr"), "stored.1.components.indptr"),
        (shortened("stored.1.origin"), "stored.1"),
        (shortened("stored.1.label"), "stored.1"),
        (shortened("stored.1.link.survival"), "stored.1.link"),
        (lambda snapshot: snapshot.facts.pop("filter"), "filter"),
        (lambda snapshot: snapshot.facts["smoother"].update(rng={}), "snapshot"),
    ],
)
def test_restore_refuses_what_is_no_tracker_and_leaves_a_new_one(change, named):
    snapshot = half_way()
    change(snapshot)
    engine = new_engine(small({"lag": 2}))
    with pytest.raises(ValueError, match=named):
        engine.restore(snapshot)
    fresh = new_engine(small({"lag": 2}))
    for scan in SCANS[:4]:
        assert equal(engine.step(scan).filtered[0], fresh.step(scan).filtered[0])


def test_snapshot_is_not_changed_by_what_the_tracker_does_later():
    engine = new_engine(small({"lag": 2}))
    for scan in SCANS[:4]:
        engine.step(scan)
    snapshot = engine.snapshot()
    before = stored_and_read(snapshot)
    for scan in SCANS[4:]:
        engine.step(scan)
    assert snapshot.facts == before.facts
    for name, array in snapshot.arrays.items():
        np.testing.assert_array_equal(array, before.arrays[name])
