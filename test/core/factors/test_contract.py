"""What all factors have in common, shown by updates with each of them alone."""

from copy import deepcopy
from dataclasses import dataclass, fields, replace
from functools import cache

import lone
import numpy as np
import pytest
from runs import stored_and_read

from phd_jdtc_ros.core import factors
from phd_jdtc_ros.core.factors import (
    Bursts,
    ClutterMap,
    ClutterRanges,
    ClutterRate,
    CorrelatedMisses,
    Detection,
    Factor,
    Learned,
    Limit,
    Multipath,
    Noise,
    Outliers,
    PolarGrid,
    Pressure,
    Sectors,
    limit,
)
from phd_jdtc_ros.core.factors.noise import COMPONENTS
from phd_jdtc_ros.core.factors.state import Factors
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.snapshot import Snapshot, stored_fields, to_snapshot
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections
from phd_jdtc_ros.core.window.update import Updated, update

CONFIG = lone.lone(
    {
        **lone.UNREDUCED,
        "radar.position": [0.0, 0.0],
        "radar.range_std": 30.0,
        "radar.azimuth_std_deg": 0.3,
        "radar.detection_probability": 0.9,
        "radar.clutter_rate": 20.0,
        "radar.clutter_max_range": 5e4,
        "radar.rotation_s": lone.INTERVAL_S,
    }
)
(RADAR,) = CONFIG.model.radars
THRESHOLD = RADAR.threshold
# The second one is behind the first, and the third at the edge of the last two sectors.
PLACES = np.array([[6e3, 0.4], [6.5e3, 0.4], [14e3, 0.75 * np.pi]])
STD = 0.15 * lone.STD
EXISTENCE = np.array([0.95, 0.9, 0.8])
# Whether each of them is detected, by revolution; their misses go together.
HITS = np.array(
    [
        [1, 1, 1, 1, 0, 0, 0, 1, 1, 1],
        [1, 0, 0, 0, 1, 1, 1, 1, 1, 1],
        [0, 0, 1, 1, 1, 1, 0, 0, 1, 1],
    ],
    dtype=bool,
).T
REVOLUTIONS, SECTORS = len(HITS), 8
# Reflectors that answer in every revolution, one of them near a target, and the number of further
# false detections.
REFLECTORS, FALSE = np.array([[13.85e3, 2.36], [8.1e3, 0.9], [11e3, -1.0]]), 12
BURST = 150  # False detections of the last revolution
STAMP_NS = 10**12


@dataclass(frozen=True)
class Case:
    """A factor that nothing was learned of, and what it takes to see its effect."""

    factor: Factor
    off: Factor | None = None  # The same assumption, switched off; None if it cannot be
    # Whether it changes reports of which nothing was learned, because what it assumes is configured
    # or because it depends on the targets of the report alone.
    changes: bool = False
    sectors: bool = False  # Whether it is of the sectors of a revolution
    from_others: bool = False  # Whether it learns from the looks of other sensors


CASES = (
    Case(Bursts()),
    Case(ClutterMap(PolarGrid.of_noise(*RADAR.noise_std))),
    Case(ClutterRanges.of_table(True, (0.0, 5e4), ((), ()))),
    Case(ClutterRate.beginning_with(RADAR.clutter_rate)),
    Case(
        CorrelatedMisses(0.0, learned=True),
        off=CorrelatedMisses(0.0, learned=False),
        from_others=True,
    ),
    Case(CorrelatedMisses(0.5, learned=False), off=CorrelatedMisses(0.0, learned=False)),
    Case(Detection(RADAR.max_range), from_others=True),
    Case(Learned(THRESHOLD), changes=True),
    Case(Limit(), changes=True),
    Case(Multipath(), changes=True),
    Case(Noise(), off=Noise(np.zeros(COMPONENTS, dtype=bool))),
    Case(Outliers(), off=Outliers(ratio=1.0), changes=True),
    Case(Sectors(), sectors=True),
)


def name_of(case):
    return type(case.factor).__name__


ALL = pytest.mark.parametrize("case", CASES, ids=name_of)


@pytest.fixture(autouse=True)
def few_detections(monkeypatch):
    """Let the burst be more than an update can use."""
    monkeypatch.setattr(limit, "MAX_UNEXPLAINED", 100)


def mixture():
    """Return the targets before any report."""
    means = [[x, 10.0, y, -5.0, 0.0] for x, y in RADAR.to_world(PLACES)]
    of_each = zip(EXISTENCE, means, strict=True)
    return lone.mixture_of(
        Dynamics(CONFIG.model), [(existence, mean, STD) for existence, mean in of_each]
    )


