"""Checks a study document, the content of a YAML file, as a whole and converts it to a study."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from phd_jdtc_ros.configuration import build as tracker_config
from phd_jdtc_ros.configuration.schema import (
    SMALL,
    ConfigError,
    Form,
    Parameter,
    flatten,
    number,
)
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario
from phd_jdtc_ros.simulation.transponder import transponders

from ..runs import TAXIING, Ignored
from ..tracker import ExtractionVariant
from .definition import FIGURES, OWN, Case, Goal, Study, Variant, merge_layers
from .kinds import KINDS, Kind

BUILT_IN_SCENARIO = "paper_scenario"
LAG = Parameter("lag", 0, "", 0, 100)
BOUND = Parameter("bound", 0.0, "")
CUTOFF = Parameter("cutoff", 1000.0, "", SMALL)
ONLY_NAMED = Parameter("only_named", False, "")
IGNORED = tuple(Parameter(name, value, "", 0.0) for name, value in TAXIING._asdict().items())
SHARE = Parameter(
    "run_share", 1.0, "", form=Form("above 0 and at most 1", lambda given: number(given, SMALL, 1))
)
# Parameters of an extraction variant.
EXTRACTION = (
    Parameter("death_term", "bernoulli", "", choices=tuple(DEATH_TERMS)),
    Parameter("extraction", "components", "", choices=tuple(EXTRACTIONS)),
)
EXTRACTION_KEYS = tuple(parameter.name for parameter in EXTRACTION)
# The choices of the labelled filter, and the ones that Gaussians do not support.
LABELLED_CHOICES = {"engine": "gaussian", **{each.name: each.default for each in EXTRACTION}}
OTHER_CHOICES = {"engine": "phd", "death_term": "paper", "extraction": "clusters"}
CASE = (
    *("scenario", "parameters", "cutoff", "only_named"),
    *("ignored", "run_share", "transponders", "lags"),
)
VARIANT = ("kind", "engine", "cases", "lags", "parameters", "run_share", *EXTRACTION_KEYS)
BOUNDS = ("at_most", "at_least")
GOAL = ("name", "case", "variant", "lag", "figure", *BOUNDS, "relative_to", "relative_case")

# Parameters in a scenario file by dotted name, and a function from radars to its scenario.
Scene: TypeAlias = "tuple[Mapping[str, Any], Callable[[tuple[RadarModel, ...]], Scenario]]"


class _Block:
    """A mapping of the document, whose faults are added to a list."""

    def __init__(self, given: Any, prefix: str, known: Iterable[str], faults: list[str]) -> None:
        self.given = given if isinstance(given, Mapping) else {}
        self.prefix, self.faults = prefix, faults
        if given is not self.given:
            faults.append(f"{prefix[:-1]}: must be a mapping")
        faults += [f"{prefix}{name}: unknown key" for name in self.given if name not in known]

    def take(self, parameter: Parameter, required: bool = False) -> Any:
        """Return a checked value; the default if it is wrong, or missing and not required."""
        value = self.given.get(parameter.name, None if required else parameter.default)
        found = parameter.coerce(value)
        if found is not None:
            return found
        self.refuse(parameter.name, parameter.allowed)
        return parameter.default

    def choose(self, key: str, allowed: Iterable[str]) -> str:
        """Return one of the allowed words, which is required; "" for others."""
        word = self.take(Parameter(key, "", "", choices=tuple(allowed)), required=True)
        return str(word)

    def lags(self, default: tuple[int, ...] | None) -> tuple[int, ...] | None:
        """Return the lags, ascending; the default without any."""
        if "lags" not in self.given:
            return default
        value = self.given["lags"]
        lags = [LAG.coerce(entry) for entry in value] if isinstance(value, list) else []
        if lags and None not in lags and len(set(lags)) == len(lags):
            return tuple(sorted(lags))
        self.refuse("lags", f"a list, none twice: {LAG.allowed}")
        return ()

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the tracker by dotted name."""
        given = self.given.get("parameters", {})
        if not isinstance(given, Mapping):
            self.faults.append(f"{self.prefix}parameters: must be a mapping")
            return {}
        parameters = dict(flatten(given))
        self.faults += _own_faults(f"{self.prefix}parameters.", parameters)
        return parameters

    def refuse(self, key: str, allowed: str) -> None:
        """Add the fault of a value."""
        value = self.given.get(key)
        self.faults.append(f"{self.prefix}{key}: {value!r} given, must be {allowed}")


