"""Compiles functions of arrays with numba, where it is installed.

A compiled function is plain Python with loops. Without numba it is interpreted, with the same
results, about twenty times slower. Arrays that come from Python are contiguous, and the types in
the signature give their number of axes, so that functions are compiled at import and not during a
scan.

A function takes the values that its caller has as named tuples of arrays. Their arrays are
read-only, as the types that numba compares exactly: `arrays.frozen` makes them so, once, when a
tuple is made. Tuples that a function writes into are declared `Writeable`.

numba stores compiled code beside the source, by the function's name and file. It does not notice
that a called function or a named tuple of another file has changed; the name therefore includes a
digest of those files.

Loops over the axes of a state take half the time if their number, `SIZE`, is a constant for the
compiler. It is that of the plane; `of_size` compiles the same functions for another one.
"""

from __future__ import annotations

import gc
import hashlib
import importlib
import inspect
import logging
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from types import FrameType, FunctionType
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_type_hints

from .arrays import Bool1 as Bool1
from .arrays import BoolArray, FloatArray, IntArray
from .arrays import Float1 as Float1
from .arrays import Float2 as Float2
from .arrays import Float3 as Float3
from .arrays import Float4 as Float4
from .arrays import Int1 as Int1
from .arrays import Int2 as Int2

# The number of axes of a state in the plane; see above.
SIZE = 5


def _numba() -> Any:
    """Return the library, whose types mypy does not need to know; None where it is missing."""
    try:
        return importlib.import_module("numba")
    except ImportError as error:
        logging.getLogger(__name__).warning(
            "%s: the tracker runs interpreted, many times as slowly; pip install numba", error
        )
        return None


numba = _numba()
# Names of functions whose code no directory could store: they are compiled at every start.
NOT_STORED: list[str] = []
# Functions that are called once, when the first function is compiled whose code was not stored.
ON_COMPILATION: list[Callable[[], None]] = []

T = TypeVar("T")
# A named tuple whose arrays are not read-only, since compiled code has made them or writes them.
Writeable = Annotated[T, "writeable"]

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])
_ELEMENTS = {FloatArray: "float64", IntArray: "int64", BoolArray: "boolean"}
_NUMBERS = {float: "float64", int: "int64", bool: "boolean"}
# A division by zero has the result that NumPy gives, and does not raise.
_OPTIONS = {"error_model": "numpy", "nogil": True}
# What has compiled each function, and the functions of other sizes.
_COMPILED_BY: dict[Any, Callable[[Any], Any]] = {}
_OF_SIZE: dict[tuple[Any, int], Any] = {}


def compiled(function: FunctionT, *, counted: bool = True) -> FunctionT:
    """Compile a function, at its definition, for the types in its signature.

    If references to arrays are not `counted`, the function may not create arrays.
    """
    _COMPILED_BY[function] = partial(compiled, counted=counted)
    # With NUMBA_DISABLE_JIT, as debuggers and mutation tests set it, numba compiles nothing.
    if numba is None or numba.config.DISABLE_JIT:
        return function
    hints = get_type_hints(function, include_extras=True)
    hints.pop("return", None)
    function.__qualname__ += "." + _digest(function, hints.values())
    signature = tuple(_type_of(hint) for hint in hints.values())
    # Compiled functions are never called from C.
    options = {**_OPTIONS, "no_cfunc_wrapper": True, "_nrt": counted}
    done: Any
    with _without_collection(), _interruptible():
        try:
            done = numba.njit(signature, cache=True, **options)(function)
        except RuntimeError:  # No writable cache directory
            NOT_STORED.append(function.__qualname__)
            done = numba.njit(signature, **options)(function)
    if not done.stats.cache_hits:
        _announce()
    compiled_function: FunctionT = done
    return compiled_function


def in_place(function: FunctionT) -> FunctionT:
    """Compile a function that only writes into arrays that it is given.

    It does not count references to arrays, which in short loops over slices takes most of the time.
    """
    return compiled(function, counted=False)


