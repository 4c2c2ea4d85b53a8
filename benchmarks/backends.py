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

"""The implementations of the neighbour search's inner loop that are installed.

`phd_jdtc_ros.core.neighbours` chooses one when it is imported. A comparison in one process has to
change that choice, and only this module does.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager

from phd_jdtc_ros.core import neighbours

NUMPY = "NumPy"
NUMBA = "numba"


@functools.cache
def available() -> tuple[str, ...]:
    """Return the names of the installed ones, the reference first."""
    try:
        neighbours.backend(NUMBA)
    except ImportError:
        return (NUMPY,)
    return (NUMPY, NUMBA)


def reason_missing(backend: str) -> str:
    """Return why a backend is not among the available ones."""
    return f"{backend} is not installed: pip install '.[fast]'"


@contextmanager
def using(backend: str) -> Iterator[None]:
    """Build transitions with one of them for as long as the block lasts."""
    chosen = neighbours.BACKEND
    neighbours.BACKEND = neighbours.backend(backend.lower())
    try:
        yield
    finally:
        neighbours.BACKEND = chosen
