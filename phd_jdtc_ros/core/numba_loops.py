"""Compilation of the loops of `pair_search`, in modules that need numba.

These modules, named `compiled` or `compiled_kernel`, are imported only where numba is installed.
No compiled function of them calls one of another file, because numba caches compiled code by
source file and does not notice a change in another file. Signatures are explicit, so that
compilation happens at import and not during a scan.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

# numba ships no type information.
types: Any = numba.types


def read(element: Any, dimensions: int) -> Any:
    """Return the type of a contiguous array that may be read-only."""
    return types.Array(element, dimensions, "C", readonly=True)


def compiled(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function for one signature, at its definition."""

    def compile_it(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(signature, cache=True, error_model="numpy")(function)
        except RuntimeError:  # without a writable cache directory every start compiles again
            return numba.njit(signature, error_model="numpy")(function)

    return compile_it
