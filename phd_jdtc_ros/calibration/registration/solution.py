"""Estimates the biases of all radars, alternating between common targets and biases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias

from .common import (
    KINDS,
    UNITS,
    Pass,
    RegistrationError,
    Sequences,
    Target,
    TrackedRadar,
    Trajectories,
    common_targets,
    filter_targets,
    sequences,
    smooth_targets,
)

# A bias is not observable if its standard deviation exceeds this share of one plot's.
OBSERVABLE_SHARE = 0.5


@dataclass(frozen=True)
class Observability:
    """The biases that can be estimated."""

    free: BoolArray  # True where each of the P biases can be estimated, (P,)
    # Covariance of the biases in the equations' units, (P, P); zero for those that are not free.
    covariance: FloatArray
    common: tuple[str, ...]  # Kinds of biases for which the reference radar is assumed to have none
    hidden: tuple[int, ...]  # Indices of the unobservable biases of other radars


def analyse(
    information: FloatArray,
    one_plot: FloatArray,
    reference: int,
    exact: Sequence[bool] = (),
) -> Observability:
    """Determine which biases can be estimated, given their information matrix, shape (P, P).

    `one_plot`, shape (P,), is the standard deviation of one plot as a bias of each kind, in the
    equations' units; `reference` is the index of the reference radar, and `exact` tells which of
    the radars have no bias; empty if any may have one.
    """
    free = np.ones(len(one_plot), dtype=bool)
    kinds = len(KINDS)
    if exact:
        free &= ~np.repeat(exact, kinds)
    time_offset = KINDS.index("time_offset_s")
    free[kinds * reference + time_offset] = False
    common, hidden = [KINDS[time_offset]], []
    while free.any():
        rows = np.flatnonzero(free)
        scaled = information[np.ix_(rows, rows)] * np.outer(one_plot[rows], one_plot[rows])
        value, vector = np.linalg.eigh(scaled)
        value = np.maximum(value, 1e-12)
        std = np.sqrt(((vector**2) / value).sum(axis=1))
        if std.max() < OBSERVABLE_SHARE:
            break
        # The least observable combination of biases decides.
        share = vector[:, 0] ** 2
        by_kind = np.array([share[rows % kinds == kind].sum() for kind in range(kinds)])
        kind = int(np.argmax(by_kind))
        own = kinds * reference + kind
        if free[own] and share[rows == own].max() > 0.02:
            free[own] = False
            common.append(KINDS[kind])
        else:
            worst = int(rows[np.argmax(np.where(rows // kinds != reference, share, -1.0))])
            if worst // kinds == reference:
                worst = int(rows[np.argmax(share)])
            free[worst] = False
            hidden.append(worst)
    covariance = np.zeros_like(information)
    rows = np.flatnonzero(free)
    if len(rows):
        covariance[np.ix_(rows, rows)] = np.linalg.inv(information[np.ix_(rows, rows)])
    return Observability(free, covariance, tuple(common), tuple(hidden))


def require_common(radars: Sequence[TrackedRadar], targets: Sequence[Target]) -> None:
    """Raise `RegistrationError` if a radar has no target in common with the others."""
    groups = [{index} for index in range(len(radars))]
    for target in targets:
        own = {radar for radar, _ in target}
        linked = [group for group in groups if group & own]
        groups = [own.union(*linked), *(group for group in groups if group not in linked)]
    largest = max(groups, key=lambda group: (len(group), -min(group)))
    if len(largest) == len(radars):
        return
    others = set(range(len(radars))) - (largest if len(largest) > 1 else set())
    alone = [radars[index] for index in sorted(others)]
    end = min(float(each.time_s[-1]) for each in radars)
    seconds = max(end - max(float(each.time_s[0]) for each in radars), 0.0)
    counts = "; ".join(f"{each.name} has {len(each.tracks)} tracks" for each in alone)
    raise RegistrationError(
        f"no common targets: {counts}, none near a track of another radar, in the {seconds:.0f} s "
        "covered by all radars; check position, yaw_deg (to 1 degree) and clocks (to 1 s), or "
        "record longer"
    )


def require_observable(
    radars: Sequence[TrackedRadar], free: BoolArray, reference: int, plots: Sequences
) -> None:
    """Raise `RegistrationError` if no bias of a radar but the reference is observable."""
    nothing = [
        each.name
        for index, each in enumerate(radars)
        if not (index == reference or each.exact) and not free.reshape(-1, len(KINDS))[index].any()
    ]
    if nothing:
        raise RegistrationError(
            f"{', '.join(nothing)}: no bias is observable: {hidden_reason(radars, plots)}"
        )


def hidden_reason(radars: Sequence[TrackedRadar], plots: Sequences) -> str:
    """Return the reason why biases are unobservable."""
    count, targets = int(np.count_nonzero(plots.valid)), plots.valid.shape[1]
    seen = f"{targets} common tracks with {count} plots"
    place = plots.position[plots.valid]
    extent = np.linalg.svd(place - place.mean(axis=0), compute_uv=False)
    # Targets are on a line if their extent across it is below this share of the extent along it.
    if extent[1] < 0.02 * extent[0]:
        return f"{seen}, all on one line"
    begin, end = plots.time_s[plots.valid].min(), plots.time_s[plots.valid].max()
    looks = (end - begin) / max(each.look_s for each in radars)
    # A recording with fewer scans is short.
    if looks < 20.0:
        return f"{seen}, too short: {looks:.0f} looks in {end - begin:.0f} s"
    return f"{seen}, too few, or all in one place"


# Largest number of association rounds, and number of relinearisations in each. A pass before these
# finds the process noise.
ROUNDS, PASSES = 3, 3
# Plots with larger residuals, in standard deviations, have less weight, but at least LEAST_WEIGHT.
FAR, LEAST_WEIGHT = 2.5, 0.02
# Search for the process noise: factor of a step, and largest number of steps.
FACTOR, STEPS = 4.0, 8


@dataclass(frozen=True)
class Residuals:
    """Residuals of one radar's plots against the trajectories from all radars."""

    time_s: FloatArray  # Ascending only within a target, seconds, (N,)
    before: FloatArray  # In range and azimuth of the plots as reported, metres and radians, (N, 2)
    after: FloatArray  # After removal of the estimated biases, (N, 2)


