# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Values that travel through the tracker: scans in, particle intensities, estimates out.

Every type is frozen and its arrays are read-only, so a value that one stage has handed on can be
kept by another (the fixed-lag window keeps many) without a copy. Nobody writes to the entries of
sparse arrays either, which scipy needs writable.

Dimension letters, the same everywhere: N particles, M detections, J components,
T targets, O modes, C classes, D state, Z measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
# scipy ships no type information; the alias says what is meant.
SparseArray = Any
# Runs of fewer equal values than this are as soon summed one by one.
SHORT_RUN = 4


def read_only(array: npt.ArrayLike, dtype: type = np.float64) -> Any:
    """Return `array` as a contiguous array of `dtype` that refuses assignment.

    An array of the right kind is not copied; the flag is set on a view of it.
    """
    view: Any = np.ascontiguousarray(array, dtype=dtype)
    if not view.flags.writeable:
        return view
    view = view.view()
    view.flags.writeable = False
    return view


def sum_by(index: IntArray, weight: FloatArray, size: int) -> FloatArray:
    """Return the sums of `weight` over equal `index`, shape (size,).

    Where equal ones stand in long runs, as the particles of a target do, run by run: ten times as
    fast.
    """
    first = run_starts(index)
    if len(first) < len(index) // SHORT_RUN:
        index, weight = index.take(first), np.add.reduceat(weight, first)
    total: FloatArray = np.bincount(index, weights=weight, minlength=size).astype(
        np.float64, copy=False
    )
    return total


def run_starts(value: IntArray) -> IntArray:
    """Return where each run of equal values begins."""
    return np.flatnonzero(np.concatenate([[True], value[1:] != value[:-1]])[: len(value)])


def number(value: IntArray) -> tuple[IntArray, IntArray]:
    """Return the distinct values, ascending, and which of them each entry is.

    As `numpy.unique`, but fast where equal values stand in long runs, as origins do.
    """
    first = run_starts(value)
    distinct, run = np.unique(value[first], return_inverse=True)
    length = np.diff(np.append(first, len(value)))
    return distinct, run.ravel().repeat(length)


@dataclass(frozen=True)
class Detections:
    """What one radar reports in one scan, in that radar's own frame.

    Parameters
    ----------
    measurement : array of shape (M, Z)
        For the polar radar Z = 2: range in metres, azimuth in radians counter-clockwise from the
        sensor's x axis.
    amplitude : array of shape (M,) or None
        Linear envelope in units of the noise's per-quadrature standard deviation. None when the
        radar reports no amplitude: the class likelihood is then neutral.
    """

    measurement: FloatArray
    amplitude: FloatArray | None

    def __post_init__(self) -> None:
        measurement = read_only(self.measurement)
        if measurement.ndim != 2:
            raise ValueError(f"measurement: expected shape (M, Z), got {measurement.shape}")
        object.__setattr__(self, "measurement", measurement)
        if self.amplitude is not None:
            amplitude = read_only(self.amplitude)
            if amplitude.shape != measurement.shape[:1]:
                raise ValueError(
                    f"amplitude: expected shape {measurement.shape[:1]}, got {amplitude.shape}"
                )
            object.__setattr__(self, "amplitude", amplitude)

    def __len__(self) -> int:
        return len(self.measurement)


@dataclass(frozen=True)
class Scan:
    """All detections that carry one stamp.

    Parameters
    ----------
    stamp_ns : int
        Time of the scan in nanoseconds.
    detections : tuple of (Detections or None), one entry a radar, in the configured order
        None where that radar did not report this stamp: it is not updated with, which is not
        the same as a report of zero detections.
    """

    stamp_ns: int
    detections: tuple[Detections | None, ...]


