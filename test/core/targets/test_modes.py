import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import small
from scipy import linalg

from phd_jdtc_ros.core.targets.modes import ClassModel, ModeSpace, markov_generator
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn

CV, CT = ConstantVelocity(1.0), CoordinatedTurn(1.0, 1e-5)
FLIPPING = np.array([[0.3, 0.7], [0.7, 0.3]])


def space(*matrices, survival=0.99, interval_s=6.0):
    classes = tuple(
        ClassModel(f"class_{i}", (10.0, 100.0), (CV, CT, CV)[: len(m)], np.array(m), survival)
        for i, m in enumerate(matrices)
    )
    return ModeSpace(classes, interval_s)


TWO_CLASSES = space(
    [[0.8, 0.2], [0.2, 0.8]], [[0.9, 0.08, 0.02], [0.1, 0.8, 0.1], [0.05, 0.05, 0.9]]
)

# Intervals are tenths of a second, because one a millionth off the nominal one counts as it.
intervals = st.integers(1, 600).map(lambda tenths: tenths / 10.0)


@settings(deadline=None, max_examples=50)
@given(first=intervals, second=intervals)
def test_transition_over_two_intervals_is_that_of_their_sum(first, second):
    chained = TWO_CLASSES.transition(first) @ TWO_CLASSES.transition(second)
    np.testing.assert_allclose(chained, TWO_CLASSES.transition(first + second), rtol=0, atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(dt=intervals)
def test_transition_rows_are_distributions_and_never_leave_the_class(dt):
    matrix = TWO_CLASSES.transition(dt)
    assert (matrix >= 0.0).all()
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=0, atol=1e-12)
    other_class = TWO_CLASSES.class_of[:, None] != TWO_CLASSES.class_of
    np.testing.assert_array_equal(matrix[other_class], 0.0)


def test_transition_is_the_given_matrix_at_the_nominal_interval():
    np.testing.assert_array_equal(TWO_CLASSES.transition(6.0)[:2, :2], [[0.8, 0.2], [0.2, 0.8]])
    near = TWO_CLASSES.transition(6.0 * (1.0 + 1e-5))
    np.testing.assert_allclose(near, TWO_CLASSES.transition(6.0), atol=1e-5)


@pytest.mark.parametrize(("dt", "power"), [(0.5, 1), (6.0, 1), (11.0, 2), (19.0, 3)])
def test_transition_without_a_generator_goes_in_whole_steps(dt, power):
    expected = np.linalg.matrix_power(FLIPPING, power)
    np.testing.assert_allclose(space(FLIPPING).transition(dt), expected, rtol=0, atol=1e-15)


def test_transition_of_rows_given_to_seven_digits_sums_to_one():
    # A third written as 0.3333333 is accepted; a row left short of one would be topped up with
    # the last flat mode, which is another class.
    given_rows = {
        "classes": ["class_0", "class_1"],
        "motions": ["cv", "ct", "cv_2"],
    }
    for name in ("class_0", "class_1"):
        given_rows[f"{name}.motions"] = ["cv", "ct", "cv_2"]
        given_rows[f"{name}.mode_transition"] = [
            *(0.3333333, 0.3333333, 0.3333333),
            *(0.1, 0.8, 0.1),
            *(0.1, 0.1, 0.8),
        ]
    modes = small(given_rows).model.modes
    np.testing.assert_allclose(modes.transition(6.0).sum(axis=1), 1.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "matrix",
    [
        FLIPPING,
        np.array([[0.0, 1.0], [1.0, 0.0]]),
        np.array([[0.5, 0.5], [0.5, 0.5]]),
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        # Positive determinant and a real logarithm, but a negative rate from 0 to 2.
        np.array([[0.7, 0.3, 0.0], [0.0, 0.7, 0.3], [0.0, 0.0, 1.0]]),
    ],
)
def test_markov_generator_refuses_a_matrix_without_one(matrix):
    assert markov_generator(matrix) is None


@pytest.mark.parametrize(
    "matrix",
    [
        np.eye(2),
        np.array([[1.0]]),
        np.array([[0.8, 0.2], [0.2, 0.8]]),
        np.array([[1.0, 0.0], [0.3, 0.7]]),
    ],
)
def test_markov_generator_gives_rates_whose_exponential_is_the_matrix(matrix):
    generator = markov_generator(matrix)
    assert generator is not None
    np.testing.assert_allclose(linalg.expm(generator), matrix, rtol=0, atol=1e-12)
    np.testing.assert_allclose(generator.sum(axis=1), 0.0, rtol=0, atol=1e-12)
    assert (generator - np.diag(np.diag(generator)) >= -1e-12).all()


@pytest.mark.parametrize("dt", [0.5, 6.0, 15.0])
def test_survival_is_a_power_of_the_interval(dt):
    np.testing.assert_allclose(TWO_CLASSES.survival(dt), 0.99 ** (dt / 6.0), rtol=1e-14)


def test_modes_flatten_classes_with_their_survival():
    classes = (
        ClassModel("a", (10.0, 100.0), (CV, CT), np.eye(2), 0.9),
        ClassModel("b", (10.0, 100.0), (CV,), np.eye(1), 0.5),
    )
    np.testing.assert_allclose(ModeSpace(classes, 2.0).survival(2.0), [0.9, 0.9, 0.5])
    np.testing.assert_array_equal(TWO_CLASSES.class_of, [0, 0, 1, 1, 1])
    assert TWO_CLASSES.motions == (CV, CT, CV, CT, CV)
    assert len(TWO_CLASSES) == 5


def test_motion_share_is_that_of_a_long_run():
    modes = space([[0.95, 0.05], [0.1, 0.9]], [[1.0]])
    after = np.linalg.matrix_power(modes.transition(modes.interval_s), 2000)
    np.testing.assert_allclose(modes.motion_share, [*after[0, :2], 1.0], rtol=1e-9)
    np.testing.assert_allclose(space([[1.0, 0.0], [0.0, 1.0]]).motion_share, 0.5)
