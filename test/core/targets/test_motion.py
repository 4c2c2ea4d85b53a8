import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import small
from scipy import linalg
from scipy.integrate import solve_ivp

from phd_jdtc_ros.core.state_space import OMEGA
from phd_jdtc_ros.core.targets import motion
from phd_jdtc_ros.core.targets.modes import ClassModel, ModeSpace, markov_generator
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn, Stationary

CV = ConstantVelocity(1.3)
CT = CoordinatedTurn(1.3, 1e-5)
RETURNING = CoordinatedTurn(1.3, 1e-5, 15.0)
REST = Stationary(0.02)
STATES = np.array(
    [
        [100.0, 30.0, -50.0, -10.0, 0.05],
        [-8e3, -60.0, 9e3, 44.0, -0.3],
        [0.0, 1.0, 0.0, 0.0, 1e-7],
        [10.0, 36.0, 20.0, -44.0, 0.6],
    ]
)
FLIPPING = np.array([[0.3, 0.7], [0.7, 0.3]])


def turning(_, state):
    _, vx, _, vy, omega = state
    return [vx, -omega * vy, vy, omega * vx, 0.0]


@pytest.mark.parametrize("dt", [0.1, 6.0, 20.0])
@pytest.mark.parametrize("row", range(len(STATES)))
def test_coordinated_turn_mean_solves_the_equations_of_motion(row, dt):
    solution = solve_ivp(turning, (0.0, dt), STATES[row], rtol=1e-11, atol=1e-9)
    moved = CT.mean(STATES[row : row + 1], dt)[0]
    np.testing.assert_allclose(moved, solution.y[:, -1], rtol=1e-8, atol=1e-6)


@pytest.mark.parametrize("omega", [0.0, 1e-300, 1e-12, -1e-12])
def test_coordinated_turn_mean_tends_to_constant_velocity(omega):
    state = STATES.copy()
    state[:, OMEGA] = omega
    expected = CV.mean(state, 6.0)
    np.testing.assert_allclose(CT.mean(state, 6.0)[:, :4], expected[:, :4], rtol=1e-12, atol=1e-8)


def test_linear_motions_keep_position_or_direction():
    moved = CV.mean(STATES, 6.0)
    np.testing.assert_allclose(moved[:, [0, 2]], STATES[:, [0, 2]] + 6.0 * STATES[:, [1, 3]])
    np.testing.assert_array_equal(moved[:, [1, 3]], STATES[:, [1, 3]])
    np.testing.assert_array_equal(moved[:, OMEGA], 0.0)
    moved = REST.mean(STATES, 6.0)
    np.testing.assert_array_equal(moved[:, [0, 2]], STATES[:, [0, 2]])
    np.testing.assert_array_equal(moved[:, [1, 3, 4]], 0.0)
    drawn = motion.sample(CV, STATES, 6.0, np.random.default_rng(1))
    np.testing.assert_array_equal(drawn[:, OMEGA], 0.0)


@pytest.mark.parametrize("model", [CV, CT, RETURNING, REST])
def test_sample_has_the_model_moments_and_mean_leaves_its_argument(model):
    before = STATES.copy()
    model.mean(STATES, 6.0)
    np.testing.assert_array_equal(STATES, before)
    count = 40_000
    support = list(model.support)
    start = np.repeat(STATES[:1], count, axis=0)
    drawn = motion.sample(model, start, 6.0, np.random.default_rng(1))
    covariance = model.noise_covariance(6.0)
    noise = (drawn - model.mean(start, 6.0))[:, support]
    std = np.sqrt(np.diag(covariance))
    # Standard errors: std/sqrt(N) of a mean and at most sqrt(2/N) std std' of a covariance.
    assert np.all(np.abs(noise.mean(axis=0)) < 4.5 * std / np.sqrt(count))
    error = np.abs(np.cov(noise.T) - covariance)
    assert np.all(error < 4.5 * np.sqrt(2.0 / count) * np.outer(std, std))


@pytest.mark.parametrize("model", [CV, CT, RETURNING, REST])
@settings(deadline=None, max_examples=30)
@given(first=st.floats(0.1, 10.0), second=st.floats(0.1, 10.0))
def test_noise_covariance_over_two_intervals_is_that_of_their_sum(model, first, second):
    # Without a turn F is linear, and F(b) Q(a) F(b)' + Q(b) = Q(a + b) is the semigroup law.
    support = list(model.support)
    unit = np.eye(5)
    unit[:, OMEGA] = 0.0
    step = model.mean(unit, second).T[np.ix_(support, support)]
    if OMEGA in support:
        step[OMEGA, OMEGA] = model.arc(second)[3]
    chained = step @ model.noise_covariance(first) @ step.T + model.noise_covariance(second)
    np.testing.assert_allclose(model.noise_covariance(first + second), chained, rtol=1e-10)