@dataclass(frozen=True)
class ParticlePHD:
    """A particle approximation of the intensity over (state, class, motion mode).

    After an update the posterior is a Poisson part and Bernoulli components, each one target at
    the most. The weight of a particle is split alike:
    ``weight = poisson + components.sum(axis=1)``. A component is what one detection explains, or
    all that has one origin; see `correction`.

    Parameters
    ----------
    state : array of shape (N, D)
        In the world frame; metres, metres per second, radians per second.
    mode : int array of shape (N,)
        Flat index into the mode space.
    origin : int array of shape (N,)
        What founded the particle's ancestry: a birth term at a scan, a detection, or a parent
        that it was spawned beside.
    parent : int array of shape (N,)
        Row of the ancestor in the stored set of the scan before; -1 for a birth.
    multiplicity : int array of shape (N,)
        How many equal copies the row stands for.
    poisson : array of shape (N,)
        Weight of no component.
    components : sparse array of shape (N, J)
        Weight in component j.
    label : int array of shape (J,)
        Origin that each component is the target of; -1 where it is a detection's.
    memory : array of shape (N,)
        What the amplitude model remembers; zeros where it remembers nothing.
    """

    state: FloatArray
    mode: IntArray
    origin: IntArray
    parent: IntArray
    multiplicity: IntArray
    poisson: FloatArray
    components: SparseArray
    label: IntArray
    memory: FloatArray

    def __post_init__(self) -> None:
        for name in ("state", "poisson", "memory"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("mode", "origin", "parent", "multiplicity", "label"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    def __len__(self) -> int:
        return len(self.state)

    @cached_property
    def weight(self) -> FloatArray:
        """Total weight of each particle, shape (N,); sums to the expected number of targets."""
        total: FloatArray = read_only(
            self.poisson + self.components @ np.ones(self.components.shape[1])
        )
        return total

    @cached_property
    def _entries(self) -> IntArray | None:
        """How many components each row has; None where all have one, as is usual."""
        number = np.diff(self.components.indptr)
        return None if (number == 1).all() else number

    def by_entry(self, of_row: FloatArray) -> FloatArray:
        """Return of each entry of the components the value of its row."""
        return of_row if self._entries is None else of_row.repeat(self._entries)

    @cached_property
    def component_mass(self) -> FloatArray:
        """Weight of each component, shape (J,)."""
        parts = self.components
        mass: FloatArray = read_only(sum_by(parts.indices, parts.data, parts.shape[1]))
        return mass

    @property
    def effective_sample_size(self) -> float:
        """Number of equally weighted copies that would be as informative."""
        square = float((self.weight**2 / np.maximum(self.multiplicity, 1)).sum())
        return float(self.weight.sum()) ** 2 / square if square > 0.0 else 0.0

    def class_mass(self, class_of: IntArray, classes: int) -> FloatArray:
        """Return the expected number of targets of each class, shape (C,).

        Parameters
        ----------
        class_of : int array of shape (O,)
            Class of each flat mode.
        classes : int
        """
        return sum_by(class_of[self.mode], self.weight, classes)

    @staticmethod
    def empty(state_size: int) -> ParticlePHD:
        """Return an intensity of no targets."""
        none = np.zeros(0, dtype=np.int64)
        return ParticlePHD(
            state=np.zeros((0, state_size)),
            mode=none,
            origin=none,
            parent=none,
            multiplicity=none,
            poisson=np.zeros(0),
            components=sparse.csr_array((0, 0)),
            label=none,
            memory=np.zeros(0),
        )


@dataclass(frozen=True)
class Estimates:
    """Targets extracted from an intensity.

    Parameters
    ----------
    stamp_ns : int
        The time of the states.
    lag : int
        How many later scans the estimates have seen; 0 for filtered ones.
    state : array of shape (T, D)
        In the world frame; metres, metres per second, radians per second.
    covariance : array of shape (T, D, D)
        Of the particles about it, in the same units.
    weight : array of shape (T,)
        Mass of the component: the probability that the target exists, up to the PHD's bias.
    class_probability : array of shape (T, C)
    class_id : int array of shape (T,)
    track_id : int array of shape (T,)
        0 means unlabelled.
    """

    stamp_ns: int
    lag: int
    state: FloatArray
    covariance: FloatArray
    weight: FloatArray
    class_probability: FloatArray
    class_id: IntArray
    track_id: IntArray

    def __post_init__(self) -> None:
        for name in ("state", "covariance", "weight", "class_probability"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("class_id", "track_id"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    def __len__(self) -> int:
        return len(self.state)

    @property
    def unresolved(self) -> int:
        """Number of estimates whose mass says that they stand for two targets."""
        return int(np.count_nonzero(self.weight > 1.5))
