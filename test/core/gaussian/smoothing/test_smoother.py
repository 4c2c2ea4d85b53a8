"""The backward pass over a window of any scans smooths each target by its own scans."""

from dataclasses import replace

import numpy as np
import pytest
from runs import stepped
from scenes import short_scenario, small
from sweep import ROTATION_S, START_NS, configuration, scans

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian import extraction
from phd_jdtc_ros.core.gaussian.entries import Entry, Source
from phd_jdtc_ros.core.gaussian.smoothing import lineages, smoother
from phd_jdtc_ros.simulation.simulate import simulate

SECTORED = {"estimates_period_s": ROTATION_S, "lag": 4}


def window(revolutions, least_existence=None, wide_revolutions=0):
    """Return what an engine holds after some revolutions by sector, the first of them by half."""
    engine = new_engine(configuration(SECTORED))
    if least_existence is not None:
        bounds = replace(engine.forward.bounds, least_existence=least_existence)
        engine.forward.bounds = bounds
    narrow_ns = START_NS + round(wide_revolutions * ROTATION_S * 1e9)
    for scan in scans(revolutions, sectors=2):
        if scan.stamp_ns < narrow_ns:
            engine.step(scan)
    for scan in scans(revolutions):
        if scan.stamp_ns > narrow_ns:
            engine.step(scan)
    return engine._window


def alone(entries, label):
    """Return the entries of one target's hypotheses, oldest first: each continues the one before.

    An entry that has dropped the target has no hypotheses.
    """
    found = []
    stored = {entry.stamp_ns: entry.stored for entry in entries}
    for entry in entries:
        rows = np.flatnonzero(entry.stored.row_label == label)
        own, kept, begin = entry.stored.take(rows), [], 0
        for source in entry.sources:
            if source.stamp_ns in stored:
                every = np.arange(source.size) if source.rows is None else source.rows
                kept.append(
                    begin + np.flatnonzero(stored[source.stamp_ns].row_label[every] == label)
                )
            begin += source.size
        kept = np.concatenate([np.zeros(0, dtype=np.int64), *kept])
        if found and len(kept) and entry.link is not None:
            moves, ancestry = entry.link.moves, entry.link.ancestry
            columns = {name: getattr(moves, name)[kept] for name in ("change", "survival", "place")}
            edges = np.flatnonzero(np.isin(ancestry.parent, kept))
            link = lineages.Link(
                replace(moves, **columns),
                replace(
                    ancestry,
                    child=np.searchsorted(rows, ancestry.child[edges]),
                    parent=np.searchsorted(kept, ancestry.parent[edges]),
                    share=ancestry.share[edges],
                ),
            )
            before = Source(found[-1].stamp_ns, None, len(kept))
            found.append(Entry(entry.stamp_ns, own, (before,), link))
        elif len(rows):
            found.append(Entry(entry.stamp_ns, own))
    return found


def check_as_each_alone(entries):
    """Check the smoothed mixtures of a window against each target's own chain of scans."""
    labels = np.unique(np.concatenate([entry.stored.sums.label for entry in entries]))
    stamps = [entry.stamp_ns for entry in reversed(entries)]
    whole = dict(zip(stamps, smoother.backward_pass(entries), strict=True))
    for label in labels:
        chain = alone(entries, label)
        for entry, expected in zip(reversed(chain), smoother.backward_pass(chain), strict=True):
            own = whole[entry.stamp_ns]
            own = own.take(np.flatnonzero(own.row_label == label))
            np.testing.assert_allclose(own.weight, expected.weight, rtol=1e-12, atol=1e-300)
            np.testing.assert_allclose(own.mean, expected.mean, rtol=1e-12, atol=1e-9)
            np.testing.assert_allclose(own.covariance, expected.covariance, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("revolutions", "wide_revolutions"), [(3, 0), (7, 0), (5, 3)])
@pytest.mark.parametrize("existence", [None, 0.2], ids=["all", "doubtful ones dropped"])
def test_targets_of_all_sectors_are_smoothed_as_each_alone(
    revolutions, wide_revolutions, existence
):
    entries = window(revolutions, existence, wide_revolutions)
    parts = [source.rows is not None for entry in entries for source in entry.sources]
    assert any(parts) == (wide_revolutions > 0)
    check_as_each_alone(entries)


def test_scans_whose_sources_have_left_are_smoothed_or_filtered_as_the_others():
    entries = window(5, wide_revolutions=3)
    for first in range(1, len(entries)):
        check_as_each_alone(entries[first:])
    entries = [entry.unlinked for entry in window(4)]
    for found, entry in zip(smoother.backward_pass(entries)[::-1], entries, strict=True):
        np.testing.assert_array_equal(found.weight, entry.stored.weight)
        np.testing.assert_array_equal(found.mean, entry.stored.mean)
    last = window(5)[-1:]
    (alone,) = smoother.backward_pass(last)
    np.testing.assert_array_equal(alone.weight, last[0].stored.weight)


def test_window_of_no_targets_has_none():
    engine = new_engine(configuration(SECTORED))
    for scan in scans(1):
        nothing = replace(scan.detections[0], measurement=np.zeros((0, 2)), time_s=np.zeros(0))
        engine.step(replace(scan, detections=(nothing,)))
    entries = engine._window
    found = smoother.backward_pass([entries[0], *entries[2:]])
    assert [len(mixture) for mixture in found] == [0] * (len(entries) - 1)


