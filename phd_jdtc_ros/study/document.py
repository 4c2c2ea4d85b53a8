"""Checks a study document, the content of a YAML file, as a whole and converts it to a study."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from phd_jdtc_ros.configuration import build as tracker_config
from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, Form, Parameter, flatten, number
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.simulation.checked import mapping, mappings, take
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.transponder import transponders

from .definition import FIGURES, KINDS, OWN, Case, Goal, Kind, Study, Variant, merge_layers
from .tracker import TAXIING, IgnoredTargets

# The reference scenario, which is built in.
REFERENCE = "paper_scenario"
SOURCE = Parameter(
    "scenario",
    "",
    "",
    form=Form(
        f"{REFERENCE} or a scenario file",
        lambda given: given if isinstance(given, str) else None,
    ),
    required=True,
)
LAG = Parameter("lag", 0, "", 0, 100, required=True)


def _lags(given: Any) -> tuple[int, ...] | None:
    lags = [LAG.coerce(entry) for entry in given] if isinstance(given, list) else []
    several = lags and None not in lags and len(set(lags)) == len(lags)
    return tuple(sorted(lags)) if several else None


LAGS = Parameter(
    "lags", [], "", form=Form(f"a list, none twice: {LAG.allowed}", _lags), required=True
)
BOUND = Parameter("bound", 0.0, "")
CUTOFF = Parameter("cutoff", 1000.0, "", SMALL)
ONLY_NAMED = Parameter("only_named", False, "")
IGNORED = tuple(Parameter(name, value, "", 0.0) for name, value in TAXIING._asdict().items())
SHARE = Parameter(
    "run_share", 1.0, "", form=Form("above 0 and at most 1", lambda given: number(given, SMALL, 1))
)
CASE = (
    *("scenario", "parameters", "cutoff", "only_named"),
    *("ignored", "run_share", "transponders", "lags"),
)
VARIANT = ("kind", "engine", "cases", "lags", "parameters", "run_share")
BOUNDS = ("at_most", "at_least")
GOAL = ("name", "case", "variant", "lag", "figure", *BOUNDS, "relative_to", "relative_case")

# Parameters in a scenario file by dotted name, and a function from radars to its scenario.
Scene: TypeAlias = "tuple[Mapping[str, Any], Callable[[tuple[RadarModel, ...]], Scenario]]"


def resolve(
    document: Any,
    load_scene: Callable[[str], Scene],
    assigned: Mapping[str, Any],
    kinds: Mapping[str, Kind] = KINDS,
) -> Study:
    """Check a study document and build the study.

    The document has ``lags``, ``cases``, ``variants`` and ``goals``, as in
    `config/studies/published.yaml`. `load_scene` reads a scenario file, given its name in the
    document, and the `assigned` parameters of the tracker replace all others, except that an engine
    leaves out the variants that name another. Raise `ConfigError` with all faults.
    """
    if not isinstance(document, Mapping):
        raise ConfigError("study: must be a mapping")
    faults = _reserved_faults("-p ", assigned)
    lags = take([LAGS], document, "", faults, ("cases", "variants", "goals")).get("lags")
    given = _entries(document, "cases", faults)
    checked = [_case(name, each, load_scene, assigned, faults) for name, each in given.items()]
    cases = tuple(case for case in checked if case is not None)
    turning = {case.name for case in cases if case.scenario.turning}
    shared = {name for name, each in given.items() if each.get("only_named") is not True}

    def suitable(kind: Kind | None) -> list[str]:
        return [name for name in given if kind is None or kind.turning == (name in turning)]

    variants = tuple(
        _variant(name, each, suitable, shared, lags or (), kinds, faults)
        for name, each in _entries(document, "variants", faults).items()
    )
    goals = mappings(document, "goals", "", faults)
    names = [variant.name for variant in variants]
    study = Study(
        cases,
        variants,
        tuple(_goal(each, index, given, names, faults) for index, each in enumerate(goals)),
        dict(assigned),
        left_out=_left_out(variants, assigned),
    )
    faults += [
        f"cases.{case.name}.lags: {list(case.lags or ())} given, {variant.name} has none of them"
        for case in cases
        for variant in variants
        if case.name in variant.cases and variant.lags and not case.lags_of(variant)
    ]
    faults += [
        f"variants.{name}.parameters.{fault}"
        for name, found in _tracker_faults(study)
        for fault in found
    ]
    if faults:
        raise ConfigError(*dict.fromkeys(faults))
    return study


def _entries(
    document: Mapping[str, Any], key: str, faults: list[str]
) -> dict[str, Mapping[str, Any]]:
    """Return the named mappings under a key; add faults to `faults`, as all functions here."""
    value = document.get(key)
    if not isinstance(value, Mapping) or not value:
        faults.append(f"{key}: must be a mapping of at least one name")
        return {}
    named = {name for name in value if isinstance(name, str) and isinstance(value[name], Mapping)}
    faults += [
        f"{key}.{name}: must be a mapping with a string for a name"
        for name in value
        if name not in named
    ]
    return {name: given for name, given in value.items() if name in named}


def _parameters(given: Mapping[str, Any], prefix: str, faults: list[str]) -> dict[str, Any]:
    """Return the parameters of the tracker by dotted name."""
    parameters = dict(flatten(mapping(given, "parameters", faults, prefix)))
    faults += _reserved_faults(f"{prefix}parameters.", parameters)
    return parameters


def _case(
    name: str,
    given: Mapping[str, Any],
    load_scene: Callable[[str], Scene],
    assigned: Mapping[str, Any],
    faults: list[str],
) -> Case | None:
    """Return a case; None if it has no scenario that can be built."""
    prefix = f"cases.{name}."
    optional = [each for each in (CUTOFF, LAGS) if each.name in given]
    values = take([SOURCE, ONLY_NAMED, SHARE, *optional], given, prefix, faults, CASE)
    left_out = mapping(given, "ignored", faults, prefix)
    ignored = IgnoredTargets(**take(IGNORED, left_out, f"{prefix}ignored.", faults))
    reply_faults: list[str] = []
    replies = transponders(given, reply_faults)
    faults += [f"{prefix}{fault}" for fault in reply_faults]
    of_case = _parameters(given, prefix, faults)
    source = values.get("scenario")
    if source is None:
        return None
    try:
        in_file, build = load_scene(source)
        parameters = merge_layers(in_file, of_case, assigned)
        model = tracker_config.resolve(parameters).model
        scenario, classes = build(polar_radars(model.radars)), len(model.modes.classes)
        if replies is not None:
            scenario = replace(scenario, transponders=replies)
        highest = max((target.class_id for target in scenario.targets), default=0)
        if highest >= classes:
            raise ConfigError(f"class {highest} of a target, must be below {classes}")
        settings = {key: values[key] for key in ("run_share", *(each.name for each in optional))}
        return Case(name, scenario, parameters, classes, ignored=ignored, **settings)
    except ConfigError as error:
        for fault in error.faults:
            name = fault.split(":")[0]
            faults.append(
                f"-p {fault}"
                if name in assigned
                else f"{prefix}parameters.{fault}"
                if name in of_case
                else f"{prefix}scenario: {fault}"
            )
        return None


def _variant(
    name: str,
    given: Mapping[str, Any],
    suitable: Callable[[Kind | None], list[str]],
    shared: Collection[str],
    lags: tuple[int, ...],
    kinds: Mapping[str, Kind],
    faults: list[str],
) -> Variant:
    """Return a variant.

    `suitable` returns the cases that suit a kind. Its default cases are those of them in `shared`.
    """
    prefix = f"variants.{name}."
    engines = [kind.name for kind in kinds.values() if kind.is_engine]
    wanted = [SHARE, *([LAGS] if "lags" in given else [])]
    if "engine" in given:
        wanted.append(_choice("engine", engines))
    if "kind" in given or "engine" not in given:
        wanted.append(_choice("kind", kinds))
    values = take(wanted, given, prefix, faults, VARIANT)
    engine = values.get("engine")
    kind = kinds.get(str(values.get("kind", engine)))
    parameters = _parameters(given, prefix, faults)
    for key, allowed in (
        ("engine", [each.name for each in kinds.values() if each.ours]),
        ("parameters", [each.name for each in kinds.values() if each.tuned]),
    ):
        if key in given and (kind is None or kind.name not in allowed):
            faults.append(f"{prefix}{key}: only for kind {' or '.join(allowed)}")
    if kind is not None and kind.is_engine:
        parameters = {"engine": engine or kind.name, **parameters}
        # A wrong engine is found later as a fault of the parameters.
        kind = kinds.get(str(parameters["engine"]), kind)
    elif engine:
        parameters = {"engine": engine, **parameters}
    cases = suitable(kind)
    chosen = given.get("cases", [case for case in cases if case in shared])
    if not isinstance(chosen, list) or not chosen or not set(map(str, chosen)) <= set(cases):
        faults.append(f"{prefix}cases: {chosen!r} given, must be a list of {', '.join(cases)}")
        chosen = []
    return Variant(
        name=name,
        kind=kind or next(iter(kinds.values())),
        parameters=parameters,
        cases=tuple(chosen),
        lags=values.get("lags", lags) or (),
        run_share=values["run_share"],
    )


def _goal(
    given: Mapping[str, Any],
    index: int,
    cases: Iterable[str],
    variants: Iterable[str],
    faults: list[str],
) -> Goal:
    """Return a goal of a study file; its faults are appended."""
    prefix = f"goals[{index}]."
    words = {"case": cases, "variant": variants, "figure": FIGURES}
    if given.get("relative_to") is not None:
        words["relative_to"] = variants
    if "relative_case" in given:
        words["relative_case"] = cases
    wanted = [LAG, *(_choice(key, allowed) for key, allowed in words.items())]
    values = take(wanted, given, prefix, faults, GOAL)
    bounds = [key for key in BOUNDS if key in given]
    if len(bounds) != 1 or BOUND.coerce(given[bounds[0]]) is None:
        faults.append(
            f"{prefix}at_most: exactly one of at_most and at_least must be given, a number"
        )
    defaults = {"relative_to": None, "relative_case": values.get("case")}
    return Goal(
        name=str(given.get("name", prefix)),
        bound=given[bounds[0]] if bounds else math.nan,
        at_most=bounds == ["at_most"],
        **{**dict.fromkeys(("lag", *words)), **defaults, **values},
    )


def _choice(key: str, allowed: Iterable[str]) -> Parameter:
    """Return a required parameter whose value is one of these words."""
    return Parameter(key, "", "", choices=tuple(allowed), required=True)


def _left_out(variants: Iterable[Variant], assigned: Mapping[str, Any]) -> dict[str, str]:
    """Return the variants that name an engine other than the assigned one, with the reasons."""
    engine = assigned.get("engine")
    named = {variant.name: variant.parameters.get("engine", engine) for variant in variants}
    return {
        name: f"engine: {own} given, must be {engine} with engine {engine}"
        for name, own in named.items()
        if engine is not None and own != engine
    }


def _tracker_faults(study: Study) -> Iterator[tuple[str, list[str]]]:
    """Yield the variants with invalid tracker parameters at any of their cases, and the faults.

    Variants that are left out are not checked, because what is assigned beside the engine may be
    wrong for theirs.
    """
    for variant in study.variants:
        if variant.name in study.left_out:
            continue
        faults: list[str] = []
        for case in study.cases:
            if variant.kind.tuned and case.name in variant.cases and variant.parameters:
                given = study.parameters(case, variant)
                try:
                    tracker_config.resolve(given)
                except ConfigError as error:
                    faults += error.faults
        if faults:
            yield variant.name, list(dict.fromkeys(faults))


def _reserved_faults(prefix: str, parameters: Mapping[str, Any]) -> list[str]:
    """Return a fault for each of these tracker parameters that the study itself sets."""
    return [f"{prefix}{name}: is set by the study itself" for name in OWN if name in parameters]
