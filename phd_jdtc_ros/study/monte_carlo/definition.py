# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a study is: cases, the variants that are run on each, and goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from phd_jdtc_ros.core.configuration.parameters import GROUPS, TOP
from phd_jdtc_ros.core.configuration.schema import ConfigError
from phd_jdtc_ros.core.evaluation.metric_table import CLASS_ACCURACY, OF_SETS, Metric, mean
from phd_jdtc_ros.core.simulation.scenario import Scenario

from ..particles import Reading

OSPA_AFTER_5 = Metric(
    "ospa_after_5",
    "OSPA after 5 scans",
    "m",
    ".1f",
    mean("ospa_after_5"),
    "OSPA without the targets in the first five scans of their life and without the estimates that "
    "they are paired with, its mean over the scans in which not all living targets are that young.",
)
METRICS = {metric.key: metric for metric in (*OF_SETS, CLASS_ACCURACY, OSPA_AFTER_5)}
# Of the mean OSPA, against lag 0.
REDUCTION = "reduction"
FIGURES = (*METRICS, REDUCTION)
# Parameters that the study says itself.
OWN = ("lag", "lag_s", "seed", "death_term", "extraction")


@dataclass(frozen=True)
class Case:
    """What all variants are given.

    Parameters
    ----------
    name : str
    scenario : Scenario
    parameters : dict
        The tracker's, by dotted name; the radars of the scenario are theirs.
    classes : int
    """

    name: str
    scenario: Scenario
    parameters: dict[str, Any]
    classes: int


@dataclass(frozen=True)
class Variant:
    """One tracker.

    Parameters
    ----------
    name : str
    kind : str
        Of `KINDS`.
    reading : Reading or None
        None for other kinds than the particle engine.
    parameters : dict
        Over the case's, for the tracker; the data stay the case's.
    cases : tuple of str
    lags : tuple of int
        Ascending.
    """

    name: str
    kind: str
    reading: Reading | None
    parameters: dict[str, Any]
    cases: tuple[str, ...]
    lags: tuple[int, ...]


@dataclass(frozen=True)
class Goal:
    """A bound on the mean of a figure over all targets.

    Parameters
    ----------
    name, case, variant : str
    lag : int
    figure : str
        Of `FIGURES`.
    bound : float
    at_most : bool
        Whether the bound is an upper one.
    relative_to : str or None
        The variant whose figure the bound is a multiple of.
    """

    name: str
    case: str
    variant: str
    lag: int
    figure: str
    bound: float
    at_most: bool
    relative_to: str | None


@dataclass(frozen=True)
class Study:
    """A checked study.

    Parameters
    ----------
    cases : tuple of Case
    variants : tuple of Variant
    goals : tuple of Goal
    assigned : dict
        Parameters over all others.
    """

    cases: tuple[Case, ...]
    variants: tuple[Variant, ...]
    goals: tuple[Goal, ...]
    assigned: dict[str, Any]

    def parameters(self, case: Case, variant: Variant) -> dict[str, Any]:
        """Return the tracker's parameters of a variant at a case."""
        return merged(case.parameters, variant.parameters, self.assigned)

    def select(self, cases: Sequence[str], variants: Sequence[str]) -> Study:
        """Return the study of some cases and variants; of all where none is named.

        Raises
        ------
        ConfigError
            With every unknown name.
        """
        faults = _unknown("--case", cases, [case.name for case in self.cases])
        faults += _unknown("--variant", variants, [variant.name for variant in self.variants])
        if faults:
            raise ConfigError(faults)
        return replace(
            self,
            cases=tuple(case for case in self.cases if not cases or case.name in cases),
            variants=tuple(v for v in self.variants if not variants or v.name in variants),
        )


def _unknown(option: str, names: Sequence[str], known: Sequence[str]) -> list[str]:
    return [
        f"{option}: {name!r} given, must be one of {', '.join(known)}"
        for name in names
        if name not in known
    ]


def merged(*layers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of several layers, the later over the earlier ones.

    A layer that names the radars, classes, motions or births anew also takes away what earlier
    layers say of those that it leaves out.
    """
    result: dict[str, Any] = {}
    for layer in layers:
        for group in GROUPS:
            kept = layer.get(group)
            if isinstance(kept, list):
                left = result.get(group, _DEFAULT_NAMES[group])
                gone = {str(name) for name in left if name not in kept}
                result = {k: v for k, v in result.items() if k.split(".")[0] not in gone}
        result.update(layer)
    return result


_DEFAULT_NAMES = {p.name: p.default for p in TOP if p.name in GROUPS}