@cache
def reports(sectors):
    """Return the detections of some revolutions, and their stamps."""
    rng, found = np.random.default_rng(8), []
    for revolution in range(REVOLUTIONS):
        false = BURST if revolution == REVOLUTIONS - 1 else FALSE
        seen = np.concatenate([PLACES[HITS[revolution]], REFLECTORS])
        seen = seen + rng.standard_normal(seen.shape) * RADAR.noise_std
        place = np.concatenate([seen, rng.uniform([1e3, -np.pi], [4e4, np.pi], (false, 2))])
        amplitude = np.sqrt(THRESHOLD**2 + 2.0 * rng.exponential(3.0, len(place)))
        stamp_ns = STAMP_NS + round(1e9 * revolution * lone.INTERVAL_S)
        if not sectors:
            found.append((Detections(place, amplitude), stamp_ns))
            continue
        width = FULL_TURN / SECTORS
        for sector in range(SECTORS):
            inside = np.floor((place[:, 1] + np.pi) / width) == sector
            swept = Coverage(sector * width - np.pi, width)
            part = Detections(place[inside], amplitude[inside], coverage=swept)
            found.append((part, stamp_ns + round(1e9 * sector * lone.INTERVAL_S / SECTORS)))
    return found


def factors_of(*factor):
    return Factors({RADAR.name: factor})


def updated(factor, seen):
    """Return what some reports make of the targets and of a factor alone; `Updated`."""
    known, rows = factors_of(*factor), mixture()
    for detections, stamp_ns in seen:
        after = lone.learned(CONFIG, rows, detections, known, stamp_ns)
        known = after.factors
    return after


def factor_of(after):
    (factor,) = after.factors.by_sensor[RADAR.name]
    return factor


def stored(factor):
    """Return what a factor has learned, by name."""
    snapshot = Snapshot(None)
    to_snapshot(factor, snapshot, "factor")
    return snapshot.arrays


def equal(one, other):
    return one.keys() == other.keys() and all(
        np.array_equal(array, other[name]) for name, array in one.items()
    )


def by_target(after):
    """Return the existence and the mean position of each target, (T, 3)."""
    rows = after.rows.mixture
    weight, position = rows.sums.mass, rows.mean[..., [0, 2]]
    mode = rows.sums.mode_weight / rows.sums.mode_weight.sum(axis=1, keepdims=True)
    place = (mode[..., None] * position).sum(axis=1)
    sums = np.zeros((len(rows.sums.label), 3))
    np.add.at(sums, rows.sums.target, np.column_stack([weight, weight[:, None] * place]))
    sums[:, 1:] /= sums[:, :1]
    return sums


def assert_close(one, other):
    np.testing.assert_allclose(by_target(one), by_target(other), rtol=1e-7)


def subclasses(cls):
    """Return the classes of factors that the package has and a sensor can be given."""
    below = [each for own in cls.__subclasses__() for each in subclasses(own)]
    return [each for each in [cls, *below] if each.__module__.startswith(factors.__name__)]


def test_every_factor_has_a_case():
    named = [getattr(factors, name) for name in factors.__all__]
    offered = {each for each in named if isinstance(each, type) and issubclass(each, Factor)}
    # That of heights in space has tests of its own, `test_heights`.
    offered -= {Factor, Pressure}
    assert offered == {type(case.factor) for case in CASES}
    learning = [each for each in subclasses(Factor) if each.NAME]
    assert len({each.NAME for each in learning}) == len(learning)
    assert set(learning) - {Pressure} <= offered


@pytest.mark.parametrize("case", [each for each in CASES if each.off], ids=name_of)
def test_off_equals_absent(case):
    seen = reports(case.sectors)
    assert_close(updated([case.off], seen), updated([], seen))


@ALL
def test_what_has_learned_nothing_changes_nothing_but_by_what_it_is_configured_with(case):
    first = reports(case.sectors)[:1]
    with_it, without = by_target(updated([case.factor], first)), by_target(updated([], first))
    assert case.factor.figures(RADAR) == {}
    last = reports(case.sectors)[-1:]
    if case.changes:
        changed = by_target(updated([case.factor], last)) - by_target(updated([], last))
        assert np.abs(changed).max() > 1e-6
    else:
        np.testing.assert_allclose(with_it, without, rtol=1e-12)


@ALL
def test_what_has_learned_changes_the_next_report(case):
    """Otherwise the other tests here would show nothing."""
    seen = reports(case.sectors)
    taught = factor_of(updated([case.factor], seen[:-1]))
    detections, stamp_ns = seen[-1]
    with_it = lone.learned(CONFIG, mixture(), detections, factors_of(taught), stamp_ns)
    without = lone.learned(CONFIG, mixture(), detections, factors_of(), stamp_ns)
    assert np.abs(by_target(with_it) - by_target(without)).max() > 1e-6


