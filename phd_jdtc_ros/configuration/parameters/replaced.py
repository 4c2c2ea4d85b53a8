"""Former parameters, and former notations of values, each with its replacement.

A former name is refused with the words of these tables, and a value in a former notation with the
lines that the functions below return; ``docs/upgrade.md`` is written from both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

CONSTANT = "it is a constant now, {}"
DERIVED = "it follows from the others"
REMAPPED = "remap the topic, as with -r BEFORE:=NOW"
ACCURACY = "use accuracy: fast, normal or high"
OUTPUTS = "use outputs, a list with {} in it"
REGION = "use region, the margin as its fifth number"
BIASES = "use biases: [range (m), range gain (m/m), azimuth (degrees), time (s)]"
STD = "use std: [position (m), velocity (m/s), turn rate (rad/s)]"
EXISTENCE = "use existence: [confirm above, delete below]"
COASTING = "use coasting: [time (intervals), spread (gates)]"
PARTICLES = "use particles: [per target, per birth term]"
BIRTH_STD = (
    "use detection_births.std: [velocity (m/s), turn rate (rad/s), climb rate (m/s)], or its "
    "first numbers"
)
STEP = "use {}, with the squared step divided by 12 added to its square"
SOURCE = "use output_source: [SAC, SIC, service]"
RECORDED = "use record_topics and record_types"

TRACKER: Mapping[str, str] = {
    "radars": "use sensors",
    **dict.fromkeys(
        ("existence_threshold", "confirm_probability", "delete_probability"), EXISTENCE
    ),
    **dict.fromkeys(("coasting_scans", "coasting_gates"), COASTING),
    **dict.fromkeys(("particles_per_target", "particles_per_birth"), PARTICLES),
    **dict.fromkeys(
        (f"detection_births.{of}_std" for of in ("velocity", "turn_rate", "climb")), BIRTH_STD
    ),
    "fixed_interval": "a matrix without a rate matrix applies to whole intervals",
    "reorder_scans": "use reorder_s, or late_reports: rework",
    "region_margin": REGION,
    "detection_births.particles": "targets born at detections are Gaussians",
    **dict.fromkeys(
        ("corrector", "death_term", "extraction"),
        "use engine: phd, phd_as_printed or phd_gaussian",
    ),
    **dict.fromkeys(
        ("hypotheses_per_target", "least_hypothesis", "merge_distance", "least_mode"), ACCURACY
    ),
    "max_hypotheses": CONSTANT.format("50000"),
    "least_particles": DERIVED,
    "max_particles": CONSTANT.format("200000"),
    "amplitude_jitter": CONSTANT.format("0.1 per interval"),
    "reply_probability": CONSTANT.format("0.95"),
    "code_garbled": CONSTANT.format("0.01"),
    "shared_code_probability": CONSTANT.format("0.2"),
    "code_kept_s": CONSTANT.format("1800 s"),
    "clutter_reply_probability": CONSTANT.format("0.05"),
    "height_noise_density": CONSTANT.format("1 m^2/s^3"),
    "height_climb_std": CONSTANT.format("10 m/s"),
    "height_garbled": CONSTANT.format("0.01"),
    "height_evidence": CONSTANT.format("1"),
    "height_std": CONSTANT.format("7.6 m"),
    "spawn.position_std": CONSTANT.format("10 m"),
    "spawn.velocity_std": CONSTANT.format("1 m/s"),
    "spawn.turn_rate_std": CONSTANT.format("0.0001 rad/s"),
    "spawn.particles_per_target": CONSTANT.format("100"),
    "spawn.class_transition": DERIVED,
    "spawn.mode_transition": DERIVED,
}
# Parameters of each name in `sensors`.
RADAR: Mapping[str, str] = {
    "range_std_growth": "use range_std at the mean range, or fields.range_std",
    "pose_max_speed": CONSTANT.format("100 m/s"),
    "range_step": STEP.format("range_std"),
    "azimuth_step_deg": STEP.format("azimuth_std_deg"),
    "detection_probability_over_range": "use detection_probability and detection_probability_range",
    **dict.fromkeys(("clutter_level_db", "clutter_std_db"), "use clutter_amplitude: learned"),
    **{
        f"{name}_unit": f"use units.{name}"
        for name in ("azimuth", "elevation", "amplitude", "time")
    },
    "azimuth_convention": "use units.azimuth_convention",
    "time_reference": "use units.time_reference",
    "report_interval_s": "it is that of AIS with identity: mmsi, and otherwise 1 s",
    **dict.fromkeys(("lost", "off_prior"), "it is learned from the reports"),
    "fields.kind": "use fields.detection_type",
    "range_rate_span": CONSTANT.format("200 m/s"),
    "height": "use position, the height as its third number",
    **dict.fromkeys(("range_bias", "range_gain", "azimuth_bias_deg", "time_offset_s"), BIASES),
}
# Parameters of each name in `births`.
BIRTH: Mapping[str, str] = dict.fromkeys(("position_std", "velocity_std", "turn_rate_std"), STD)
NODE: Mapping[str, str] = {
    **{
        f"publish_{name}": OUTPUTS.format("paths" if name == "path" else name)
        for name in (
            *("detections", "frames", "markers", "path", "odometry", "radar_tracks"),
            *("detections_3d", "navsat", "geojson"),
        )
    },
    "publish_plots": OUTPUTS.format("curves"),
    "registration_monitor": OUTPUTS.format("registration"),
    "checkpoint.max_age_s": CONSTANT.format("60 s"),
    "path_length": CONSTANT.format("100"),
    "silent_after_scans": CONSTANT.format("2"),
    "step_time_limit": CONSTANT.format("1"),
}
EVALUATOR: Mapping[str, str] = {
    "truth_topic": REMAPPED,
    "class_names": "use classes, a list of their names",
    "publish_plots": "they are always published",
    "radar_topics": "use record_topics",
    "pose_topics": RECORDED,
    "pose_message": RECORDED,
    "world_frame": "it is the frame of the first cloud",
    "order": CONSTANT.format("2"),
    "least_speed": "it is the tracker's clutter_map_speed, for which it is asked",
}
REPLAY: Mapping[str, str] = {
    "progress": "a terminal always has a progress line",
    "estimates_topic": REMAPPED,
    "seek_s": "set start_s",
    "truth_timeout_s": "use subscriber_timeout_s, a fifth of which is the wait for the truth",
}
OF_PLOTS: Mapping[str, str] = {
    "amplitude": "it is that of the echo (PAM), or else that of the replies (SAM)",
    "amplitude_offset_db": "use the tracker's amplitude_offset_db, with the value minus 100",
    "rotation_s": "the radar reports it, or it is estimated",
}
BRIDGE: Mapping[str, str] = {
    **OF_PLOTS,
    "estimates_topic": REMAPPED,
    "max_prediction_s": CONSTANT.format("10 s"),
    **dict.fromkeys(("output_sac", "output_sic", "output_service"), SOURCE),
}
BRIDGE_RADAR: Mapping[str, str] = {
    **dict.fromkeys(("sac", "sic"), "use source: [SAC, SIC]"),
    **OF_PLOTS,
}
HAND_OVER: Mapping[str, str] = {
    "hysteresis": "it is a fifth of the smallest margin",
    "smoothed_wait_s": CONSTANT.format("8 s"),
    "world_frame": "it is the frame of the first estimates",
}
HAND_OVER_TRACKER: Mapping[str, str] = {
    "region_margin": REGION,
    "node": "remap its topics, as with -r /NAME/tracker/filtered/estimates:=NOW",
}


# Words that stood in values, and their words in `learn`; that of `auto` is the parameter's own.
_LEARNED = {"outliers": "outliers", "multipath": "multipath", "correlated": "correlation"}
_AUTO = "auto"


def learned_by(word: str) -> Callable[[str, Any], list[str]]:
    """Return the function for a number before or after words, which `word` of `learn` replaces.

    It returns the lines for a value as ``auto 45 outliers``.
    """

    def lines(name: str, value: Any) -> list[str]:
        found = _words(value, word)
        if found is None or len(found[0]) > 1:
            return []
        return [f"{name}: {number}" for number in found[0]] + _learn(found[1])

    return lines


def detection_probability(name: str, value: Any) -> list[str]:
    """Return the lines for pairs of range and probability, and for words around them."""
    text = value if isinstance(value, str) else " ".join(map(str, np.ravel(value)))
    head, correlated, after = text.partition("correlated")
    found = _words(head, "detection") if head.strip() else ([], [])
    correlation = _numbers(after.split())
    if found is None or correlation is None or len(correlation) > 1:
        return []
    numbers, learned = found
    probabilities = numbers[1::2] or numbers
    odd = len(numbers) > 1 and len(numbers) % 2
    if odd or not all(0.0 <= probability < 1.0 for probability in probabilities):
        return []
    lines = [f"{name}: {number}" for number in numbers] if len(numbers) == 1 else []
    if len(numbers) > 1:
        lines = [f"{name}: {probabilities}", f"{name}_range: {numbers[::2]}"]
    lines += [f"detection_correlation: {number}" for number in correlation]
    learns_correlation = correlated and not correlation
    return lines + _learn([*learned, *[_LEARNED["correlated"]] * bool(learns_correlation)])


def rotation(name: str, value: Any) -> list[str]:
    """Return the line for a rotation period that is learned."""
    return [f"{name}: 0.0"] if value == _AUTO else []


def engine(name: str, value: Any) -> list[str]:
    """Return the line for the labelled filter of particles, which is gone."""
    return [f"{name}: gaussian"] if value == "particles" else []


def lag(name: str, value: Any) -> list[str]:
    """Return the line for a lag that is a text, of scans or of seconds."""
    number, *unit = value.split() if isinstance(value, str) and value.split() else [""]
    found = _numbers([number.removesuffix("s")])
    if not found or unit not in ([], ["s"]):
        return []
    scans = not unit and not number.endswith("s")
    if scans and not found[0].is_integer():
        return []
    return [f"{name}: {found[0]:g}" if scans else f"{name}_s: {found[0]}"]


def pose(name: str, value: Any) -> list[str]:
    """Return the lines for a topic with words after it."""
    topic, *words = value.split() if isinstance(value, str) and value.split() else [""]
    uses = {"odometry": [], "pose_stamped": ["pose_message: pose_stamped"]}
    uses["stabilised"] = ["pose_yaw: false"]
    if not words or not set(words) <= set(uses):
        return []
    return [f"{name}: {topic}", *(line for word in words for line in uses[word])]


def clutter_amplitude(name: str, value: Any) -> list[str]:
    """Return the line for a law with a level, and for a law that is no longer one."""
    law = value.split()[:1] if isinstance(value, str) else []
    return [f"{name}: learned"] if law in (["rayleigh"], ["log_normal"]) else []


def outputs(name: str, value: Any) -> list[str]:
    """Return the line for a list with the former word for curves."""
    words = value if isinstance(value, (list, tuple)) else ()
    if "plots" not in words or not all(isinstance(word, str) for word in words):
        return []
    return [f"{name}: [{', '.join('curves' if word == 'plots' else word for word in words)}]"]


def record_topics(name: str, value: Any) -> list[str]:
    """Return the lines for topics with the messages after them."""
    listed = value if isinstance(value, (list, tuple)) else ()
    entries = [each.split() for each in listed if isinstance(each, str)]
    if not all(entries) or all(len(each) == 1 for each in entries):
        return []
    topics, types = ([f"{each[k]}" for each in entries] for k in (0, -1))
    kinds = ["cloud" if kind == topic else kind for topic, kind in zip(topics, types, strict=True)]
    return [f"{name}: [{', '.join(topics)}]", f"record_types: [{', '.join(kinds)}]"]


def _words(value: Any, learned: str) -> tuple[list[float], list[str]] | None:
    """Return the numbers of a text, and what its words stand for in `learn`; None for no such text.

    `learned` is what `auto` stands for.
    """
    names = {_AUTO: learned, **_LEARNED}
    words = value.split() if isinstance(value, str) else []
    found = _numbers([word for word in words if word not in names])
    if not words or found is None:
        return None
    return found, [names[word] for word in words if word in names]


def _numbers(words: Sequence[Any]) -> list[float] | None:
    """Return words as finite numbers; None if one is none."""
    try:
        found = [float(word) for word in words]
    except (TypeError, ValueError):
        return None
    return found if np.isfinite(found).all() else None


def _learn(words: Sequence[str]) -> list[str]:
    return [f"learn: [{', '.join(words)}]"] if words else []


Lines: TypeAlias = Callable[[str, Any], list[str]]
# Values in former notations, by part and parameter, for the page.
NOTATIONS: Mapping[str, tuple[tuple[str, Lines, tuple[Any, ...]], ...]] = {
    "tracker": (("engine", engine, ("particles",)), ("lag", lag, ("5", "20 s"))),
    "tracker, of each sensor": (
        ("range_std", learned_by("noise"), ("auto", "auto 45", "45 outliers", "auto 45 outliers")),
        ("azimuth_std_deg", learned_by("noise"), ("auto 0.08",)),
        ("range_rate_std", learned_by("noise"), ("auto 0.15",)),
        (
            "detection_probability",
            detection_probability,
            (
                "auto",
                "auto 0.9",
                [0.0, 0.95, 5e4, 0.92],
                "auto 0 0.95 50000 0.92",
                "0.8 correlated",
                "0.8 correlated 0.5",
                "auto 0.8 correlated",
            ),
        ),
        ("clutter_rate", learned_by("clutter"), ("auto", "8 multipath", "auto multipath")),
        ("clutter_amplitude", clutter_amplitude, ("rayleigh 10", "log_normal 20")),
        ("rotation_s", rotation, ("auto",)),
        ("pose", pose, ("/ship/pose pose_stamped", "/ship/odometry stabilised", "tf stabilised")),
    ),
    "tracker, as a node": (("outputs", outputs, (["markers", "plots"],)),),
    "evaluator": (("record_topics", record_topics, (["/mast/plots", "/ship/odometry odometry"],)),),
}
