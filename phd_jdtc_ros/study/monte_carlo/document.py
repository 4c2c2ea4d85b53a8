"""Checks a study document, the content of a YAML file, as a whole and converts it to a study."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from phd_jdtc_ros.configuration import build as tracker_config
from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, Parameter, flatten
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario
from phd_jdtc_ros.simulation.transponder import transponders

from ..runs import TAXIING, Ignored
from ..tracker import Reading
from .definition import FIGURES, OWN, Case, Goal, Study, Variant, merged
from .kinds import KINDS, OURS, TRACKERS, TUNED, suits

BUILT_IN_SCENARIO = "paper_scenario"
# Parameters of an extraction variant.
OF_READING = ("death_term", "extraction")
# The choices of the labelled filter, and the ones that Gaussians do not support.
LABELLED_READING = {"engine": "gaussian", "death_term": "bernoulli", "extraction": "components"}
OTHER_READING = {"death_term": "paper", "extraction": "clusters"}
LAG = Parameter("lag", 0, "", 0, 100)
BOUND = Parameter("bound", 0.0, "")
CUTOFF = Parameter("cutoff", 1000.0, "", SMALL)
IGNORED = (
    Parameter("below", TAXIING.below, "", 0.0),
    Parameter("near", TAXIING.near, "", 0.0),
)
SHARE = Parameter("run_share", 1.0, "", 0.0, 1.0)

# Parameters in a scenario file by dotted name, and a function from radars to its scenario.
Scene: TypeAlias = "tuple[Mapping[str, Any], Callable[[tuple[RadarModel, ...]], Scenario]]"


def resolve(
    document: Any, load_scene: Callable[[str], Scene], assigned: Mapping[str, Any]
) -> Study:
    """Check a study document and build the study.

    Parameters
    ----------
    document : mapping
        ``lags``, ``cases``, ``variants`` and ``goals``, as in `config/studies/published.yaml`.
    load_scene : callable of str
        Reads a scenario file, given its name in the document.
    assigned : mapping
        Tracker parameters that replace all others.

    Raises
    ------
    ConfigError
        If the document is invalid; the message lists all faults.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(["study: must be a mapping"])
    faults = _unknown_keys(document, "", ("lags", "cases", "variants", "goals"))
    faults += _own_faults("-p ", assigned)
    lags = _lags(document.get("lags"), "lags", faults)
    checked = [
        _case(name, given, load_scene, assigned, faults)
        for name, given in _entries(document, "cases", faults)
    ]
    names = [name for name, _ in _entries(document, "cases", [])]
    shared = [
        name
        for name, given in _entries(document, "cases", [])
        if given.get("only_named") is not True
    ]
    turning = {case.name for case in checked if case is not None and case.scenario.turning}
    variants = [
        _variant(name, given, names, shared, turning, lags, assigned, faults)
        for name, given in _entries(document, "variants", faults)
    ]
    goals = [
        _goal(given, f"goals[{index}].", names, variants, faults)
        for index, given in enumerate(_list(document, "goals", faults))
    ]
    cases = tuple(case for case in checked if case is not None)
    faults += [
        f"cases.{case.name}.lags: {list(case.lags or ())} given, {variant.name} has none of them"
        for case in cases
        for variant in variants
        if case.name in variant.cases and variant.lags and not case.lags_of(variant)
    ]
    study = Study(cases, tuple(variants), tuple(goals), dict(assigned))
    by_variant = dict(_tracker_faults(study))
    left_out = {}
    if "engine" in assigned:
        # A variant may be valid for another engine only; an engine on the command line omits it.
        others = replace(study, assigned={k: v for k, v in assigned.items() if k != "engine"})
        own = dict(_tracker_faults(others))
        left_out = {name: found[0] for name, found in by_variant.items() if name not in own}
    faults += [
        f"variants.{name}.parameters.{fault}"
        for name, found in by_variant.items()
        if name not in left_out
        for fault in found
    ]
    if faults:
        raise ConfigError(list(dict.fromkeys(faults)))
    return replace(study, left_out=left_out)


