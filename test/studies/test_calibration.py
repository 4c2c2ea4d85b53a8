import json
from itertools import pairwise

import numpy as np
import pytest
from reference import resolve

from phd_jdtc_ros.core.types import Estimates, Truth
from studies.calibration.drawn_truth import diffused_snr, drawn_run, drawn_snr
from studies.calibration.scores import (
    CLASS_EDGES,
    EXISTENCE_EDGES,
    Reliability,
    matched,
    of_run,
    pooled,
)
from studies.calibration.study import TRUE
from studies.command import main

SCANS, RUNS = 50, 20


@pytest.fixture(scope="module")
def drawn():
    """The truth of some runs, and the model that they are drawn from."""
    model = resolve(TRUE).model
    runs = (drawn_run(model, SCANS, np.random.default_rng([5, run])) for run in range(RUNS))
    return [[truth for truth, _ in run] for run in runs], model


def estimates(position, weight, class_probability, std=100.0):
    """Return estimates with the same standard deviation along both axes."""
    size = len(position)
    state = np.zeros((size, 5))
    state[:, [0, 2]] = position
    class_probability = np.array(class_probability)
    return Estimates(
        stamp_ns=0,
        lag=0,
        state=state,
        covariance=np.tile(np.eye(5) * std**2, (size, 1, 1)),
        weight=np.array(weight),
        class_probability=class_probability,
        class_id=class_probability.argmax(axis=1),
        track_id=np.arange(1, size + 1),
    )


def targets(position, class_id):
    state = np.zeros((len(position), 5))
    state[:, [0, 2]] = position
    return Truth(0, state, np.arange(1, len(position) + 1), np.array(class_id))


def test_drawn_snr_is_uniform_in_the_band_of_its_class(drawn):
    _, model = drawn
    for mode in (0, len(model.modes) - 1):
        low, high = np.log1p(model.modes.classes[model.modes.class_of[mode]].snr_band)
        born = drawn_snr(np.full(4000, mode), model, np.random.default_rng(0))
        assert born.min() >= low
        assert born.max() <= high
        # The standard error of a uniform mean over 4000 draws is 0.46 % of the width.
        assert born.mean() == pytest.approx((low + high) / 2.0, abs=0.02 * (high - low))


def test_drawn_snr_diffuses_within_its_band_by_the_square_root_of_time(drawn):
    _, model = drawn
    low, high = np.log1p(model.modes.classes[0].snr_band)
    snr, mode, interval_s = (
        np.linspace(low, high, 5000),
        np.zeros(5000, int),
        model.modes.interval_s,
    )
    moved = diffused_snr(snr, mode, model, interval_s, np.random.default_rng(0))
    assert moved.min() >= low
    assert moved.max() <= high
    assert np.std(moved - snr) == pytest.approx(model.amplitudes.jitter, rel=0.05)
    middle = np.full(5000, 0.5 * (low + high))
    short, long = (
        diffused_snr(middle, mode, model, dt, np.random.default_rng(0)) - middle
        for dt in (interval_s, 4.0 * interval_s)
    )
    np.testing.assert_allclose(long, 2.0 * short)


def test_drawn_targets_are_born_and_survive_in_their_class(drawn):
    runs, model = drawn
    born = sum(len({n for truth in run for n in truth.track_id.tolist()}) for run in runs)
    expected = RUNS * SCANS * sum(term.rate.sum() for term in model.births)
    assert abs(born - expected) < 4.0 * np.sqrt(expected)
    pairs = [pair for run in runs for pair in pairwise(run)]
    lived = sum(len(before.track_id) for before, _ in pairs)
    died = sum(len(np.setdiff1d(one.track_id, two.track_id)) for one, two in pairs)
    expected = lived * (1.0 - model.modes.classes[0].survival_probability)
    assert abs(died - expected) < 4.0 * np.sqrt(expected)
    runs, _ = drawn
    known = {
        (index, number, own)
        for index, run in enumerate(runs)
        for truth in run
        for number, own in zip(truth.track_id.tolist(), truth.class_id.tolist(), strict=True)
    }
    assert len(known) == len({(index, number) for index, number, _ in known})


def test_drawn_targets_start_with_the_spread_of_their_births(drawn):
    runs, model = drawn
    first = {
        (index, number): position
        for index, run in enumerate(runs)
        for truth in reversed(run)
        for number, position in zip(truth.track_id.tolist(), truth.position, strict=True)
    }
    places = np.array([term.mean[[0, 2]] for term in model.births])
    apart = np.array(list(first.values()))[:, None] - places
    nearest = np.abs(apart).sum(axis=2).argmin(axis=1)
    scaled = apart[np.arange(len(apart)), nearest] / model.births[0].std[0]
    assert scaled.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * scaled.size))


def test_matched_gives_targets_to_the_nearer_within_the_gate():
    found = estimates([[10.0, 0.0], [0.0, 0.0]], [0.9, 0.1], [[1.0, 0.0]] * 2)
    target, estimate, square = matched(targets([[5.0, 0.0]], [0]), found)
    assert (target.tolist(), estimate.tolist()) == ([0], [0])
    np.testing.assert_allclose(square, 0.05**2)
    found = estimates([[601.0, 0.0]], [0.9], [[1.0, 0.0]])
    assert len(matched(targets([[0.0, 0.0]], [0]), found)[0]) == 0


def test_of_run_counts_what_exists_and_whose_class_is_right():
    found = estimates([[0.0, 0.0], [9e3, 0.0]], [0.97, 0.35], [[0.2, 0.8], [1.0, 0.0]])
    scores = of_run([targets([[350.0, 0.0]], [1])], [np.array([True])], [found])
    existence = dict(zip(EXISTENCE_EDGES, scores.existence.right, strict=False))
    assert scores.existence.number.sum() == 2
    assert {edge for edge, right in existence.items() if right} == {0.95}
    assert dict(zip(CLASS_EDGES, scores.target_class.right, strict=False))[0.8] == 1
    np.testing.assert_allclose(scores.errors.outside, [1.0, 0.0])
    np.testing.assert_allclose(scores.errors.nees, [0.5 * 3.5**2, 0.0])


def test_pooled_interval_is_wide_where_a_run_repeats_its_statement():
    """Each of four runs says the same a hundred times, and is always right or never."""
    repeated = Reliability(
        np.full((4, 1), 100.0), np.full((4, 1), 50.0), np.array([[100.0], [0.0], [100.0], [0.0]])
    )
    spread = Reliability(repeated.number, repeated.said, np.full((4, 1), 50.0) + [[1], [-1]] * 2)
    wide, narrow = pooled(repeated), pooled(spread)
    assert (wide.right[0], narrow.right[0]) == (0.5, 0.5)
    assert wide.high[0] - wide.low[0] > 0.6
    np.testing.assert_allclose(narrow.high[0] - narrow.low[0], 0.098, atol=0.001)


def test_study_scores_the_tracker_on_drawn_truth(tmp_path, capsys):
    given = ["--runs", "2", "--seed", "7", "--scans", "30", "--out", str(tmp_path)]
    assert main(["calibration", *given]) == 0
    assert "class probability" in capsys.readouterr().out
    found = json.loads((tmp_path / "calibration.json").read_text())["gaussian"]
    assert sum(found["filtered"]["existence"]["number"]) > 0
    assert all(found[source]["covered"]["pairs"] > 0 for source in ("filtered", "smoothed"))
    assert (tmp_path / "reliability.png").stat().st_size > 1e4
    joined = json.loads((tmp_path / "summary.json").read_text())
    assert len(joined["goals"]) == 6
    assert joined["reliability"]["gaussian"] == found
