import numpy as np
import pytest

from phd_jdtc_ros import Tracker
from phd_jdtc_ros.calibration.tuning.plots import Timing, plots_of
from phd_jdtc_ros.calibration.tuning.rates import find_copies
from phd_jdtc_ros.core.types import Detections

SECOND, STD, SCANS = 10**9, 1.0, 80


def scans(seed=1):
    """Return the places of two targets side by side and of false detections, by scan."""
    rng = np.random.default_rng(seed)
    for k in range(SCANS):
        target = np.array([[0.8 * k - 40.0, 40.0], [0.8 * k - 40.0, 46.0]])
        yield np.concatenate([target + rng.normal(0.0, STD, (2, 2)), rng.uniform(-99, 99, (3, 2))])


def found(reports):
    reports = [(round(time_s * SECOND), Detections(place, None)) for time_s, place in reports]
    return find_copies(plots_of(reports, places=True), Timing(1.0), STD)


def copied(shift=(0.0, 0.0), delay=0, jitter=0.02):
    """Return reports with copies at a distance, or so many scans later."""
    rng, places = np.random.default_rng(2), [*scans()]
    return [
        (
            k,
            np.concatenate(
                [place, places[k - delay] + shift + rng.normal(0.0, jitter, place.shape)]
            ),
        )
        for k, place in enumerate(places)
        if k >= delay
    ]


@pytest.mark.parametrize("shift", [(3.0, 0.0), (0.0, 8.0), (-4.0, 3.0)])
def test_copies_at_a_distance_are_found(shift):
    copies = found(copied(shift))
    assert copies.distance == pytest.approx(np.hypot(*shift), abs=0.05)
    assert len(copies.rows) == pytest.approx(5 * SCANS, rel=0.05)


@pytest.mark.parametrize("delay", [1, 2])
def test_copies_in_later_scans_are_found(delay):
    copies = found(copied(delay=delay, jitter=0.0))
    assert (copies.distance, copies.delay_s) == (0.0, delay)


@pytest.mark.parametrize("round_to", [None, 1.0, 0.5])
def test_targets_side_by_side_and_at_rest_are_no_copies(round_to):
    for moving in (1.0, 0.0):
        places = [place - [0.8 * moving * k, 0.0] for k, place in enumerate(scans())]
        if round_to:
            places = [np.rint(place / round_to) * round_to for place in places]
        assert found(enumerate(places)) is None


def test_fit_merges_copies_at_a_distance_and_names_later_ones():
    def table(reports):
        rows = [(float(k), *place) for k, places in reports for place in places]
        return dict(zip(("time", "x", "y"), np.array(rows).T, strict=True))

    with pytest.warns(UserWarning, match=r"copies of others, [23][.0-9]* m away in the same scan"):
        tracker = Tracker().fit(table(copied((3.0, 0.0))))
    assert tracker.parameters["radar.cluster_distance"] == pytest.approx(3.0, abs=0.1)
    assert tracker.parameters["radar.position_std"] == pytest.approx(STD, rel=0.2)
    with pytest.warns(UserWarning, match=r"copies of others, 2 s later at the same place"):
        Tracker().fit(table(copied(delay=2, jitter=0.0)))
