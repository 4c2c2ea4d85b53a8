import estimate_sets
import numpy as np
import pytest
from scenes import intensity

from phd_jdtc_ros.core.arrays import read_only, sum_by
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.types import Detections


def estimates(weight):
    return estimate_sets.estimates(np.zeros((len(weight), 5)), weight=np.array(weight, dtype=float))


def test_values_are_read_only_and_sums_are_by_index():
    original = np.zeros(3)
    view = read_only(original)
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 1.0
    original[0] = 1.0
    assert view[0] == 1.0  # no copy
    detections = Detections(np.zeros((2, 2)), np.zeros(2))
    assert len(detections) == 2
    for array in (detections.measurement, detections.amplitude):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    found = sum_by(np.array([0, 2, 0]), np.array([1.0, 2.0, 4.0]), 4)
    np.testing.assert_array_equal(found, [5.0, 0.0, 2.0, 0.0])
    np.testing.assert_array_equal(sum_by(np.zeros(0, dtype=int), np.zeros(0), 2), [0.0, 0.0])


@pytest.mark.parametrize("measurement", [np.zeros(3), np.zeros((2, 2, 2))])
def test_detections_refuse_a_measurement_that_is_not_a_table(measurement):
    with pytest.raises(ValueError, match=r"measurement: expected shape \(M, Z\)"):
        Detections(measurement, None)


@pytest.mark.parametrize("amplitude", [np.zeros(3), np.zeros((2, 1))])
def test_detections_refuse_amplitudes_that_do_not_match(amplitude):
    with pytest.raises(ValueError, match=r"amplitude: expected shape \(2,\)"):
        Detections(np.zeros((2, 2)), amplitude)


def test_particle_masses_sum_over_modes_and_parts():
    phd = intensity(np.zeros((2, 5)), [0.1, 0.2], components=[[0.5, 0.0], [0.25, 1.0]])
    np.testing.assert_allclose(phd.weight, [0.6, 1.45])
    for name in ("state", "mode", "poisson", "weight"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(phd, name)[0] = 0
    empty = ParticleSet.empty(5)
    assert (len(empty), empty.state.shape, empty.components.shape) == (0, (0, 5), (0, 0))
    assert empty.weight.shape == (0,)
    assert empty.effective_sample_size == 0.0
    assert empty.effective_share == 0.0
    phd = intensity(np.zeros((3, 5)), [0.1, 0.2, 0.4], mode=np.array([0, 3, 1]))
    np.testing.assert_allclose(phd.class_mass(np.array([0, 0, 1, 1]), 2), [0.5, 0.2])


@pytest.mark.parametrize(
    ("weight", "multiplicity", "expected"),
    [
        ([0.1, 0.1, 0.1, 0.1], [1, 1, 1, 1], 4.0),
        ([0.3, 0.1], [3, 1], 1.6),
        ([400.0], [4000], 1.0),
        ([1.0, 0.0], [1, 1], 1.0),
    ],
)
def test_particle_phd_effective_size_is_never_above_the_particles(weight, multiplicity, expected):
    phd = intensity(np.zeros((len(weight), 5)), weight, multiplicity=np.array(multiplicity))
    assert phd.effective_sample_size == pytest.approx(expected)
    assert phd.effective_sample_size <= len(phd)


@pytest.mark.parametrize(
    ("weight", "row_label", "expected"),
    [
        ([0.1, 0.1, 0.1, 0.1], [0, 0, 0, 0], 1.0),
        ([1.0, 0.0, 0.0, 0.0], [0, 0, 0, 0], 0.25),
        # Two targets, one of which is left with a single particle.
        ([0.5, 0.5, 1.0, 0.0], [0, 0, 1, 1], 0.75),
        # Particles without mass, such as those of births where nothing is detected, do not count.
        ([0.5, 0.5, 0.0, 0.0], [0, 0, 1, 1], 1.0),
        ([0.0, 0.0], [0, 1], 0.0),
    ],
)
def test_particle_phd_effective_share_is_that_of_the_targets(weight, row_label, expected):
    phd = intensity(np.zeros((len(weight), 5)), weight, row_label=np.array(row_label))
    assert phd.effective_share == pytest.approx(expected)


def test_estimates_count_those_that_hold_two_targets():
    assert estimates([0.6, 1.5, 1.51, 2.2]).unresolved == 2
    assert len(estimates([0.6, 1.5])) == 2