@dataclass(frozen=True)
class RadarEstimate:
    """The estimated biases of one radar."""

    name: str
    bias: SensorBias  # Zero for unobservable biases
    # Standard deviations in the order and units of a `SensorBias`, (4,); NaN for unobservable
    # biases.
    std: FloatArray
    # Number of common tracks with its plots; a target that is lost and found again counts twice.
    tracks: int
    plots: int  # Number of these plots
    residuals: Residuals


@dataclass(frozen=True)
class Registration:
    """The estimated biases of all radars."""

    radars: tuple[RadarEstimate, ...]
    reference: str  # The radar that is assumed to have no bias of the kinds in `common`
    common: tuple[str, ...]  # Kinds of biases that are unobservable if all radars share them
    # Why the bias of another radar is unobservable, by radar and kind.
    hidden: dict[tuple[str, str], str]
    tracks: int  # Number of common tracks


@dataclass(frozen=True)
class _Iteration:
    """The estimates after an association round."""

    targets: Sequence[Target]
    biases: tuple[SensorBias, ...]
    std: FloatArray  # Standard deviations of the biases in `UNITS`, (P,); NaN if unobservable
    observability: Observability
    density: float  # Spectral density of the white acceleration, m^2/s^3
    plots: Sequences
    trajectories: Trajectories


