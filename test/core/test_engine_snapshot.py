"""Snapshots of both engines: a restored one goes on as if it had never stopped."""

import pytest
from runs import ENGINES, assert_same, equal, restored_after, stepped, stored_and_read
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.simulation.simulate import simulate

SCANS = [scan for _, scan in simulate(short_scenario(10), 3)]
CASES = [
    *(
        {"engine": "gaussian", "lag": lag, **given}
        for lag in (0, 3)
        for given in (
            {},
            {"amplitude": "band"},
            {"spawn.rate": 0.0, "births": [], "detection_births.rates": [0.1, 0.1]},
        )
    ),
    *(
        {"engine": engine, "lag": lag, "recursion.extraction": extraction}
        for lag, extraction in ((0, "components"), (3, "components"), (2, "clusters"))
        for engine in ("particles", "phd")
    ),
]


@pytest.mark.parametrize("given", CASES, ids=lambda given: "-".join(map(str, given.values())))
@pytest.mark.parametrize("stop", [0, 1, 6])
def test_restored_engine_goes_on_as_if_it_had_never_stopped_bit_by_bit(given, stop):
    first, second = restored_after(stop, lambda: new_engine(small(given)), SCANS)
    assert equal(first.flush(), second.flush())


@pytest.mark.parametrize("engine", ENGINES)
def test_snapshot_is_not_changed_by_what_the_engine_does_later(engine):
    tracker = new_engine(small({"engine": engine, "lag": 2}))
    stepped(tracker, SCANS[:4])
    snapshot = tracker.snapshot()
    before = stored_and_read(snapshot)
    stepped(tracker, SCANS[4:])
    assert_same(snapshot, before)


def without(name):
    return lambda snapshot: snapshot.arrays.pop(name)


def shortened(name):
    return lambda snapshot: snapshot.arrays.update({name: snapshot.arrays[name][:-1]})


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (without("stored.0.mode"), "stored.0.mode"),
        (without("stored.1.components.indptr"), "stored.1.components.indptr"),
        (shortened("stored.1.origin"), "stored.1"),
        (shortened("stored.1.label"), "stored.1"),
        (shortened("stored.1.link.survival"), "stored.1.link"),
        (without("filter.scan_index"), "filter.scan_index: missing"),
        (lambda snapshot: snapshot.json_values.update({"extraction.rng": {}}), "snapshot"),
    ],
)
def test_restore_refuses_what_is_no_particle_engine_and_leaves_a_new_one(change, named):
    engine, fresh = (new_engine(small({"engine": "particles", "lag": 2})) for _ in range(2))
    stepped(engine, SCANS[:4])
    snapshot = engine.snapshot()
    change(snapshot)
    engine = new_engine(small({"engine": "particles", "lag": 2}))
    with pytest.raises(ValueError, match=named):
        engine.restore(snapshot)
    assert equal(stepped(engine, SCANS[:4])[0], stepped(fresh, SCANS[:4])[0])