def resolve(
    document: Any,
    load_scene: Callable[[str], Scene],
    assigned: Mapping[str, Any],
    kinds: Mapping[str, Kind] = KINDS,
) -> Study:
    """Check a study document and build the study.

    The document has ``lags``, ``cases``, ``variants`` and ``goals``, as in
    `config/studies/published.yaml`. `load_scene` reads a scenario file, given its name in the
    document, and the `assigned` parameters of the tracker replace all others. Raise `ConfigError`
    with all faults.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(["study: must be a mapping"])
    faults: list[str] = []
    top = _Block(document, "", ("lags", "cases", "variants", "goals"), faults)
    faults += _own_faults("-p ", assigned)
    lags = top.lags(None)
    if lags is None:
        top.refuse("lags", f"a list, none twice: {LAG.allowed}")
    given = _entries(top, "cases")
    checked = [_case(name, each, load_scene, assigned, faults) for name, each in given.items()]
    cases = tuple(case for case in checked if case is not None)
    turning = {case.name for case in cases if case.scenario.turning}
    shared = {name for name, each in given.items() if each.get("only_named") is not True}

    def suited(kind: Kind | None) -> list[str]:
        return [name for name in given if kind is None or kind.turning == (name in turning)]

    variants = tuple(
        _variant(name, each, suited, shared, lags or (), assigned, kinds, faults)
        for name, each in _entries(top, "variants").items()
    )
    goals = document.get("goals", [])
    if not isinstance(goals, list):
        faults.append("goals: must be a list")
        goals = []
    names = [variant.name for variant in variants]
    study = Study(
        cases,
        variants,
        tuple(_goal(each, index, given, names, faults) for index, each in enumerate(goals)),
        dict(assigned),
    )
    faults += [
        f"cases.{case.name}.lags: {list(case.lags or ())} given, {variant.name} has none of them"
        for case in cases
        for variant in variants
        if case.name in variant.cases and variant.lags and not case.lags_of(variant)
    ]
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


def _entries(top: _Block, key: str) -> dict[str, Mapping[str, Any]]:
    """Return the named mappings under a key."""
    value = top.given.get(key)
    if not isinstance(value, Mapping) or not value:
        top.faults.append(f"{key}: must be a mapping of at least one name")
        return {}
    found = {}
    for name, given in value.items():
        if isinstance(name, str) and isinstance(given, Mapping):
            found[name] = given
        else:
            top.faults.append(f"{key}.{name}: must be a mapping with a string for a name")
    return found


def _case(
    name: str,
    given: Mapping[str, Any],
    load_scene: Callable[[str], Scene],
    assigned: Mapping[str, Any],
    faults: list[str],
) -> Case | None:
    """Return a case, or None after adding its faults to `faults`."""
    block = _Block(given, f"cases.{name}.", CASE, faults)
    block.take(ONLY_NAMED)
    ignored = _Block(given.get("ignored", {}), f"{block.prefix}ignored.", Ignored._fields, faults)
    answers = list[str]()
    replies = transponders(given, answers)
    faults += [f"{block.prefix}{fault}" for fault in answers]
    of_case = block.parameters()
    settings = {
        "cutoff": block.take(CUTOFF) if "cutoff" in given else None,
        "ignored": Ignored(*map(ignored.take, IGNORED)),
        "run_share": block.take(SHARE),
        "lags": block.lags(None),
    }
    source = given.get("scenario")
    if not isinstance(source, str):
        block.refuse("scenario", f"{BUILT_IN_SCENARIO} or a scenario file")
        return None
    try:
        built_in = source == BUILT_IN_SCENARIO
        in_file, build = ({}, paper_scenario) if built_in else load_scene(source)
        parameters = merge_layers(in_file, of_case, assigned)
        model = tracker_config.resolve(parameters).model
        scenario, classes = build(polar_radars(model.radars)), len(model.modes.classes)
        if replies is not None:
            scenario = replace(scenario, transponders=replies)
        highest = max((target.class_id for target in scenario.targets), default=0)
        if highest >= classes:
            raise ConfigError([f"class {highest} of a target, must be below {classes}"])
        return Case(name, scenario, parameters, classes, **settings)
    except ConfigError as error:
        for fault in error.faults:
            name = fault.split(":")[0]
            faults.append(
                f"-p {fault}"
                if name in assigned
                else f"{block.prefix}parameters.{fault}"
                if name in of_case
                else f"{block.prefix}scenario: {fault}"
            )
        return None


def _variant(
    name: str,
    given: Mapping[str, Any],
    suited: Callable[[Kind | None], list[str]],
    shared: Collection[str],
    lags: tuple[int, ...],
    assigned: Mapping[str, Any],
    kinds: Mapping[str, Kind],
    faults: list[str],
) -> Variant:
    """Return a variant; add its faults to `faults`.

    `suited` returns the cases that suit a kind. Its default cases are those of them in `shared`.
    """
    block = _Block(given, f"variants.{name}.", VARIANT, faults)
    engines = [kind.name for kind in kinds.values() if kind.is_engine]
    engine = block.choose("engine", engines) if "engine" in given else ""
    kind = kinds.get(engine if engine and "kind" not in given else block.choose("kind", kinds))
    parameters = block.parameters()
    for key, allowed in (
        ("engine", [each.name for each in kinds.values() if each.ours]),
        ("parameters", [each.name for each in kinds.values() if each.tuned]),
        *((key, engines) for key in EXTRACTION_KEYS),
    ):
        if key in given and (kind is None or kind.name not in allowed):
            faults.append(f"{block.prefix}{key}: only for kind {' or '.join(allowed)}")
    extraction = None
    if kind is not None and kind.is_engine:
        parameters = {"engine": engine or kind.name, **parameters}
        # A wrong engine is found later as a fault of the parameters.
        kind = kinds.get(str({**parameters, **assigned}["engine"]), kind)
        extraction = ExtractionVariant(name, *map(block.take, EXTRACTION))
    elif engine:
        parameters = {"engine": engine, **parameters}
    cases = suited(kind)
    chosen = given.get("cases", [case for case in cases if case in shared])
    if not isinstance(chosen, list) or not chosen or not set(map(str, chosen)) <= set(cases):
        faults.append(
            f"{block.prefix}cases: {chosen!r} given, must be a list of {', '.join(cases)}"
        )
        chosen = []
    return Variant(
        name=name,
        kind=kind or next(iter(kinds.values())),
        extraction=extraction,
        parameters=parameters,
        cases=tuple(chosen),
        lags=block.lags(lags) or (),
        run_share=block.take(SHARE),
    )


def _goal(
    given: Any, index: int, cases: Iterable[str], variants: Sequence[str], faults: list[str]
) -> Goal:
    """Return a goal; add its faults to `faults`."""
    block = _Block(given, f"goals[{index}].", GOAL, faults)
    bounds = [key for key in BOUNDS if key in block.given]
    if len(bounds) != 1 or BOUND.coerce(block.given[bounds[0]]) is None:
        faults.append(
            f"{block.prefix}at_most: exactly one of at_most and at_least must be given, a number"
        )
    case = block.choose("case", cases)
    has_other_case = "relative_case" in block.given
    relative = block.given.get("relative_to") is not None
    return Goal(
        name=str(block.given.get("name", block.prefix)),
        case=case,
        variant=block.choose("variant", variants),
        lag=block.take(LAG, required=True),
        figure=block.choose("figure", FIGURES),
        bound=block.given[bounds[0]] if bounds else math.nan,
        at_most=bounds == ["at_most"],
        relative_to=block.choose("relative_to", variants) if relative else None,
        relative_case=block.choose("relative_case", cases) if has_other_case else case,
    )


def _tracker_faults(study: Study) -> Iterator[tuple[str, list[str]]]:
    """Yield the variants with invalid tracker parameters at any of their cases, and the faults."""
    for variant in study.variants:
        faults: list[str] = []
        for case in study.cases:
            if variant.kind.tuned and case.name in variant.cases and variant.parameters:
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
    if variant.extraction is not None:
        own |= dict(zip(EXTRACTION_KEYS, variant.extraction[1:], strict=True))
    return [
        f"{key}: {value} given, must be {LABELLED_CHOICES[key]} with engine gaussian"
        for key, value in own.items()
        if str(value).startswith(OTHER_CHOICES[key])
    ]


def _own_faults(prefix: str, parameters: Mapping[str, Any]) -> list[str]:
    return [f"{prefix}{name}: is set by the study itself" for name in OWN if name in parameters]
