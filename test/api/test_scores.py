"""Tracks beside the truth, as tables."""

import crossing
import numpy as np
import pytest

from phd_jdtc_ros import evaluate

TRUTH = crossing.truth()


def test_evaluate_of_the_truth_finds_no_error_and_of_no_tracks_the_cutoff():
    found = evaluate(TRUTH, TRUTH, cutoff=100.0)

    assert found["scans"] == crossing.LAST
    assert found["ospa"] == found["missed"] == found["false"] == 0.0
    assert found["identity_switches"] == 0
    assert found["class_accuracy"] == 1.0
    none = {name: column[:0] for name, column in TRUTH.items()}

    found = evaluate(TRUTH, none, cutoff=100.0)

    assert found["ospa"] == pytest.approx(100.0)
    assert found["missed"] == 2.0


def test_evaluate_counts_swaps_and_wrong_classes():
    late = TRUTH["time"] >= 30.0
    swapped = {**TRUTH, "label": np.where(late, 3 - TRUTH["label"], TRUTH["label"])}

    assert evaluate(TRUTH, swapped, cutoff=50.0)["identity_switches"] == 2
    true = {**TRUTH, "class": np.where(TRUTH["label"] == 1, "ship", "boat")}
    found = {**TRUTH, "class": np.full(len(TRUTH["time"]), "boat")}

    assert evaluate(true, found, cutoff=50.0)["class_accuracy"] == 0.5


def test_evaluate_takes_names_as_labels_and_counts_times_without_tracks():
    named = {**TRUTH, "label": np.where(TRUTH["label"] == 1, "CLX123", "DLH4")}

    assert evaluate(named, TRUTH, cutoff=50.0)["identity_switches"] == 0
    some = {name: column[TRUTH["time"] < 30.0] for name, column in TRUTH.items()}

    assert evaluate(TRUTH, some, cutoff=100.0)["missed"] == pytest.approx(1.0)


def test_label_zero_or_none_is_no_track_in_numbers_and_in_texts():
    one = {name: column[TRUTH["label"] == 1] for name, column in TRUTH.items()}
    label = np.where(one["time"] < 30.0, 1, 0)
    numbers = evaluate(TRUTH, {**one, "label": label}, cutoff=50.0)

    assert numbers["identity_switches"] is None
    for unlike in (
        label.astype(np.str_),
        np.where(label == 0, np.nan, 1.0),
        np.where(label == 0, None, "DLH4"),
        np.where(label == 0, np.nan, np.array("DLH4", dtype=object)),
    ):
        assert evaluate(TRUTH, {**one, "label": unlike}, cutoff=50.0) == numbers


def test_evaluate_interpolates_the_truth_at_given_times():
    between = {**TRUTH, "time": TRUTH["time"] + 0.25}
    for axis in "xy":
        between[axis] = TRUTH[axis] + 0.25 * TRUTH[f"v{axis}"]
    rows = between["time"] < TRUTH["time"][-1]
    between = {name: column[rows] for name, column in between.items()}

    found = evaluate(TRUTH, between, cutoff=100.0, times=np.unique(between["time"]))

    assert found["ospa"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "arguments", "said"),
    [
        ({"time": TRUTH["time"] + 0.5}, {}, "tracks: 40 of 40 times, such as 10.5"),
        ({}, {"times": [*TRUTH["time"], 100.0]}, "truth: unknown at 100.0 s"),
        ({}, {"cutoff": 0.0}, "cutoff: 0.0 given, must be a number above 0"),
        ({}, {"cutoff": "x"}, "cutoff: 'x' given, must be a number above 0"),
        ({}, {"order": 0.5}, "order: 0.5 given, must be from 1 to 100"),
        ({"y": np.where(TRUTH["time"] == 11.0, np.nan, 0.0)}, {}, "tracks: y is 'nan' in row 3, "),
    ],
)
def test_evaluate_reports_what_does_not_fit(change, arguments, said):
    with pytest.raises(ValueError, match=said):
        evaluate(TRUTH, {**TRUTH, **change}, **{"cutoff": 100.0, **arguments})