def _case(
    name: str,
    given: Mapping[str, Any],
    load_scene: Callable[[str], Scene],
    assigned: Mapping[str, Any],
    faults: list[str],
) -> Case | None:
    """Return a case, or None after adding its faults to `faults`."""
    prefix = f"cases.{name}."
    known = (
        *("scenario", "parameters", "cutoff", "only_named"),
        *("ignored", "run_share", "transponders", "lags"),
    )
    faults += _unknown_keys(given, prefix, known)
    lags = _lags(given["lags"], f"{prefix}lags", faults) if "lags" in given else None
    run_share = _run_share(given, prefix, faults)
    ignored = _ignored(given, prefix, faults)
    cutoff = CUTOFF.coerce(given["cutoff"]) if "cutoff" in given else math.nan
    if cutoff is None:
        faults.append(f"{prefix}cutoff: {given['cutoff']!r} given, must be {CUTOFF.allowed}")
    if not isinstance(given.get("only_named", False), bool):
        faults.append(f"{prefix}only_named: {given['only_named']!r} given, must be true or false")
    answers = list[str]()
    replies = transponders(given, answers)
    faults += [f"{prefix}{fault}" for fault in answers]
    of_case = _parameters(given, prefix, faults)
    source = given.get("scenario")
    if not isinstance(source, str):
        faults.append(
            f"{prefix}scenario: {source!r} given, must be {BUILT_IN_SCENARIO} or a scenario file"
        )
        return None
    try:
        built_in = source == BUILT_IN_SCENARIO
        in_file, build = ({}, paper_scenario) if built_in else load_scene(source)
        parameters = merged(in_file, of_case, assigned)
        model = tracker_config.resolve(parameters).model
        scenario, classes = build(polar_radars(model.radars)), len(model.modes.classes)
        if replies is not None:
            scenario = replace(scenario, transponders=replies)
        highest = max((target.class_id for target in scenario.targets), default=0)
        if highest >= classes:
            raise ConfigError([f"class {highest} of a target, must be below {classes}"])
        own = cutoff if isinstance(cutoff, float) and math.isfinite(cutoff) else None
        return Case(name, scenario, parameters, classes, own, ignored, run_share, lags)
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


def _ignored(given: Mapping[str, Any], prefix: str, faults: list[str]) -> Ignored:
    """Return the unscored targets of a case; add faults to `faults`."""
    if "ignored" not in given:
        return TAXIING
    block = given["ignored"]
    if not isinstance(block, Mapping):
        faults.append(f"{prefix}ignored: must be a mapping")
        return TAXIING
    faults += _unknown_keys(block, f"{prefix}ignored.", Ignored._fields)
    values = {}
    for parameter in IGNORED:
        value = parameter.coerce(block.get(parameter.name, parameter.default))
        if isinstance(value, float):
            values[parameter.name] = value
        else:
            faults.append(
                f"{prefix}ignored.{parameter.name}: {block[parameter.name]!r} given, must be "
                f"{parameter.allowed}"
            )
    return Ignored(**values)


def _variant(
    name: str,
    given: Mapping[str, Any],
    cases: Sequence[str],
    shared: Collection[str],
    turning: Collection[str],
    lags: tuple[int, ...],
    assigned: Mapping[str, Any],
    faults: list[str],
) -> Variant:
    """Return a variant; add its faults to `faults`.

    Its default cases are all of `shared` that suit its kind: cases of `turning`, or the others.
    """
    prefix = f"variants.{name}."
    keys = ("kind", "engine", "cases", "lags", "parameters", "run_share", *OF_READING)
    faults += _unknown_keys(given, prefix, keys)
    engine = _choice(given, "engine", prefix, TRACKERS, None, faults) if "engine" in given else None
    kind = _choice(given, "kind", prefix, KINDS, engine, faults)
    faults += [
        f"{prefix}{key}: only for kind {' or '.join(kinds)}"
        for key, kinds in (("engine", OURS), ("parameters", TUNED))
        if kind not in kinds and key in given
    ]
    parameters = _parameters(given, prefix, faults)
    if engine in TRACKERS:
        parameters = {"engine": engine, **parameters}
    if kind in TRACKERS:
        parameters = {"engine": kind, **parameters}
        kind = _engine_of({**parameters, **assigned}, kind)
    suited = [case for case in cases if suits(kind, case in turning)]
    reading = None
    if kind in TRACKERS:
        death_term = _choice(given, "death_term", prefix, DEATH_TERMS, "bernoulli", faults)
        extraction = _choice(given, "extraction", prefix, EXTRACTIONS, "components", faults)
        reading = Reading(name, death_term, extraction)
    else:
        only = " or ".join(TRACKERS)
        faults += [f"{prefix}{key}: only for kind {only}" for key in OF_READING if key in given]
    chosen = given.get("cases", [case for case in suited if case in shared])
    if not isinstance(chosen, list) or not chosen or not set(map(str, chosen)) <= set(suited):
        faults.append(f"{prefix}cases: {chosen!r} given, must be a list of {', '.join(suited)}")
        chosen = []
    return Variant(
        name=name,
        kind=kind,
        reading=reading,
        parameters=parameters,
        cases=tuple(chosen),
        lags=_lags(given["lags"], f"{prefix}lags", faults) if "lags" in given else lags,
        run_share=_run_share(given, prefix, faults),
    )


