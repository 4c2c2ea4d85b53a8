"""Motion models: the mean of the next state and the process noise.

Every model has the same form, ``x' = mean(x, dt) + v``, ``v ~ N(0, Q(dt))``. The noise, and so the
transition density, is defined on the model's own `support`. Constant velocity has no turn rate, so
its density has four dimensions, and the coordinated turn's has five. Densities of different
dimensions cannot be compared; birth, spawn and survival of one mode therefore share its support.

The state is ``[x, vx, y, vy, omega]`` in the world frame, `state_space.PLANAR`, or with height and
climb rate ``[x, vx, y, vy, omega, z, vz]``, `state_space.SPATIAL`. Height and climb rate have a
white acceleration of their own, and depend on the others only by measurements.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from ..arrays import FloatArray, read_only
from ..state_space import OMEGA, PLANAR, VX, VY, VZ, StateSpace, X, Y, Z

# Turn angle below which a series is more accurate than quotients that cancel, radians.
STRAIGHT = 1e-4


@dataclass(frozen=True)
class MotionModel(ABC):
    """One motion mode's transition."""

    # The axes of the plane on which the mode's densities are defined. The mean is a matrix times
    # the state, or with a turn rate that of `CoordinatedTurn`.
    planar_support: ClassVar[tuple[int, ...]]

    # The axes of its states.
    space: StateSpace = field(default=PLANAR, kw_only=True)
    # Spectral density of the white vertical acceleration, m^2/s^3; not used in the plane.
    vertical_noise_density: float = field(default=1.0, kw_only=True)

    @property
    def support(self) -> tuple[int, ...]:
        """Indices of the state on which the mode's densities are defined; the others are zero."""
        return (*self.planar_support, *self.space.vertical)

    @abstractmethod
    def mean(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return each row's state after `dt` seconds without noise; (N, D) to (N, D).

        `dt` is one interval for all rows, or one for each, shape (N,).
        """

    @abstractmethod
    def jacobian(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return the derivatives of `mean` at each row's state; (N, D) to (N, D, D)."""

    @property
    def begun_turn_variance(self) -> float:
        """Variance of the turn rate of a target that begins this motion without one."""
        return 0.0

    def arc(self, dt: FloatArray | float) -> FloatArray:
        """Return the `turn_arc` of intervals in seconds, (...) to (..., 4)."""
        return turn_arc(dt, 0.0)

    @property
    @abstractmethod
    def noise_factors(self) -> FloatArray:
        """Factors of dt, dt^2 / 2 and dt^3 / 3 in Q(dt) on the support, (3, K, K).

        That of a turn rate is to first order if it returns to zero.
        """

    def noise_covariance(self, dt: FloatArray | float) -> FloatArray:
        """Return Q(dt) on the support, (K, K), or one for each of several intervals, (I, K, K)."""
        return noise_after(dt, self.noise_factors)

    def _with_vertical(self, planar: FloatArray) -> FloatArray:
        """Return `noise_factors`, given those on the plane's axes of the support."""
        if not self.space.vertical:
            return planar
        size = planar.shape[1]
        factors = np.zeros((3, size + 2, size + 2))
        factors[:, :size, :size] = planar
        factors[:, size:, size:] = white_acceleration(self.vertical_noise_density)
        return factors


def noise_after(dt: FloatArray | float, factors: FloatArray) -> FloatArray:
    """Return noise covariances after `dt` seconds, (..., K, K), given `noise_factors`.

    Given some of their columns it returns these columns.
    """
    linear, square, cube = factors
    noise: FloatArray = np.multiply.outer(dt, linear)
    noise += np.multiply.outer(dt**2 / 2.0, square)
    noise += np.multiply.outer(dt**3 / 3.0, cube)
    return noise


def turn_arc(dt: FloatArray | float, time_constant_s: float) -> FloatArray:
    """Return how a turn rate that returns to zero turns a velocity, (..., 4), for intervals (...).

    The columns are the angle turned for a unit rate at the beginning, in seconds; the duration of
    an arc with this angle, and of the straight line after it, seconds; and the share of the turn
    rate that is left.

    The rate w exp(-t / T) turns by w T (1 - exp(-dt / T)), which is exact. The position is the
    integral of the rotating velocity, which has no elementary form. An arc and then a straight line
    have the same angle, and the same position to first order in w. A time constant T of 0 stands
    for a rate that does not return: one arc.
    """
    duration = np.asarray(dt, dtype=np.float64)
    if not time_constant_s:
        zero = np.zeros_like(duration)
        return np.stack([duration, duration, zero, zero + 1.0], axis=-1)
    ratio = duration / time_constant_s
    share = _langevin(0.5 * ratio)
    angle, decay = -time_constant_s * np.expm1(-ratio), np.exp(-ratio)
    return np.stack([angle, duration * (1.0 - share), duration * share, decay], axis=-1)


def _langevin(value: FloatArray) -> FloatArray:
    """Return coth x - 1 / x of positive numbers, by its series where the two cancel."""
    # Below it the series is more accurate, as rounding errors cancel no digits.
    small = value < 1e-2
    safe = np.where(small, 1.0, value)
    series = value / 3.0 - value**3 / 45.0
    return np.where(small, series, 1.0 / np.tanh(safe) - 1.0 / safe)


def _identity(state: FloatArray, axes: tuple[int, ...]) -> FloatArray:
    """Return for each row the matrix that keeps these axes, the others zero; (N, D, D)."""
    matrix = np.zeros((*state.shape, state.shape[1]))
    for axis in axes:
        matrix[:, axis, axis] = 1.0
    return matrix


def white_acceleration(spectral_density: float) -> FloatArray:
    """Return the `noise_factors` of a position and its velocity with white acceleration."""
    linear, square, cube = (
        ((0.0, 0.0), (0.0, 1.0)),
        ((0.0, 1.0), (1.0, 0.0)),
        ((1.0, 0.0), (0.0, 0.0)),
    )
    return spectral_density * np.array([linear, square, cube])


def _planar_factors(spectral_density: float) -> FloatArray:
    """Return the `noise_factors` of (x, vx, y, vy) with white acceleration."""
    factors = np.zeros((3, 4, 4))
    factors[:, :2, :2] = factors[:, 2:, 2:] = white_acceleration(spectral_density)
    return factors


def _climb(state: FloatArray, dt: FloatArray | float) -> None:
    """Write the height of each row after `dt` seconds, if it has one; (..., N, D)."""
    if state.shape[-1] > VZ:
        state[..., Z] += dt * state[..., VZ]


@dataclass(frozen=True)
class ConstantVelocity(MotionModel):
    """Nearly constant velocity, turn rate zero.

    Sec. V, F_{k,CV} and Q_{k,CV}. Deviation: the printed variance of omega is zero, a point mass,
    so the densities of this mode are four-dimensional here.
    """

    noise_density: float  # Spectral density l of the white acceleration, m^2/s^3
    planar_support: ClassVar[tuple[int, ...]] = (X, VX, Y, VY)

    def mean(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return F(dt) x of each row, its turn rate zero; shape (N, D)."""
        predicted: FloatArray = state.copy()
        predicted[:, X] += dt * state[:, VX]
        predicted[:, Y] += dt * state[:, VY]
        predicted[:, OMEGA] = 0.0
        _climb(predicted, dt)
        return predicted

    def jacobian(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return F(dt) for each row; shape (N, D, D)."""
        matrix = _identity(state, self.support)
        matrix[:, X, VX] = matrix[:, Y, VY] = dt
        if self.space.vertical:
            matrix[:, Z, VZ] = dt
        return matrix

    @cached_property
    def noise_factors(self) -> FloatArray:
        """See `MotionModel`."""
        return self._with_vertical(_planar_factors(self.noise_density))


@dataclass(frozen=True)
class CoordinatedTurn(MotionModel):
    """Coordinated turn with unknown turn rate, a first-order Gauss-Markov process.

    Sec. V, F_{k,CT} and Q_{k,CT}. Deviation: the printed position terms -cos(wT)/w do not vanish
    at T = 0; the integral of the rotating velocity gives -(1 - cos wT)/w in the first row and
    +(1 - cos wT)/w in the third. Both quotients are written with the half angle a = wT/2, as
    T (sin a / a) cos a and T (sin a / a) sin a, which is exact at w = 0. Deviation: the turn rate
    returns to zero with a time constant; without one it is the paper's random walk. See `turn_arc`.
    """

    noise_density: float  # Spectral density l1 of the white acceleration, m^2/s^3
    turn_noise_density: float  # Spectral density l2 of the white turn acceleration, rad^2/s^3
    turn_time_constant_s: float = 0.0  # With which the turn rate returns to zero; 0 if it does not
    planar_support: ClassVar[tuple[int, ...]] = (X, VX, Y, VY, OMEGA)

    def mean(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return F(omega, dt) x of each row; shape (..., N, D), as that of `state`."""
        omega = state[..., OMEGA]
        angle_s, arc_s, straight_s, decay = np.moveaxis(self.arc(dt), -1, 0)
        half = 0.5 * angle_s * omega
        cos_half, sin_half = np.cos(half), np.sin(half)
        straight = half == 0.0
        chord = arc_s * np.where(straight, 1.0, sin_half) / np.where(straight, 1.0, half)
        cos, sin = 1.0 - 2.0 * sin_half**2, 2.0 * sin_half * cos_half
        along, across = chord * cos_half + straight_s * cos, chord * sin_half + straight_s * sin
        vx, vy = state[..., VX], state[..., VY]
        predicted: FloatArray = state.copy()
        predicted[..., X] = state[..., X] + along * vx - across * vy
        predicted[..., VX] = cos * vx - sin * vy
        predicted[..., Y] = state[..., Y] + across * vx + along * vy
        predicted[..., VY] = sin * vx + cos * vy
        predicted[..., OMEGA] = decay * omega
        _climb(predicted, dt)
        return predicted

    @property
    def begun_turn_variance(self) -> float:
        """See `MotionModel`. That of the turn rate in the long run."""
        return 0.5 * self.turn_time_constant_s * self.turn_noise_density

    def arc(self, dt: FloatArray | float) -> FloatArray:
        """See `MotionModel`."""
        return turn_arc(dt, self.turn_time_constant_s)

    def jacobian(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return the derivatives of `mean` at each row's state; shape (N, D, D).

        With the angle a = w g of an arc of t seconds, s = t sin(a)/a and c = t (1 - cos a)/a, the
        derivatives of these by w are (t cos a - s)/w and (t sin a - c)/w. Below `STRAIGHT` their
        series replace them. The straight line after the arc turns with its end.
        """
        omega = state[:, OMEGA]
        angle_s, arc_s, straight_s, decay = np.moveaxis(self.arc(dt), -1, 0)
        angle = angle_s * omega
        cos, sin = np.cos(angle), np.sin(angle)
        half = np.sinc(0.5 * angle / np.pi)
        along, across = arc_s * np.sinc(angle / np.pi), 0.5 * arc_s * angle * half**2
        straight = np.abs(angle) < STRAIGHT
        divisor = np.where(straight, 1.0, omega)
        series = -arc_s * angle_s**2 * omega / 3.0, 0.5 * arc_s * angle_s
        along_rate = np.where(straight, series[0], (arc_s * cos - along) / divisor)
        across_rate = np.where(straight, series[1], (arc_s * sin - across) / divisor)
        along_rate, across_rate = (
            along_rate - angle_s * straight_s * sin,
            across_rate + angle_s * straight_s * cos,
        )
        along, across = along + straight_s * cos, across + straight_s * sin
        vx, vy = state[:, VX], state[:, VY]
        matrix = _identity(state, (X, Y, *self.space.vertical))
        matrix[:, OMEGA, OMEGA] = decay
        if self.space.vertical:
            matrix[:, Z, VZ] = dt
        matrix[:, X, VX] = matrix[:, Y, VY] = along
        matrix[:, Y, VX], matrix[:, X, VY] = across, -across
        matrix[:, VX, VX] = matrix[:, VY, VY] = cos
        matrix[:, VY, VX], matrix[:, VX, VY] = sin, -sin
        matrix[:, X, OMEGA] = along_rate * vx - across_rate * vy
        matrix[:, Y, OMEGA] = across_rate * vx + along_rate * vy
        matrix[:, VX, OMEGA] = -angle_s * (sin * vx + cos * vy)
        matrix[:, VY, OMEGA] = angle_s * (cos * vx - sin * vy)
        return matrix

    def noise_covariance(self, dt: FloatArray | float) -> FloatArray:
        """See `MotionModel`. The turn rate's variance tends to l2 times half its time constant."""
        noise = super().noise_covariance(dt)
        if self.turn_time_constant_s:
            tau = self.turn_time_constant_s
            noise[..., 4, 4] = -0.5 * tau * self.turn_noise_density * np.expm1(-2.0 * dt / tau)
        return noise

    @cached_property
    def noise_factors(self) -> FloatArray:
        """See `MotionModel`."""
        factors = np.zeros((3, 5, 5))
        factors[:, :4, :4] = _planar_factors(self.noise_density)
        factors[0, 4, 4] = self.turn_noise_density
        return self._with_vertical(factors)


@dataclass(frozen=True)
class Stationary(MotionModel):
    """At rest: a position that drifts slowly, with neither velocity nor turn rate.

    In space its height drifts as well, and has no climb rate.
    """

    # Spectral density of the white velocity with which the position drifts, m^2/s, as that of a
    # ship at anchor.
    noise_density: float
    planar_support: ClassVar[tuple[int, ...]] = (X, Y)

    @property
    def support(self) -> tuple[int, ...]:
        """See `MotionModel`."""
        return self.space.place

    def mean(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return each row's position, at rest; shape (N, D)."""
        predicted = np.zeros_like(state)
        predicted[:, self.support] = state[:, self.support]
        return predicted

    def jacobian(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return the derivatives of `mean`; shape (N, D, D)."""
        return _identity(state, self.support)

    @cached_property
    def noise_factors(self) -> FloatArray:
        """See `MotionModel`."""
        size = len(self.support)
        factors = np.zeros((3, size, size))
        factors[0] = self.noise_density * np.eye(size)
        return factors


# Motion models by the name in configurations. Configurable fields of a motion are its parameters.
MOTIONS: dict[str, type[MotionModel]] = {
    "constant_velocity": ConstantVelocity,
    "coordinated_turn": CoordinatedTurn,
    "stationary": Stationary,
}


def sample(
    model: MotionModel, state: FloatArray, dt: float, rng: np.random.Generator
) -> FloatArray:
    """Draw the next state of every row of `state` from `model`; shape (N, D)."""
    drawn = model.mean(state, dt)
    factor = np.linalg.cholesky(model.noise_covariance(dt))
    noise = rng.standard_normal((len(state), len(model.support))) @ factor.T
    for column, axis in enumerate(model.support):
        drawn[:, axis] += noise[:, column]
    return drawn


def whitener(covariance: FloatArray) -> tuple[FloatArray, float]:
    """Return W with ``W covariance W' = I``, upper triangular, and log |det W|.

    As W is upper triangular, a velocity is scaled by itself, and a position is conditioned on its
    velocity. The particles of a tracked target then spread in the position coordinates only, and
    a neighbour search over those two is enough.
    """
    return _whitener(len(covariance), np.asarray(covariance, dtype=np.float64).tobytes())


# Results are cached, because intervals and noise seldom change: with few targets this is a tenth of
# a kernel's time.
@lru_cache(maxsize=64)
def _whitener(size: int, entries: bytes) -> tuple[FloatArray, float]:
    covariance = np.frombuffer(entries).reshape(size, size)
    # The Cholesky factor of the reversed matrix, reversed back, is the upper-triangular one.
    upper = np.linalg.cholesky(covariance[::-1, ::-1])[::-1, ::-1]
    inverse = np.linalg.inv(upper)
    return read_only(inverse), float(np.log(np.diag(inverse)).sum())
