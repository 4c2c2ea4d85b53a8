"""The parameters of the tracker: names, defaults, units and bounds.

Parameters are flat dotted names with plain values, as in ROS. Four lists name the parts
(`sensors`, `classes`, `motions`, `births`), and every name in them has its own parameters, such as
``radar_1.range_std``. The defaults are the reference scenario. Units are SI unless a suffix names
another.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from phd_jdtc_ros.core.targets.motion import MOTIONS

from . import forms
from .radar_parameters import USUAL_FIELDS, Radar
from .schema import SMALL, Parameter, Value, parameter, table

# Every class has rates of its own, found by a matrix logarithm, and every name has parameters: with
# many of them a start would take longer than anybody waits to hear what is wrong.
MOST_SENSORS, MOST_CLASSES, MOST_MOTIONS, MOST_BIRTHS = 100, 50, 50, 1000
# Those of particles are the PHD filter's two; see `engines`.
ENGINES = ("gaussian", "particles", "phd", "phd_as_printed")
LABELLED = ("gaussian", "particles")
ACCURACIES = ("fast", "normal", "high")


@dataclass(frozen=True)
class Tracking:
    """What the whole tracker has."""

    world_frame: str = parameter("map", "Frame of the estimates (ENU, metres).")
    world_origin: list[float] = parameter(
        [],
        "Latitude and longitude, degrees (WGS84), of the world frame's zero, and the height, m, of "
        "its z = 0; x and y are then in the stereographic plane about it. Empty: the world is a "
        "plane anywhere.",
        -1e4,
        1e4,
    )
    sensors: list[str] = parameter(
        ["radar_1", "radar_2"],
        "Names of the sensors, in the order of updates.",
        element=str,
        most=MOST_SENSORS,
    )
    classes: list[str] = parameter(
        ["class_0", "class_1"], "Names of the target classes.", element=str, most=MOST_CLASSES
    )
    motions: list[str] = parameter(
        ["cv", "ct"], "Names of the motion models.", element=str, most=MOST_MOTIONS
    )
    births: list[str] = parameter(
        ["start_1", "start_2", "start_3", "start_4"],
        "Names of the birth terms.",
        element=str,
        most=MOST_BIRTHS,
    )
    interval_s: float = parameter(
        6.0,
        "Nominal interval, s: the one that rates, probabilities and mode matrices are given for; "
        "they are converted to the true interval.",
        1e-3,
        1e4,
    )
    max_gap_scans: float = parameter(
        15.0,
        "Longest gap between scans that is predicted over, in intervals, or in turns where they "
        "are longer; after a longer one a new run begins.",
        2.0,
        1e6,
    )
    reorder_s: float = parameter(
        0.0,
        "Longest time that detections are held back for those of other radars that are as old, s; "
        "0 for none. For radars that report whole turns and are not synchronous: their rotation_s.",
        0.0,
        1e3,
    )
    late_reports: str = parameter(
        "drop",
        "What becomes of reports of closed scans. drop: they are dropped and counted; rework: as "
        "long as smoothed estimates of their time are to come, the scans since are stepped again "
        "with them.",
        choices=("drop", "rework"),
    )
    region: list[float] = parameter(
        [],
        "What the tracker is for where several part an area: [x_min, y_min, x_max, y_max, margin] "
        "in the world frame, m. What is farther from it than the margin, the overlap with its "
        "neighbours in which tracks are handed over, is neither taken in nor reported. Empty for "
        "everything.",
        -1e6,
        1e6,
    )
    estimates_period_s: float = parameter(
        0.0,
        "Time between estimates, s: all targets are predicted to one stamp. 0: estimates with "
        "every scan, at its stamp.",
        0.0,
        1e4,
    )
    engine: str = parameter(
        "gaussian",
        "The filter. gaussian: every target is a mixture of Gaussians, one per association "
        "hypothesis and motion; particles: every target is weighted samples; phd: the PHD filter "
        "of the paper, corrected; phd_as_printed: the same as it is printed.",
        choices=ENGINES,
    )
    accuracy: str = parameter(
        "normal",
        "What accuracy may cost. fast: motions are mixed with every scan, and few particles begin "
        "at a detection; normal: a target's hypotheses go on for each motion; high: with twice the "
        "hypotheses and particles.",
        choices=ACCURACIES,
    )
    lag: str = parameter(
        "5", "Smoothing lag: a number of scans, or a time as in '20 s'.", form=forms.LAG
    )
    confirm_probability: float = parameter(
        0.0,
        "Existence probability above which a track is confirmed, and reported from then on; 0: it "
        "follows from the classes' detection probabilities. With engine phd, which has no tracks, "
        "the one above which a target is reported; 0: 0.5.",
        0.0,
        1.0,
        mutable=True,
    )
    delete_probability: float = parameter(
        0.0,
        "Existence probability below which a confirmed track is no longer reported; 0: it "
        "follows from the classes' detection probabilities, and from how often the track was "
        "missed before. Not used with engine phd.",
        0.0,
        1.0,
        mutable=True,
    )
    coasting_scans: float = parameter(
        10.0,
        "Intervals, or turns where they are longer, for which a track is reported after its last "
        "detection where no radar can see it: beyond their ranges or in blind sectors. It has its "
        "number again when it is detected later. Not used with engine phd.",
        0.0,
        1e6,
        mutable=True,
    )
    amplitude: str = parameter(
        "band",
        "Use of amplitudes. band: they tell the class by its SNR band; memory: every target's own "
        "SNR is estimated too; none: they are ignored.",
        choices=("band", "memory", "none"),
    )
    seed: int = parameter(0, "Seed of the random generator.", 0, 2**31 - 1)
    particles_per_target: int = parameter(
        0, "Particles per target after resampling; 0: by accuracy, 1500 if it is normal.", 0, 10**6
    )
    particles_per_birth: int = parameter(
        0,
        "Particles per birth term, a power of two; 0: by accuracy, 2048 if it is normal.",
        0,
        2**20,
    )
    birth_rates: list[float] = parameter(
        [],
        "Expected births anywhere in a radar's field per interval, one number per class; such "
        "targets are born at detections. Empty for none.",
        0.0,
        1e3,
        name="detection_births.rates",
    )
    birth_velocity_std: float = parameter(
        40.0,
        "Standard deviation of a newborn target's velocity about zero along each axis, m/s.",
        SMALL,
        name="detection_births.velocity_std",
    )
    birth_turn_rate_std: float = parameter(
        1e-3,
        "Standard deviation of a newborn target's turn rate about zero, rad/s.",
        SMALL,
        name="detection_births.turn_rate_std",
    )
    birth_particles: int = parameter(
        0,
        "Particles per detection, a power of two; 0: by accuracy, 1024 if it is normal.",
        0,
        2**16,
        name="detection_births.particles",
    )
    birth_least_probability: float = parameter(
        1e-4,
        "Probability of being a new target below which a detection gets no particles; a larger one "
        "lets fewer targets begin beside established ones.",
        1e-12,
        0.5,
        name="detection_births.least_probability",
    )
    equipped_probability: float = parameter(
        0.9,
        "Probability that a target has a transponder, where a radar reports codes or addresses.",
        0.001,
        0.999,
        mutable=True,
    )
    shared_codes: list[str] = parameter(
        ["0000", "1000", "2000", "7000", "7500", "7600", "7700", "7777"],
        "Codes that many targets have: four octal digits each.",
        element=str,
        mutable=True,
    )
    height_std: float = parameter(
        7.6,
        "Standard deviation of a detection's height, m; 7.6 is that of steps of 100 ft.",
        1e-3,
        1e4,
        mutable=True,
    )
    spawn_rate: float = parameter(
        0.01, "Expected spawned targets per target and interval.", 0.0, 1.0, name="spawn.rate"
    )


@dataclass(frozen=True)
class TargetClass:
    """What a class of targets has."""

    snr_band_db: list[float] = parameter(
        [10.0, 50.0], "Lowest and highest mean SNR, dB.", -100.0, 200.0, length=2
    )
    motions: list[str] = parameter(["cv", "ct"], "Motion models of the class.", element=str)
    mode_transition: list[float] = parameter(
        [0.95, 0.05, 0.1, 0.9],
        "Probabilities [motion, motion one interval later], row by row. A matrix without a rate "
        "matrix, which cannot be converted to other intervals, holds for whole ones.",
        0.0,
        1.0,
    )
    survival_probability: float = parameter(0.99, "Probability to survive an interval.", SMALL, 1.0)


@dataclass(frozen=True)
class Motion:
    """What a motion has."""

    model: str = parameter(
        "constant_velocity",
        "constant_velocity: nearly straight on; coordinated_turn: with its own turn rate.",
        choices=tuple(MOTIONS),
    )
    noise_density: float = parameter(
        1.0, "Spectral density of the white acceleration, m^2/s^3.", SMALL
    )
    turn_noise_density: float = parameter(
        1e-4,
        "Spectral density of the white turn acceleration, rad^2/s^3; coordinated_turn only.",
        1e-15,
    )


@dataclass(frozen=True)
class Birth:
    """What a birth term has."""

    position: list[float] = parameter(
        [0.0, 0.0], "Mean position of a newborn target in the world frame, x and y, m.", length=2
    )
    velocity: list[float] = parameter(
        [0.0, 0.0], "Mean velocity of a newborn target in the world frame, x and y, m/s.", length=2
    )
    position_std: float = parameter(
        200.0, "Standard deviation of a newborn target's position along each axis, m.", SMALL
    )
    velocity_std: float = parameter(
        40.0, "Standard deviation of a newborn target's velocity along each axis, m/s.", SMALL
    )
    turn_rate_std: float = parameter(
        1e-3, "Standard deviation of a newborn target's turn rate about zero, rad/s.", SMALL
    )
    rates: list[float] = parameter(
        [0.005, 0.005],
        "Expected births per interval, one number per class.",
        0.0,
        1e3,
        mutable=True,
    )


TOP = table(Tracking)
GROUPS: dict[str, tuple[Parameter, ...]] = {
    "sensors": table(Radar),
    "classes": table(TargetClass),
    "motions": table(Motion),
    "births": table(Birth),
}
# Values of the reference scenario that differ from the defaults of their group.
REFERENCE: dict[str, Value] = {
    "radar_1.position": [1000.0, 0.0],
    "class_0.snr_band_db": [30.0, 50.0],
    "class_1.snr_band_db": [10.0, 30.0],
    # With the mode matrices and the noise of turns, found on seeds from 9000 on of the reference
    # scenario and of targets that turn; config/paper_scenario.yaml has the paper's.
    "cv.noise_density": 0.2,
    "ct.model": "coordinated_turn",
    "start_1.position": [-10e3, 10e3],
    "start_2.position": [-10e3, -10e3],
    "start_3.position": [-10e3, -10.5e3],
    "start_4.position": [1.4e3, 8e3],
}


def schema(given: Mapping[str, Any]) -> dict[str, Parameter]:
    """Return all parameters for the lists of names in `given`, by dotted name.

    Faulty lists are replaced by their defaults; `resolve` reports them.
    """
    found = {parameter.name: parameter for parameter in TOP}
    for group, members in GROUPS.items():
        names = found[group].coerce(given.get(group, found[group].default))
        if names is None:
            names = found[group].default
        for name in names if isinstance(names, list) else []:
            for member in members:
                found.update(_own(str(name), member, given))
    return found


def every_name(table: Collection[str], given: Mapping[str, Any]) -> set[str]:
    """Return the names of all parameters, of those too that a mapping may have."""
    entries = [member for member in GROUPS["sensors"] if member.keys]
    listed = next(each for each in TOP if each.name == "sensors")
    names = listed.coerce(given.get("sensors", listed.default))
    return {*table} | {
        f"{name}.{member.name}.{key}"
        for name in (names if isinstance(names, list) else ())
        for member in entries
        for key in member.keys
    }


def engine_of(values: Mapping[str, Any]) -> str:
    """Return what represents targets: gaussian or particles, of which are those of a PHD filter."""
    return "gaussian" if values["engine"] == "gaussian" else "particles"


def _own(name: str, member: Parameter, given: Mapping[str, Any]) -> Iterator[tuple[str, Parameter]]:
    """Yield a parameter of one name, or the entries of a mapping that are given."""
    full = f"{name}.{member.name}"
    if not member.keys:
        yield full, replace(member, name=full, default=REFERENCE.get(full, member.default))
    for key in member.keys:
        if f"{full}.{key}" in given:
            usual = USUAL_FIELDS.get(key, "")
            yield f"{full}.{key}", Parameter(f"{full}.{key}", usual, member.description)
