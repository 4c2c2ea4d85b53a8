# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a tracker holds, as plain arrays and numbers: to be stored, and to go on from.

Data, never code: arrays by dotted name, and facts that JSON can hold. `engine` says what is stored;
here is how its parts become arrays and come back.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from ..arrays import SparseArray
from .backward_kernel import Transition
from .particle_set import ParticlePHD

PARTICLES = tuple(f.name for f in fields(ParticlePHD) if f.name != "components")


@dataclass(frozen=True)
class Snapshot:
    """A tracker's state.

    Parameters
    ----------
    arrays : dict of name to array
    facts : dict
        Of numbers, strings, lists and dicts.
    """

    arrays: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def put_particles(self, name: str, phd: ParticlePHD) -> None:
        """Store an intensity."""
        for part in PARTICLES:
            self.arrays[f"{name}.{part}"] = getattr(phd, part)
        self._put_sparse(f"{name}.components", phd.components)

    def particles(self, name: str) -> ParticlePHD:
        """Return a stored intensity.

        Raises
        ------
        ValueError
            If its arrays do not belong together.
        """
        parts = {part: self._array(f"{name}.{part}") for part in PARTICLES}
        components = sparse.csr_array(self._sparse(f"{name}.components", sparse.csr_array))
        rows = {part: len(array) for part, array in parts.items() if part != "label"}
        if {*rows.values(), components.shape[0]} != {len(parts["state"])}:
            raise ValueError(f"{name}: arrays of different length, {rows}")
        if components.shape[1] != len(parts["label"]):
            raise ValueError(
                f"{name}: {components.shape[1]} components, {len(parts['label'])} labels"
            )
        return ParticlePHD(components=components, **parts)

    def put_link(self, name: str, link: Transition) -> None:
        """Store the transition between two intensities."""
        self.arrays[f"{name}.survival"] = link.survival
        self.arrays[f"{name}.orphans"] = np.array(link.orphans)
        self._put_sparse(f"{name}.ratio", link.ratio)

    def link(self, name: str, earlier: ParticlePHD, later: ParticlePHD) -> Transition:
        """Return a stored transition.

        Raises
        ------
        ValueError
            If it is not between sets of these sizes.
        """
        ratio = self._sparse(f"{name}.ratio", sparse.csc_array)
        survival = self._array(f"{name}.survival")
        if ratio.shape != (len(earlier), len(later)) or len(survival) != len(earlier):
            raise ValueError(
                f"{name}: {ratio.shape} and {len(survival)} rows, expected "
                f"({len(earlier)}, {len(later)}) and {len(earlier)}"
            )
        return Transition(ratio, survival, int(self._array(f"{name}.orphans")))

    def _put_sparse(self, name: str, matrix: SparseArray) -> None:
        for part in ("data", "indices", "indptr"):
            self.arrays[f"{name}.{part}"] = getattr(matrix, part)
        self.arrays[f"{name}.shape"] = np.array(matrix.shape, dtype=np.int64)

    def _sparse(self, name: str, kind: Any) -> Any:
        parts = tuple(self._array(f"{name}.{part}") for part in ("data", "indices", "indptr"))
        shape = tuple(self._array(f"{name}.shape").tolist())
        matrix = kind(parts, shape=shape)
        matrix.check_format()
        return matrix

    def _array(self, name: str) -> npt.NDArray[Any]:
        if name not in self.arrays:
            raise ValueError(f"{name}: missing")
        return self.arrays[name]