def register(radars: Sequence[TrackedRadar], reference: str) -> Registration:
    """Estimate the biases of at least two radars, with the targets as nuisance parameters.

    The radar named `reference` is assumed to have no bias where the recording cannot show it. Raise
    `RegistrationError` with the reason if no bias of some radar is observable.
    """
    index = [each.name for each in radars].index(reference)
    biases: tuple[SensorBias, ...] = (NO_BIAS,) * len(radars)
    density = _first_density(radars)
    for number in range(ROUNDS):
        targets = common_targets(radars, biases, known=number > 0)
        require_common(radars, targets)
        before = biases
        found = _iterate(radars, targets, biases, density, index)
        biases, density = found.biases, found.density
        # The rounds end when no bias changes by more than this many standard deviations.
        if number and _change(before, found) < 0.2:
            break
    require_observable(radars, found.observability.free, index, found.plots)
    return _registration(radars, found, reference)


def _iterate(
    radars: Sequence[TrackedRadar],
    targets: Sequence[Target],
    biases: Sequence[SensorBias],
    density: float,
    reference: int,
) -> _Iteration:
    """Return the biases of all radars, given the targets, by repeated linearisation."""
    plots = sequences(radars, biases, targets)
    weight = np.ones(plots.radar.shape)
    # The velocities are unknown until the first pass.
    trajectories = Trajectories(plots.position, np.zeros_like(plots.position))
    for number in range(PASSES + 1):
        found = filter_targets(plots, trajectories, density, weight, len(radars))
        plot_noise = _noise_of_one_plot(radars, plots, trajectories)
        exact = [each.exact for each in radars]
        observability = analyse(found.information, plot_noise, reference, exact)
        correction = found.bias_estimate(observability.free)
        trajectories = smooth_targets(plots, found, correction, density)
        if number == 0:
            density = _best_density(plots, trajectories, density, weight, len(radars))
            continue
        biases = _add_correction(biases, correction)
        std = _standard_deviations(found, correction, observability)
        plots = sequences(radars, biases, targets)
        weight = _weights(plots, trajectories)
    return _Iteration(targets, tuple(biases), std, observability, density, plots, trajectories)


def _add_correction(biases: Sequence[SensorBias], correction: FloatArray) -> list[SensorBias]:
    """Return the biases after a correction in `UNITS`."""
    rows = correction.reshape(-1, len(KINDS)) * UNITS
    return [
        bias.followed_by(SensorBias(*row.tolist())) for bias, row in zip(biases, rows, strict=True)
    ]


def _weights(plots: Sequences, trajectories: Trajectories) -> FloatArray:
    """Return the weights of plots; those far from their target's trajectory have less weight.

    The noise's standard deviation is divided by the weight. A plot with residual r has the weight
    c / r, and so the information (c / r)^2; with Huber's weights it would have c / r.
    """
    distance2 = ((_residual(plots, trajectories) / plots.noise_std) ** 2).sum(axis=-1)
    # Median of the square of a two-dimensional residual of unit variances.
    scale = np.sqrt(np.median(distance2[plots.valid]) / (2.0 * np.log(2.0)))
    far = np.sqrt(distance2) / max(float(scale), 1e-9)
    weight: FloatArray = np.maximum(FAR / np.maximum(far, FAR), LEAST_WEIGHT)
    return weight


def _residual(plots: Sequences, trajectories: Trajectories) -> FloatArray:
    """Return the residuals of plots against the trajectories, shape (K, T, 2)."""
    expected, _ = kinematics.linearise(trajectories.position, plots.pose)
    return kinematics.residual(plots.measurement, expected)


def _standard_deviations(
    found: Pass, correction: FloatArray, observability: Observability
) -> FloatArray:
    """Return the standard deviations of the biases in `UNITS`, NaN if unobservable, shape (P,).

    Each is the larger of the standard deviation from the plot noise and the sandwich estimate over
    targets (White 1980): a target that manoeuvres, or contains plots of another target, has
    correlated errors.
    """
    rest = found.score - found.information_of @ correction
    sandwich = observability.covariance @ (rest.T @ rest) @ observability.covariance
    std = np.sqrt(np.maximum(np.diag(observability.covariance), np.diag(sandwich)))
    return np.where(observability.free, std, np.nan)


