"""Motion models: the mean of the next state and the process noise.

Every model has the same form, ``x' = mean(x, dt) + v``, ``v ~ N(0, Q(dt))``. The noise, and so the
transition density, is defined on the model's own `support`. Constant velocity has no turn rate, so
its density has four dimensions, and the coordinated turn's has five. Densities of different
dimensions cannot be compared; birth, spawn and survival of one mode therefore share its support.

The state is ``[x, vx, y, vy, omega]`` in the world frame, `state_space.PLANAR`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from ..arrays import FloatArray, read_only
from ..state_space import OMEGA, PLANAR, VX, VY, StateSpace, X, Y

# Turn angle below which a series is more accurate than quotients that cancel, radians.
STRAIGHT = 1e-4


@dataclass(frozen=True)
class MotionModel(ABC):
    """One motion mode's transition."""

    # The axes of its states.
    space: ClassVar[StateSpace] = PLANAR
    # Indices of the state on which the mode's densities are defined; the others are zero. The mean
    # is a matrix times the state, or with a turn rate that of `CoordinatedTurn`.
    support: ClassVar[tuple[int, ...]]

    @abstractmethod
    def mean(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return each row's state after `dt` seconds without noise; (N, D) to (N, D).

        `dt` is one interval for all rows, or one for each, shape (N,).
        """

    @abstractmethod
    def jacobian(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return the derivatives of `mean` at each row's state; (N, D) to (N, D, D)."""

    @property
    @abstractmethod
    def noise_factors(self) -> FloatArray:
        """Factors of dt, dt^2 / 2 and dt^3 / 3 in Q(dt) on the support, (3, K, K)."""

    def noise_covariance(self, dt: FloatArray | float) -> FloatArray:
        """Return Q(dt) on the support, (K, K), or one for each of several intervals, (I, K, K)."""
        return noise_after(dt, self.noise_factors)


def noise_after(dt: FloatArray | float, factors: FloatArray) -> FloatArray:
    """Return noise covariances after `dt` seconds, (..., K, K), given `noise_factors`.

    Given some of their columns it returns these columns.
    """
    linear, square, cube = factors
    noise: FloatArray = np.multiply.outer(dt, linear)
    noise += np.multiply.outer(dt**2 / 2.0, square)
    noise += np.multiply.outer(dt**3 / 3.0, cube)
    return noise


def _identity(state: FloatArray, axes: tuple[int, ...]) -> FloatArray:
    """Return for each row the matrix that keeps these axes, the others zero; (N, D, D)."""
    matrix = np.zeros((*state.shape, state.shape[1]))
    for axis in axes:
        matrix[:, axis, axis] = 1.0
    return matrix


def _planar_factors(spectral_density: float) -> FloatArray:
    """Return the `noise_factors` of (x, vx, y, vy) with white acceleration."""
    factors = np.zeros((3, 4, 4))
    for position, velocity in ((0, 1), (2, 3)):
        factors[0, velocity, velocity] = spectral_density
        factors[1, position, velocity] = factors[1, velocity, position] = spectral_density
        factors[2, position, position] = spectral_density
    return factors


@dataclass(frozen=True)
class ConstantVelocity(MotionModel):
    """Nearly constant velocity, turn rate zero.

    Sec. V, F_{k,CV} and Q_{k,CV}. Deviation: the printed variance of omega is zero, a point mass,
    so the densities of this mode are four-dimensional here.
    """

    noise_density: float  # Spectral density l of the white acceleration, m^2/s^3
    support: ClassVar[tuple[int, ...]] = (X, VX, Y, VY)

    def mean(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return F(dt) x of each row, its turn rate zero; shape (N, D)."""
        predicted: FloatArray = state.copy()
        predicted[:, X] += dt * state[:, VX]
        predicted[:, Y] += dt * state[:, VY]
        predicted[:, OMEGA] = 0.0
        return predicted

    def jacobian(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return F(dt) for each row; shape (N, D, D)."""
        matrix = _identity(state, self.support)
        matrix[:, X, VX] = matrix[:, Y, VY] = dt
        return matrix

    @cached_property
    def noise_factors(self) -> FloatArray:
        """See `MotionModel`, (3, 4, 4)."""
        return _planar_factors(self.noise_density)


@dataclass(frozen=True)
class CoordinatedTurn(MotionModel):
    """Coordinated turn with unknown turn rate.

    Sec. V, F_{k,CT} and Q_{k,CT}. Deviation: the printed position terms -cos(wT)/w do not vanish
    at T = 0; the integral of the rotating velocity gives -(1 - cos wT)/w in the first row and
    +(1 - cos wT)/w in the third. Both quotients are written with the half angle a = wT/2, as
    T (sin a / a) cos a and T (sin a / a) sin a, which is exact at w = 0.
    """

    noise_density: float  # Spectral density l1 of the white acceleration, m^2/s^3
    turn_noise_density: float  # Spectral density l2 of the white turn acceleration, rad^2/s^3
    support: ClassVar[tuple[int, ...]] = (X, VX, Y, VY, OMEGA)

    def mean(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return F(omega, dt) x of each row; shape (..., N, D), as that of `state`."""
        omega = state[..., OMEGA]
        half = 0.5 * dt * omega
        cos_half, sin_half = np.cos(half), np.sin(half)
        straight = half == 0.0
        chord = dt * np.where(straight, 1.0, sin_half) / np.where(straight, 1.0, half)
        along, across = chord * cos_half, chord * sin_half
        cos, sin = 1.0 - 2.0 * sin_half**2, 2.0 * sin_half * cos_half
        vx, vy = state[..., VX], state[..., VY]
        predicted = np.empty(state.shape)
        predicted[..., X] = state[..., X] + along * vx - across * vy
        predicted[..., VX] = cos * vx - sin * vy
        predicted[..., Y] = state[..., Y] + across * vx + along * vy
        predicted[..., VY] = sin * vx + cos * vy
        predicted[..., OMEGA] = omega
        return predicted

    def jacobian(self, state: FloatArray, dt: FloatArray | float) -> FloatArray:
        """Return the derivatives of `mean` at each row's state; shape (N, D, D).

        With s = sin(wT)/w and c = (1 - cos wT)/w, their derivatives by w are
        (T cos wT - s)/w and (T sin wT - c)/w. Below `STRAIGHT` their series replace them.
        """
        omega = state[:, OMEGA]
        angle = dt * omega
        cos, sin = np.cos(angle), np.sin(angle)
        half = np.sinc(0.5 * angle / np.pi)
        along, across = dt * np.sinc(angle / np.pi), 0.5 * dt * angle * half**2
        straight = np.abs(angle) < STRAIGHT
        divisor = np.where(straight, 1.0, omega)
        along_rate = np.where(straight, -(dt**3) * omega / 3.0, (dt * cos - along) / divisor)
        across_rate = np.where(straight, 0.5 * dt**2, (dt * sin - across) / divisor)
        vx, vy = state[:, VX], state[:, VY]
        matrix = _identity(state, (X, Y, OMEGA))
        matrix[:, X, VX] = matrix[:, Y, VY] = along
        matrix[:, Y, VX], matrix[:, X, VY] = across, -across
        matrix[:, VX, VX] = matrix[:, VY, VY] = cos
        matrix[:, VY, VX], matrix[:, VX, VY] = sin, -sin
        matrix[:, X, OMEGA] = along_rate * vx - across_rate * vy
        matrix[:, Y, OMEGA] = across_rate * vx + along_rate * vy
        matrix[:, VX, OMEGA] = -dt * (sin * vx + cos * vy)
        matrix[:, VY, OMEGA] = dt * (cos * vx - sin * vy)
        return matrix

    @cached_property
    def noise_factors(self) -> FloatArray:
        """See `MotionModel`, (3, 5, 5)."""
        factors = np.zeros((3, 5, 5))
        factors[:, :4, :4] = _planar_factors(self.noise_density)
        factors[0, 4, 4] = self.turn_noise_density
        return factors


@dataclass(frozen=True)
class Stationary(MotionModel):
    """At rest: a position that drifts slowly, with neither velocity nor turn rate."""

    # Spectral density of the white velocity with which the position drifts, m^2/s, as that of a
    # ship at anchor.
    noise_density: float
    support: ClassVar[tuple[int, ...]] = (X, Y)

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
        """See `MotionModel`, (3, 2, 2)."""
        factors = np.zeros((3, 2, 2))
        factors[0] = self.noise_density * np.eye(2)
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