@ALL
def test_the_order_of_detections_is_of_no_consequence(case):
    rng, seen = np.random.default_rng(3), reports(case.sectors)
    permuted = [(found.take(rng.permutation(len(found))), stamp) for found, stamp in seen]
    one, other = updated([case.factor], seen), updated([case.factor], permuted)
    assert_close(one, other)
    ours, theirs = stored(factor_of(one)), stored(factor_of(other))
    assert ours.keys() == theirs.keys()
    for name, array in ours.items():
        np.testing.assert_allclose(array, theirs[name], rtol=1e-7, atol=1e-9, err_msg=name)


@ALL
def test_what_is_saved_and_restored_goes_on_bit_by_bit(case):
    seen = reports(case.sectors)
    before = updated([case.factor], seen[:-1]).factors
    snapshot = Snapshot(STAMP_NS)
    before.to_snapshot([RADAR], snapshot)
    restored = factors_of(case.factor).restored(stored_and_read(snapshot), [RADAR])
    assert bool(snapshot.arrays) == bool(case.factor.NAME)
    ours, theirs = (each.by_sensor[RADAR.name][0] for each in (before, restored))
    assert equal(stored(ours), stored(theirs))
    detections, stamp_ns = seen[-1]
    one, other = (
        lone.learned(CONFIG, mixture(), detections, each, stamp_ns) for each in (before, restored)
    )
    np.testing.assert_array_equal(by_target(one), by_target(other))
    assert equal(stored(factor_of(one)), stored(factor_of(other)))


@pytest.mark.parametrize("case", [each for each in CASES if each.factor.NAME], ids=name_of)
def test_stored_values_that_cannot_have_been_learned_are_refused(case):
    snapshot = Snapshot(STAMP_NS)
    updated([case.factor], reports(case.sectors)[:-1]).factors.to_snapshot([RADAR], snapshot)
    for name, array in snapshot.arrays.items():
        forgeries = [np.zeros((*array.shape, 3)), array.astype("U8")]
        if array.size:
            absurd = (np.nan, -1e300) if array.dtype.kind == "f" else (-(2**60),)
            forgeries += [np.full_like(array, value) for value in absurd]
        for forged in forgeries:
            held = stored_and_read(snapshot)
            held.arrays[name] = forged
            with pytest.raises(ValueError, match=case.factor.NAME):
                factors_of(case.factor).restored(held, [RADAR])


@ALL
def test_learning_replaces_a_value_and_never_modifies_it(case):
    known = case.factor
    for detections, stamp_ns in reports(case.sectors):
        before, view = deepcopy(stored(known)), View.of(RADAR, detections, stamp_ns)
        seen = deepcopy(view.detections.measurement)
        after = factor_of(lone.learned(CONFIG, mixture(), detections, factors_of(known), stamp_ns))
        assert equal(stored(known), before)
        np.testing.assert_array_equal(detections.measurement, seen)
        known = after
    learns = bool(case.factor.NAME) and bool(stored_fields(case.factor))
    assert learns != equal(stored(known), stored(case.factor))


@ALL
def test_a_look_of_another_sensor_teaches_only_what_its_detections_confirm(case):
    other = replace(RADAR, name="other")
    *seen, (detections, stamp_ns) = reports(case.sectors)
    taught = factor_of(updated([case.factor], seen))
    known = Factors({RADAR.name: (taught,), other.name: ()})
    model = CONFIG.model.changed(radars=(RADAR, other))
    steps = GaussianSteps(Dynamics(model), CONFIG.bounds)
    rows = mixture()
    before = Updated(Branched(rows, np.arange(len(rows))), known)
    view = View.of(other, detections, stamp_ns)
    found = factor_of(update(before, view, steps, lone.INTERVAL_S, 0))
    assert equal(stored(found), stored(taught)) != case.from_others


@ALL
def test_another_configuration_goes_on_with_what_was_learned(case):
    taught = factor_of(updated([case.factor], reports(case.sectors)))
    configured = {part.name for part in fields(taught)} - set(stored_fields(taught))
    # The cells of a map are those of its counts.
    configured -= {"grid"}
    fresh = case.factor.changed()
    factors_after = factors_of(taught).retuned({RADAR.name: (fresh,)}, None)
    (found,) = factors_after.by_sensor[RADAR.name]
    assert equal(stored(found), stored(taught))
    for name in configured:
        assert getattr(found, name) is getattr(fresh, name)
    (absent,) = factors_of(taught).retuned({}, None).by_sensor.values()
    assert absent == ()