def _noise_of_one_plot(
    radars: Sequence[TrackedRadar], plots: Sequences, trajectories: Trajectories
) -> FloatArray:
    """Return the noise of one plot of each radar as a bias of each kind, in `UNITS`, (P,)."""
    found = []
    for index, each in enumerate(radars):
        own = plots.valid & (plots.radar == index)
        range_std, azimuth_std = each.noise_std
        farthest = float(plots.measurement[..., 0][own].max(initial=1.0))
        # Speed that is assumed if all targets are stationary, m/s.
        speed = max(float(np.median(np.hypot(*trajectories.velocity[own].T))), 0.1)
        found.append([range_std, range_std / farthest, azimuth_std, range_std / speed])
    scaled: FloatArray = np.array(found) / UNITS
    return scaled.ravel()


def _first_density(radars: Sequence[TrackedRadar]) -> float:
    """Return an initial spectral density of the white acceleration, m^2/s^3."""
    position = min(float(each.noise_std[0]) for each in radars)
    # Acceleration displaces a target by half a standard deviation of range between two scans.
    return 3.0 * (0.5 * position) ** 2 / max(each.look_s for each in radars) ** 3


def _best_density(
    plots: Sequences, trajectories: Trajectories, start: float, weight: FloatArray, radars: int
) -> float:
    """Return the most probable spectral density, within a factor of two."""

    def value(density: float) -> float:
        return filter_targets(plots, trajectories, density, weight, radars).log_likelihood

    best, best_value = start, value(start)
    for factor in (FACTOR, 1.0 / FACTOR):
        for _ in range(STEPS):
            tried = value(best * factor)
            if tried <= best_value:
                break
            best, best_value = best * factor, tried
        if best != start:
            break
    return best


def _change(before: Sequence[SensorBias], found: _Iteration) -> float:
    """Return the largest change of a bias, in its standard deviations; 0 if none is observable."""
    old, new = (np.array([astuple(bias) for bias in biases]) for biases in (before, found.biases))
    return float(np.nan_to_num(np.abs(((new - old) / UNITS).ravel() / found.std)).max())


def _registration(
    radars: Sequence[TrackedRadar], found: _Iteration, reference: str
) -> Registration:
    std = found.std.reshape(-1, len(KINDS)) * UNITS
    estimates = []
    for index, each in enumerate(radars):
        own = found.plots.valid & (found.plots.radar == index)
        estimates.append(
            RadarEstimate(
                each.name,
                found.biases[index],
                std[index],
                int(np.count_nonzero(own.any(axis=0))),
                int(np.count_nonzero(own)),
                _residuals(each, found, index),
            )
        )
    places = (divmod(bias, len(KINDS)) for bias in sorted(found.observability.hidden))
    names = [(radars[index].name, KINDS[kind]) for index, kind in places]
    return Registration(
        tuple(estimates),
        reference,
        found.observability.common,
        dict.fromkeys(names, hidden_reason(radars, found.plots)),
        len(found.targets),
    )


def _residuals(radar: TrackedRadar, found: _Iteration, index: int) -> Residuals:
    """Return the residuals of a radar's plots, as reported and corrected."""
    plots, own = found.plots, found.plots.valid & (found.plots.radar == index)
    plot, pose = plots.plot[own], plots.pose[own]
    late_s = found.biases[index].time_offset_s
    trajectories = found.trajectories
    position, velocity = trajectories.position[own], trajectories.velocity[own]
    # A plot as reported has a stamp that is late by the time offset.
    expected, _ = kinematics.linearise(position + late_s * velocity, pose)
    return Residuals(
        plots.time_s[own],
        kinematics.residual(radar.measurement[plot], expected),
        _residual(plots, trajectories)[own],
    )