def _goal(
    given: Any, prefix: str, cases: Sequence[str], variants: Sequence[Variant], faults: list[str]
) -> Goal:
    """Return a goal; add its faults to `faults`."""
    if not isinstance(given, Mapping):
        faults.append(f"{prefix[:-1]}: must be a mapping")
        given = {}
    keys = (
        *("name", "case", "variant", "lag", "figure"),
        *("at_most", "at_least", "relative_to", "relative_case"),
    )
    faults += _unknown_keys(given, prefix, keys)
    names = [variant.name for variant in variants]
    bounds = [key for key in ("at_most", "at_least") if key in given]
    if len(bounds) != 1 or BOUND.coerce(given[bounds[0]]) is None:
        faults.append(
            f"{prefix}at_most: exactly one of at_most and at_least must be given, a number"
        )
    lag = LAG.coerce(given.get("lag"))
    if lag is None:
        faults.append(f"{prefix}lag: {given.get('lag')!r} given, must be {LAG.allowed}")
    relative = given.get("relative_to")
    if relative is not None:
        _choice(given, "relative_to", prefix, names, None, faults)
    case = other = _choice(given, "case", prefix, cases, None, faults)
    if "relative_case" in given:
        other = _choice(given, "relative_case", prefix, cases, None, faults)
    return Goal(
        name=str(given.get("name", prefix)),
        case=case,
        variant=_choice(given, "variant", prefix, names, None, faults),
        lag=lag if isinstance(lag, int) else 0,
        figure=_choice(given, "figure", prefix, FIGURES, None, faults),
        bound=given[bounds[0]] if bounds else math.nan,
        at_most=bounds == ["at_most"],
        relative_to=relative,
        relative_case=other,
    )


def _engine_of(parameters: Mapping[str, Any], default: str) -> str:
    """Return the selected engine; a wrong name is found later as a fault of the parameters."""
    engine = parameters["engine"]
    return engine if engine in TRACKERS else default


def _tracker_faults(study: Study) -> Iterator[tuple[str, list[str]]]:
    """Yield the variants with invalid tracker parameters at any of their cases, and the faults."""
    for variant in study.variants:
        faults: list[str] = []
        for case in study.cases:
            if variant.kind in TUNED and case.name in variant.cases and variant.parameters:
                given = study.parameters(case, variant)
                if given.get("engine") == "gaussian":
                    faults += _of_particles(variant)
                try:
                    tracker_config.resolve(given)
                except ConfigError as error:
                    faults += error.faults
        if faults:
            yield variant.name, list(dict.fromkeys(faults))


def _of_particles(variant: Variant) -> list[str]:
    """Return a fault for each choice of a variant that Gaussians do not have."""
    own = {"engine": variant.parameters.get("engine")}
    if variant.reading is not None:
        own |= dict(zip(OF_READING, variant.reading[1:], strict=True))
    others = {"engine": "phd", **OTHER_READING}
    return [
        f"{key}: {value} given, must be {LABELLED_READING[key]} with engine gaussian"
        for key, value in own.items()
        if str(value).startswith(others[key])
    ]


def _parameters(given: Mapping[str, Any], prefix: str, faults: list[str]) -> dict[str, Any]:
    value = given.get("parameters", {})
    if not isinstance(value, Mapping):
        faults.append(f"{prefix}parameters: must be a mapping")
        return {}
    parameters = dict(flatten(value))
    faults += _own_faults(f"{prefix}parameters.", parameters)
    return parameters


def _own_faults(prefix: str, parameters: Mapping[str, Any]) -> list[str]:
    return [f"{prefix}{name}: is set by the study itself" for name in OWN if name in parameters]


def _entries(
    document: Mapping[str, Any], key: str, faults: list[str]
) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the named mappings under a key."""
    value = document.get(key)
    if not isinstance(value, Mapping) or not value:
        faults.append(f"{key}: must be a mapping of at least one name")
        return []
    for name, given in value.items():
        if not isinstance(name, str) or not isinstance(given, Mapping):
            faults.append(f"{key}.{name}: must be a mapping with a string for a name")
    return [(n, g) for n, g in value.items() if isinstance(n, str) and isinstance(g, Mapping)]


def _list(document: Mapping[str, Any], key: str, faults: list[str]) -> list[Any]:
    value = document.get(key, [])
    if isinstance(value, list):
        return value
    faults.append(f"{key}: must be a list")
    return []


def _lags(value: Any, name: str, faults: list[str]) -> tuple[int, ...]:
    lags = [LAG.coerce(entry) for entry in value] if isinstance(value, list) else []
    if not lags or None in lags or len(set(lags)) < len(lags):
        faults.append(f"{name}: {value!r} given, must be a list, none twice: {LAG.allowed}")
        return ()
    return tuple(sorted(lag for lag in lags if isinstance(lag, int)))


def _run_share(given: Mapping[str, Any], prefix: str, faults: list[str]) -> float:
    """Return the checked share of the runs."""
    share = SHARE.coerce(given.get("run_share", 1.0))
    if not isinstance(share, float) or share == 0.0:
        value = given["run_share"]
        faults.append(f"{prefix}run_share: {value!r} given, must be above 0 and at most 1")
        return 1.0
    return share


def _choice(
    given: Mapping[str, Any],
    key: str,
    prefix: str,
    allowed: Iterable[str],
    default: str | None,
    faults: list[str],
) -> str:
    value = given.get(key, default)
    if not isinstance(value, str) or value not in allowed:
        faults.append(f"{prefix}{key}: {value!r} given, must be one of {', '.join(allowed)}")
    return str(value)


def _unknown_keys(given: Mapping[str, Any], prefix: str, known: Iterable[str]) -> list[str]:
    return [f"{prefix}{name}: unknown key" for name in given if name not in known]