def test_window_that_slides_is_smoothed_as_one_that_was_always_whole():
    entries, most, joined = window(9), 40, 0
    slid = lineages.Lineages()
    for end in range(20, len(entries) + 1):
        part = entries[max(end - most, 0) : end]
        since_ns = part[-min(len(part), 30)].stamp_ns
        assert slid._is_continued_by(part) == (end > 20)
        slid.extend(part)
        joined += sum(bool(table.links) and not table.is_small for table in slid._tables)
        slid.smooth(since_ns)
        whole = lineages.Lineages()
        whole.extend(part)
        whole.smooth()
        for own, other in zip(gaussians(slid, since_ns), gaussians(whole, since_ns), strict=True):
            np.testing.assert_array_equal(own, other)
    assert joined > 0


def gaussians(smoothed, stamp_ns):
    """Return the smoothed Gaussians of the updates around a stamp, update by update."""
    before, after = smoothed.around(stamp_ns)
    place, rows, columns = smoothed.hypotheses(np.concatenate([before, after[after >= 0]]))
    order = place.argsort(kind="stable")
    return place[order], *(column[rows[order]] for column in columns)


def test_target_whose_last_scan_was_dropped_is_found_once():
    entries = window(7)
    label, last = next(
        (one, index)
        for index, entry in reversed(list(enumerate(entries)))
        for one in entry.stored.sums.label
    )
    own = [index for index in range(last) if label in entries[index].stored.sums.label]
    assert len(own) > 2
    kept = [entry for index, entry in enumerate(entries) if index not in own[1:]]
    found = lineages.Lineages()
    found.extend(kept)
    before, _ = found.smooth(kept[-1].stamp_ns)
    labels = found.labels(before).tolist()
    assert label in labels
    assert len(set(labels)) == len(labels)


def test_updates_around_a_stamp_are_the_last_before_it_and_the_first_after_it():
    entries = window(7)
    every = lineages.Lineages()
    every.extend(entries)
    for entry in entries[::5]:
        before, after = every.around(entry.stamp_ns)
        for one, other in zip(before, after, strict=True):
            (label,) = every.labels(np.array([one]))
            stamps = [each.stamp_ns for each in entries if label in each.stored.sums.label]
            earlier = [stamp for stamp in stamps if stamp <= entry.stamp_ns]
            later = [stamp for stamp in stamps if stamp > entry.stamp_ns]
            assert every.stamps(np.array([one])) == max(earlier)
            assert (every.stamps(np.array([other])).tolist() if other >= 0 else []) == later[:1]


@pytest.mark.parametrize("threshold", [-1.0, 0.1, 0.5])
def test_targets_that_cannot_be_reported_are_not_smoothed_and_the_others_are_the_same(threshold):
    engine, left_out = new_engine(small({"lag": 4})), 0
    stepped(engine, [scan for _, scan in simulate(short_scenario(8), 3)])
    dynamics, entries = engine.forward.dynamics, engine._window
    for entry in entries[:-1]:
        whole, part = lineages.Lineages(), lineages.Lineages()
        for each in (whole, part):
            each.extend(entries)
        stamp_ns = entry.stamp_ns + 10**9  # Between scans, so that targets are interpolated
        every, some = whole.smooth(stamp_ns), part.smooth(stamp_ns, threshold)
        left_out += len(every.before) - len(some.before)
        expected = smoother.extract_at(whole, every, dynamics, stamp_ns, 2, threshold)
        found = smoother.extract_at(part, some, dynamics, stamp_ns, 2, threshold)
        assert len(expected) > 0
        for name in ("track_id", "state", "covariance", "weight"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert (left_out > 0) == (threshold > 0.0)


def test_targets_that_were_left_out_are_smoothed_when_the_threshold_falls():
    engine = new_engine(small({"lag": 4}))
    stepped(engine, [scan for _, scan in simulate(short_scenario(8), 3)])
    entries, stamp_ns = engine._window, engine._window[0].stamp_ns
    whole, part = lineages.Lineages(), lineages.Lineages()
    whole.extend(entries)
    whole.smooth(stamp_ns)
    part.extend(entries)
    for threshold in (1.0, 0.5, -1.0):
        part.smooth(stamp_ns, threshold)
    for own, other in zip(gaussians(part, stamp_ns), gaussians(whole, stamp_ns), strict=True):
        np.testing.assert_array_equal(own, other)


@pytest.mark.parametrize("threshold", [1e-3, 0.5])
def test_targets_at_the_stamp_of_a_whole_scan_are_those_of_its_smoothed_mixture(threshold):
    engine = new_engine(configuration(SECTORED))
    for scan in scans(5, sectors=1):
        engine.step(scan)
    whole = lineages.Lineages()
    whole.extend(engine._window)
    whole.smooth()
    stamp_ns = engine._window[-3].stamp_ns
    at = engine.forward.dynamics, stamp_ns, 2, threshold
    found = smoother.extract_at(whole, whole.around(stamp_ns), *at)
    expected = extraction.extract(whole.smoothed(stamp_ns), *at)
    assert len(found) > 0
    np.testing.assert_array_equal(found.track_id, expected.track_id)
    np.testing.assert_array_equal(found.state, expected.state)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    np.testing.assert_array_equal(found.weight, expected.weight)


def test_lineages_begin_again_with_a_window_that_went_back():
    entries = window(5)
    again, fresh = lineages.Lineages(), lineages.Lineages()
    again.extend(entries)
    again.smooth()
    for each in (again, fresh):
        each.extend(entries[:-9])
        each.smooth()
    for entry in entries[:-9]:
        found, expected = (each.smoothed(entry.stamp_ns).gaussians for each in (again, fresh))
        for own, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(own, other)