@contextmanager
def _without_collection() -> Iterator[None]:
    """Suspend garbage collection, which takes a tenth of the time of a compilation."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise what the handler of a signal has raised at the end too, since numba can swallow it."""
    raised: list[BaseException] = []

    def call(number: int, frame: FrameType | None) -> None:
        handler = before[number]
        try:
            handler(number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    before: dict[int, Callable[[int, FrameType | None], Any]] = {}
    # Only the main thread has handlers.
    if threading.current_thread() is threading.main_thread():
        handlers = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
        before.update((number, own) for number, own in handlers.items() if callable(own))
        for number in before:
            signal.signal(number, call)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if raised:
            raise raised[0]


@cache
def _announce() -> None:
    """Log once that compilation has begun, and call the functions in `ON_COMPILATION`."""
    for notify in ON_COMPILATION:
        notify()
    logging.getLogger(__name__).warning(
        "compiling the tracker, once for each installation: it takes about a minute; "
        "compile_engines does it beforehand"
    )


def inner(function: FunctionT) -> FunctionT:
    """Let compiled functions call a function; it is compiled as a part of each of them."""
    _COMPILED_BY[function] = inner
    if numba is None:
        return function
    # Without inlining it would also be compiled separately, with a wrapper for Python.
    done: FunctionT = numba.njit(inline="always", **_OPTIONS)(function)
    return done


def of_size(function: FunctionT, size: int) -> FunctionT:
    """Return a function with another `SIZE`, also in the compiled functions that it calls."""
    plain: Any = _plain(function)
    if size == SIZE:
        return function
    if (plain, size) not in _OF_SIZE:
        known = plain.__globals__
        names = [n for n in plain.__code__.co_names if _plain(known.get(n)) in _COMPILED_BY]
        changed = {name: of_size(known[name], size) for name in names}
        own = FunctionType(plain.__code__, {**known, **changed, "SIZE": size}, plain.__name__)
        own.__qualname__ = f"{plain.__qualname__}.{size}"
        own.__annotations__ = plain.__annotations__
        _OF_SIZE[plain, size] = _COMPILED_BY[plain](own)
    made: FunctionT = _OF_SIZE[plain, size]
    return made


def _plain(value: Any) -> Any:
    """Return a function as it was before it was compiled; None for anything else."""
    plain = getattr(value, "py_func", value)
    return plain if isinstance(plain, FunctionType) else None


class BySize(dict[int, FunctionT]):
    """A compiled function for states of each number of axes: ``function[size](...)``."""

    made: ClassVar[list[BySize[Any]]] = []

    def __init__(self, function: FunctionT) -> None:
        self.planar = function
        self.made.append(self)

    def __missing__(self, size: int) -> FunctionT:
        self[size] = of_size(self.planar, size)
        return self[size]


def compile_for(size: int) -> None:
    """Compile what is called for states of this number of axes, so that no scan waits for it."""
    for function in BySize.made:
        function[size]


@cache
def _type_of(hint: Any, readonly: bool = True) -> Any:
    """Return numba's type of a parameter."""
    if hint in _NUMBERS:
        return getattr(numba.types, _NUMBERS[hint])
    if isinstance(hint, type):  # It is a named tuple.
        fields = get_type_hints(hint, include_extras=True).values()
        types = [_type_of(field, readonly) for field in fields]
        return numba.types.BaseTuple.from_types(types, hint)
    declared, note = get_args(hint)
    if note == "writeable":
        return _type_of(declared, False)
    # The shape of a stored value has a letter for each axis; see `snapshot`.
    axes = note if isinstance(note, int) else len(note.shape)
    name = next(name for element_type, name in _ELEMENTS.items() if element_type == declared)
    return numba.types.Array(getattr(numba.types, name), axes, "C", readonly=readonly)


def _digest(function: Any, hints: Iterable[Any]) -> str:
    """Return a digest of a function's file, and of those of what it calls, takes and makes."""
    files = _files(function)
    for hint in hints:
        files |= _file_of_tuple(get_args(hint)[0] if get_args(hint) else hint)
    text = b"".join(Path(name).read_bytes() for name in sorted(files))
    return hashlib.sha256(text).hexdigest()[:8]


def _files(function: FunctionType) -> set[str]:
    found = {function.__code__.co_filename}
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        called = getattr(value, "py_func", None)
        found |= _file_of_tuple(value) if called is None else _files(called)
    return found


def _file_of_tuple(value: Any) -> set[str]:
    """Return the file of a named tuple's class; no other value has one."""
    named = isinstance(value, type) and hasattr(value, "_fields")
    return {inspect.getfile(value)} if named else set()
