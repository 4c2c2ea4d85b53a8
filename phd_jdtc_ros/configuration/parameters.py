"""The table of parameters: names, defaults, units and bounds.

Parameters are flat dotted names with plain values, as in ROS. Four lists name the parts (`radars`,
`classes`, `motions`, `births`), and every name in them has its own parameters, such as
``radar_1.range_std``. The defaults are the reference scenario. Units are SI unless a suffix names
another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from phd_jdtc_ros.core.smc.correction import CORRECTORS
from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS
from phd_jdtc_ros.core.targets.motion import MOTIONS

from .radar_parameters import RADAR
from .schema import SMALL, Parameter, Value

# Every class has rates of its own, found by a matrix logarithm, and every name has parameters: with
# many of them a start would take longer than anybody waits to hear what is wrong.
MOST_RADARS, MOST_CLASSES, MOST_MOTIONS, MOST_BIRTHS = 100, 50, 50, 1000

TOP = (
    Parameter("world_frame", "map", "Frame of the estimates (ENU, metres)."),
    Parameter(
        "world_origin",
        [],
        "Latitude and longitude, degrees (WGS84), of the world frame's zero, and the height, m, of "
        "its z = 0; x and y are then in the stereographic plane about it. Empty: the world is a "
        "plane anywhere.",
        -1e4,
        1e4,
    ),
    Parameter(
        "radars",
        ["radar_1", "radar_2"],
        "Names of the radars, in the order of updates.",
        element=str,
        most=MOST_RADARS,
    ),
    Parameter(
        "classes",
        ["class_0", "class_1"],
        "Names of the target classes.",
        element=str,
        most=MOST_CLASSES,
    ),
    Parameter(
        "motions",
        ["cv", "ct"],
        "Names of the motion models.",
        element=str,
        most=MOST_MOTIONS,
    ),
    Parameter(
        "births",
        ["start_1", "start_2", "start_3", "start_4"],
        "Names of the birth terms.",
        element=str,
        most=MOST_BIRTHS,
    ),
    Parameter(
        "interval_s",
        6.0,
        "Nominal interval, s: the one that rates, probabilities and mode matrices are given for; "
        "they are converted to the true interval.",
        1e-3,
        1e4,
    ),
    Parameter(
        "fixed_interval",
        False,
        "Convert mode matrices in whole nominal intervals only, so that they need no rate matrix.",
    ),
    Parameter(
        "max_gap_scans",
        15.0,
        "Longest gap between scans that is predicted over, in intervals, or in turns where they "
        "are longer; after a longer one a new run begins.",
        2.0,
        1e6,
    ),
    Parameter(
        "reorder_scans",
        0,
        "Number of scans held back to put stamps in order that arrive out of order; estimates come "
        "this many scans later.",
        0,
        2,
    ),
    Parameter(
        "reorder_s",
        0.0,
        "Longest time that detections are held back for those of other radars that are as old, s; "
        "0 for none. For radars that report whole turns and are not synchronous: their rotation_s.",
        0.0,
        1e3,
    ),
    Parameter(
        "late_reports",
        "drop",
        "What becomes of reports of closed scans. drop: they are dropped and counted; rework: as "
        "long as smoothed estimates of their time are to come, the scans since are stepped again "
        "with them.",
        choices=("drop", "rework"),
    ),
    Parameter(
        "region",
        [],
        "What the tracker is for where several part an area: [x_min, y_min, x_max, y_max] in the "
        "world frame, m. What is farther from it than region_margin is neither taken in nor "
        "reported. Empty for everything.",
        -1e6,
        1e6,
    ),
    Parameter(
        "region_margin",
        0.0,
        "How far a tracker's region extends beyond region on each side, m: the overlap with its "
        "neighbours, in which tracks are handed over.",
        0.0,
        1e6,
    ),
    Parameter(
        "estimates_period_s",
        0.0,
        "Time between estimates, s: all targets are predicted to one stamp. 0: estimates with "
        "every scan, at its stamp.",
        0.0,
        1e4,
    ),
    Parameter(
        "engine",
        "particles",
        "What represents a target. particles: weighted samples; gaussian: a mixture of Gaussians, "
        "one per association hypothesis and motion.",
        choices=("particles", "gaussian"),
    ),
    Parameter(
        "hypotheses_per_target",
        8,
        "Largest number of association hypotheses of a target, with engine gaussian; each may go "
        "on once for each motion, see least_mode.",
        1,
        1000,
    ),
    Parameter(
        "least_hypothesis",
        1e-4,
        "Probability, given that the target exists, below which one of its hypotheses is dropped; "
        "with engine gaussian.",
        0.0,
        0.5,
    ),
    Parameter(
        "merge_distance",
        4.0,
        "Square Mahalanobis distance within which a target's hypotheses are merged, with engine "
        "gaussian.",
        0.0,
        100.0,
    ),
    Parameter(
        "least_mode",
        0.05,
        "Probability, given one of a target's hypotheses, below which one of its motions does not "
        "go on as a hypothesis of its own; 1: none does, and motions are mixed with every scan, "
        "which is faster and less accurate. With engine gaussian.",
        0.0,
        1.0,
    ),
    Parameter(
        "max_hypotheses",
        50_000,
        "Largest number of hypotheses of all targets; beyond it the least probable targets are "
        "dropped. With engine gaussian.",
        100,
        10**7,
    ),
    Parameter("lag", 5, "Smoothing lag, scans.", 0, 100),
    Parameter("lag_s", 0.0, "Smoothing lag, s; above 0 it replaces lag.", 0.0, 1e5),
    Parameter(
        "corrector",
        "bernoulli",
        "How detections correct the intensity. bernoulli: every origin is at most one target, and "
        "its label; poisson: the Poisson process of the PHD filter, as in the paper.",
        choices=tuple(CORRECTORS),
    ),
    Parameter(
        "death_term",
        "bernoulli",
        "Backward death term. bernoulli: every component is at most one target; paper: as printed.",
        choices=tuple(DEATH_TERMS),
    ),
    Parameter(
        "extraction",
        "components",
        "How targets are extracted. components: one per component; clusters: by clustering, as in "
        "the paper.",
        choices=tuple(EXTRACTIONS),
    ),
    Parameter(
        "confirm_probability",
        0.0,
        "Existence probability above which a track is confirmed, and reported from then on; 0: it "
        "follows from the classes' detection probabilities. With corrector poisson, which has no "
        "tracks, the one above which a target is reported; 0: 0.5.",
        0.0,
        1.0,
        mutable=True,
    ),
    Parameter(
        "delete_probability",
        0.0,
        "Existence probability below which a confirmed track is no longer reported; 0: it "
        "follows from the classes' detection probabilities, and from how often the track was "
        "missed before. Not used with corrector poisson.",
        0.0,
        1.0,
        mutable=True,
    ),
    Parameter(
        "coasting_scans",
        10.0,
        "Intervals, or turns where they are longer, for which a track is reported after its last "
        "detection where no radar can see it: beyond their ranges or in blind sectors. It has its "
        "number again when it is detected later. Not used with corrector poisson.",
        0.0,
        1e6,
        mutable=True,
    ),
    Parameter(
        "amplitude",
        "band",
        "Use of amplitudes. band: they tell the class by its SNR band; memory: every target's own "
        "SNR is estimated too; none: they are ignored.",
        choices=("band", "memory", "none"),
    ),
    Parameter(
        "amplitude_jitter", 0.1, "Random step of ln(1 + SNR) per interval, with memory.", 0.0, 10.0
    ),
    Parameter("seed", 0, "Seed of the random generator.", 0, 2**31 - 1),
    Parameter("particles_per_target", 1500, "Particles per target after resampling.", 10, 10**6),
    Parameter("least_particles", 200, "Least number of particles per origin and class.", 1, 10**5),
    Parameter("particles_per_birth", 2048, "Particles per birth term; a power of two.", 2, 2**20),
    Parameter(
        "max_particles",
        200_000,
        "Largest total number of particles; if it would be exceeded, every origin gets fewer.",
        1000,
        10**8,
    ),
    Parameter(
        "detection_births.rates",
        [],
        "Expected births anywhere in a radar's field per interval, one number per class; such "
        "targets are born at detections. Empty for none.",
        0.0,
        1e3,
    ),
    Parameter(
        "detection_births.velocity_std",
        40.0,
        "Standard deviation of a newborn target's velocity about zero along each axis, m/s.",
        SMALL,
    ),
    Parameter(
        "detection_births.turn_rate_std",
        1e-3,
        "Standard deviation of a newborn target's turn rate about zero, rad/s.",
        SMALL,
    ),
    Parameter(
        "detection_births.particles", 1024, "Particles per detection; a power of two.", 2, 2**16
    ),
    Parameter(
        "detection_births.least_probability",
        1e-4,
        "Probability of being a new target below which a detection gets no particles; a larger one "
        "lets fewer targets begin beside established ones.",
        1e-12,
        0.5,
    ),
    Parameter(
        "equipped_probability",
        0.9,
        "Probability that a target has a transponder, where a radar reports codes or addresses.",
        0.001,
        0.999,
        mutable=True,
    ),
    Parameter(
        "reply_probability",
        0.95,
        "Probability that a detection of such a target has an answer.",
        0.01,
        0.999,
        mutable=True,
    ),
    Parameter(
        "code_garbled",
        0.01,
        "Probability that a code or an address is garbled and may be any.",
        1e-6,
        0.5,
        mutable=True,
    ),
    Parameter(
        "shared_codes",
        ["0000", "1000", "2000", "7000", "7500", "7600", "7700", "7777"],
        "Codes that many targets have: four octal digits each.",
        element=str,
        mutable=True,
    ),
    Parameter(
        "shared_code_probability",
        0.2,
        "Probability that a target has one of the shared codes.",
        0.0,
        0.99,
        mutable=True,
    ),
    Parameter(
        "code_kept_s",
        1800.0,
        "Mean time until a target gets another code, s. An aircraft that comes back within it, by "
        "its address, has its track number again.",
        1.0,
        1e9,
        mutable=True,
    ),
    Parameter(
        "clutter_reply_probability",
        0.05,
        "Probability that a false detection has a code or an address.",
        0.001,
        0.999,
        mutable=True,
    ),
    Parameter(
        "height_std",
        7.6,
        "Standard deviation of a detection's height, m; 7.6 is that of steps of 100 ft.",
        1e-3,
        1e4,
        mutable=True,
    ),
    Parameter(
        "height_noise_density",
        1.0,
        "Spectral density of the white vertical acceleration, m^2/s^3.",
        SMALL,
        1e6,
        mutable=True,
    ),
    Parameter(
        "height_climb_std",
        10.0,
        "Standard deviation of a new target's climb rate about zero, m/s.",
        SMALL,
        1e3,
        mutable=True,
    ),
    Parameter(
        "height_garbled",
        0.01,
        "Probability that a height is garbled and may be any.",
        1e-6,
        0.5,
        mutable=True,
    ),
    Parameter(
        "height_evidence",
        1.0,
        "What heights count in the association, as the exponent of their likelihood: 1 as they "
        "are, 0 not at all.",
        0.0,
        1.0,
        mutable=True,
    ),
    Parameter("spawn.rate", 0.01, "Expected spawned targets per target and interval.", 0.0, 1.0),
    Parameter(
        "spawn.position_std",
        10.0,
        "Standard deviation of a spawned position about its parent's along each axis, m.",
        SMALL,
    ),
    Parameter(
        "spawn.velocity_std",
        1.0,
        "Standard deviation of a spawned velocity about its parent's along each axis, m/s.",
        SMALL,
    ),
    Parameter(
        "spawn.turn_rate_std",
        1e-4,
        "Standard deviation of a spawned turn rate about its parent's, rad/s.",
        SMALL,
    ),
    Parameter(
        "spawn.particles_per_target",
        100,
        "Particles for the targets that one target spawns.",
        1,
        10**5,
    ),
    Parameter(
        "spawn.class_transition",
        [0.5, 0.5, 0.5, 0.5],
        "Probabilities [class of the parent, class of the spawned target], row by row; empty for "
        "uniform.",
        0.0,
        1.0,
    ),
    Parameter(
        "spawn.mode_transition",
        [0.9, 0.1, 0.1, 0.9],
        "Probabilities [motion of the parent, motion of the spawned target], row by row; empty for "
        "uniform.",
        0.0,
        1.0,
    ),
)
CLASS = (
    Parameter(
        "snr_band_db", [10.0, 50.0], "Lowest and highest mean SNR, dB.", -100.0, 200.0, length=2
    ),
    Parameter("motions", ["cv", "ct"], "Motion models of the class.", element=str),
    Parameter(
        "mode_transition",
        [0.95, 0.05, 0.1, 0.9],
        "Probabilities [motion, motion one interval later], row by row.",
        0.0,
        1.0,
    ),
    Parameter("survival_probability", 0.99, "Probability to survive an interval.", SMALL, 1.0),
)
MOTION = (
    Parameter(
        "model",
        "constant_velocity",
        "constant_velocity: nearly straight on; coordinated_turn: with its own turn rate.",
        choices=tuple(MOTIONS),
    ),
    Parameter("noise_density", 1.0, "Spectral density of the white acceleration, m^2/s^3.", SMALL),
    Parameter(
        "turn_noise_density",
        1e-4,
        "Spectral density of the white turn acceleration, rad^2/s^3; coordinated_turn only.",
        1e-15,
    ),
)
BIRTH = (
    Parameter(
        "position",
        [0.0, 0.0],
        "Mean position of a newborn target in the world frame, x and y, m.",
        length=2,
    ),
    Parameter(
        "velocity",
        [0.0, 0.0],
        "Mean velocity of a newborn target in the world frame, x and y, m/s.",
        length=2,
    ),
    Parameter(
        "position_std",
        200.0,
        "Standard deviation of a newborn target's position along each axis, m.",
        SMALL,
    ),
    Parameter(
        "velocity_std",
        40.0,
        "Standard deviation of a newborn target's velocity along each axis, m/s.",
        SMALL,
    ),
    Parameter(
        "turn_rate_std",
        1e-3,
        "Standard deviation of a newborn target's turn rate about zero, rad/s.",
        SMALL,
    ),
    Parameter(
        "rates",
        [0.005, 0.005],
        "Expected births per interval, one number per class.",
        0.0,
        1e3,
        mutable=True,
    ),
)
# Parameters of earlier versions, and those that have taken their place.
REPLACED = {"existence_threshold": "confirm_probability and delete_probability"}
GROUPS: dict[str, tuple[Parameter, ...]] = {
    "radars": RADAR,
    "classes": CLASS,
    "motions": MOTION,
    "births": BIRTH,
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
    table = {parameter.name: parameter for parameter in TOP}
    for group, members in GROUPS.items():
        names = table[group].coerce(given.get(group, table[group].default))
        if names is None:
            names = table[group].default
        for name in names if isinstance(names, list) else []:
            for member in members:
                full = f"{name}.{member.name}"
                default = REFERENCE.get(full, member.default)
                table[full] = replace(member, name=full, default=default)
    return table
