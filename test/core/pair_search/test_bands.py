import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phd_jdtc_ros.core.pair_search.bands import in_boxes


def all_pairs(ranges, azimuth, half_width, measured):
    """Return every pair, found by comparing each box with each detection."""
    apart = measured[None, :, 1] - azimuth[:, None]
    apart = np.abs(np.arctan2(np.sin(apart), np.cos(apart)))
    distance = measured[None, :, 0]
    inside = (apart <= half_width[:, None]) | (half_width[:, None] >= np.pi)
    inside &= (distance >= ranges[:, :1]) & (distance <= ranges[:, 1:])
    return sorted(map(tuple, np.argwhere(inside).tolist()))


def check(ranges, azimuth, half_width, measured):
    parts = [np.asarray(part, dtype=float) for part in (ranges, azimuth, half_width, measured)]
    box, detection = in_boxes(*parts)
    assert (np.diff(box) >= 0).all()
    found = list(zip(box.tolist(), detection.tolist(), strict=True))
    assert sorted(found) == all_pairs(*parts)
    return len(found)


def random_case(rng, boxes, detections, width):
    near = rng.uniform(-500.0, 12e3, boxes)
    return (
        np.stack([near, near + rng.uniform(0.0, 4e3, boxes)], axis=1),
        rng.uniform(-np.pi, np.pi, boxes),
        width * rng.uniform(0.1, 1.0, boxes),
        np.stack(
            [rng.uniform(0.0, 15e3, detections), rng.uniform(-np.pi, np.pi, detections)], axis=1
        ),
    )


@pytest.mark.parametrize("width", [1e-4, 0.05, 0.7, 3.0, 9.0])
@pytest.mark.parametrize(("boxes", "detections"), [(1, 1), (7, 300), (200, 150)])
def test_in_boxes_finds_what_all_pairs_would(width, boxes, detections):
    rng = np.random.default_rng(boxes)
    found = sum(check(*random_case(rng, boxes, detections, width)) for _ in range(5))
    assert found or width < 0.05 or boxes == 1


@given(
    st.lists(
        st.tuples(
            st.integers(0, 1000),
            st.integers(0, 1000),
            st.integers(-8, 8),
            st.sampled_from([0.01, 0.3, 1.0, 3.2]),
        ),
        max_size=8,
    ),
    st.lists(st.tuples(st.integers(0, 1000), st.integers(-8, 8)), max_size=8),
)
def test_in_boxes_finds_each_pair_once_whatever_the_boxes(boxes, detections):
    # Steps that are no fractions of a turn, so that no detection is on an edge.
    ranges = np.array([sorted(box[:2]) for box in boxes]).reshape(-1, 2)
    azimuth = np.array([0.39 * box[2] for box in boxes])
    half_width = np.array([box[3] for box in boxes])
    measured = np.array([(r, 0.385 * k) for r, k in detections]).reshape(-1, 2)
    check(ranges, azimuth, half_width, measured)


@pytest.mark.parametrize("centre", [np.pi, -np.pi, 3.1, -3.1, 3.1 + 2.0 * np.pi])
def test_in_boxes_reach_across_the_cut_of_the_azimuth(centre):
    measured = [[5e3, 3.13], [5e3, -3.13], [5e3, 0.0], [5e3, 3.0], [5e3, -3.0]]
    assert check([[4e3, 6e3]], [centre], [0.1], measured) >= 2


def test_in_boxes_wider_than_a_turn_are_a_turn():
    measured = [[5e3, azimuth] for azimuth in np.linspace(-3.1, 3.1, 50)]
    assert check([[0.0, 6e3]], [2.0], [50.0], measured) == 50


def test_in_boxes_finds_what_is_on_an_edge_in_range():
    assert check([[5e3, 6e3]], [0.0], [0.1], [[5e3, 0.0], [6e3, 0.0], [6e3 + 1e-6, 0.0]]) == 2


def test_in_boxes_does_not_mix_up_ranges_of_neighbouring_bands():
    # The largest range that a box may have, and one that is empty.
    check([[0.0, np.inf], [7e3, 6e3]], [0.5, 0.5], [0.01, 0.01], [[1e3, 0.5], [1e3, 0.52]])