@pytest.mark.parametrize("model", [CV, CT, RETURNING, REST])
@pytest.mark.parametrize("dt", [0.05, 6.0, 100.0])
def test_whitener_makes_the_noise_white_by_an_upper_triangle(model, dt):
    covariance = model.noise_covariance(dt)
    matrix, log_determinant = motion.whitener(covariance)
    np.testing.assert_allclose(
        matrix @ covariance @ matrix.T, np.eye(len(covariance)), rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(matrix, np.triu(matrix))
    sign, expected = np.linalg.slogdet(matrix)
    assert sign == 1.0
    assert log_determinant == pytest.approx(expected, rel=1e-12)


def central_differences(model, state, dt):
    """Return the derivatives of a model's mean, shape (N, D, D)."""
    columns = []
    for axis, step in enumerate([1.0, 1e-2, 1.0, 1e-2, 1e-6]):
        away = np.zeros(5)
        away[axis] = step
        apart = model.mean(state + away, dt) - model.mean(state - away, dt)
        columns.append(apart / (2.0 * step))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("dt", [1e-3, 6.0, 20.0, np.array([0.5, 6.0, 12.0, 3.0])])
@pytest.mark.parametrize("model", [CV, CT, RETURNING, REST], ids=["cv", "ct", "returning", "rest"])
def test_jacobian_is_the_derivative_of_the_mean(model, dt):
    np.testing.assert_allclose(
        model.jacobian(STATES, dt), central_differences(model, STATES, dt), rtol=1e-6, atol=1e-4
    )


def returning(_, state):
    return [*turning(_, state)[:4], -state[OMEGA] / RETURNING.turn_time_constant_s]


@pytest.mark.parametrize("dt", [0.1, 6.0, 20.0, 90.0])
@pytest.mark.parametrize("omega", [1e-4, -0.01, 0.05])
def test_turn_rate_that_returns_solves_the_equations_of_motion(omega, dt):
    state = np.array([100.0, 230.0, -50.0, -110.0, omega])
    solution = solve_ivp(returning, (0.0, dt), state, rtol=1e-11, atol=1e-9).y[:, -1]
    moved = RETURNING.mean(state[None], dt)[0]
    np.testing.assert_allclose(moved[[1, 3, 4]], solution[[1, 3, 4]], rtol=1e-8, atol=1e-8)
    # The position is exact to first order in the angle turned; an arc alone would not be.
    angle = abs(omega) * RETURNING.arc(dt)[0]
    off = np.hypot(*(moved - solution)[[0, 2]]) / (np.hypot(230.0, 110.0) * dt)
    assert off < 0.02 * angle**2 + 1e-9


def test_turn_rate_of_a_long_time_constant_does_not_return():
    slow = CoordinatedTurn(1.3, 1e-5, 1e9)
    np.testing.assert_allclose(slow.mean(STATES, 6.0), CT.mean(STATES, 6.0), rtol=1e-7)
    np.testing.assert_allclose(slow.noise_covariance(6.0), CT.noise_covariance(6.0), rtol=1e-7)
    np.testing.assert_allclose(slow.arc(6.0), CT.arc(6.0), rtol=1e-7, atol=1e-7)


def test_turn_rate_tends_to_its_stationary_distribution():
    state = STATES.copy()
    assert np.abs(RETURNING.mean(state, 1e3)[:, OMEGA]).max() < 1e-20
    variance = RETURNING.noise_covariance(1e3)[4, 4]
    assert variance == pytest.approx(0.5 * 15.0 * 1e-5, rel=1e-12)
    # Shorter intervals one after the other lead to the same.
    whole, halves = RETURNING.arc(np.array([8.0, 4.0]))
    assert whole[0] == pytest.approx(halves[0] * (1.0 + halves[3]), rel=1e-12)
    assert whole[3] == pytest.approx(halves[3] ** 2, rel=1e-12)


@pytest.mark.parametrize("omega", [0.0, 1e-12, -1e-9, 1.6e-5, -1.7e-5, 1e-4])
def test_coordinated_turn_jacobian_is_the_derivative_about_straight_flight(omega):
    state = np.array([[100.0, 230.0, -50.0, -110.0, omega]])
    # 1.65e-5 rad/s times 6 s is where the series ends.
    found = CT.jacobian(state, 6.0)
    np.testing.assert_allclose(found, central_differences(CT, state, 6.0), rtol=1e-5, atol=1e-3)
    # A turn moves a target across its velocity by half the square of the time.
    np.testing.assert_allclose(found[0, [0, 2], 4], [18.0 * 110.0, 18.0 * 230.0], rtol=3e-3)


def test_jacobian_takes_an_interval_for_each_row():
    dt = np.array([0.5, 6.0, 12.0, 3.0])
    for model in (CV, CT, RETURNING):
        found = model.jacobian(STATES, dt)
        moved = model.mean(STATES, dt)
        for row in range(len(STATES)):
            alone = STATES[row : row + 1]
            np.testing.assert_array_equal(found[row], model.jacobian(alone, dt[row])[0])
            np.testing.assert_array_equal(moved[row], model.mean(alone, dt[row])[0])


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
    given_rows = {"classes": ["class_0", "class_1"], "motions": ["cv", "ct", "cv_2"]}
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
