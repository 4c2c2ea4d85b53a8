"""Another decoder of ASTERIX, asterix_decoder, which tests compare with.

`make test` installs it into a folder of its own, because it has the import name of libasterix. Its
library is loaded by its path; the definitions of the categories are XML files beside it. Where it
is not installed, as in a workspace of colcon's, tests that compare with it are skipped.
"""

import importlib.util
import sys
from functools import cache
from pathlib import Path

import pytest

HOME = Path(sys.prefix) / "asterix_decoder"


def _installed():
    """Return its folder; the test is skipped without."""
    if not HOME.is_dir():
        pytest.skip(f"asterix_decoder is not in {HOME}: make test installs it there")
    return HOME


def sample(name):
    """Return the bytes of a recording that comes with it."""
    return (_installed() / "asterix" / "sample_data" / name).read_bytes()


@cache
def _library():
    (path,) = _installed().glob("_asterix*.so")
    spec = importlib.util.spec_from_file_location("_asterix", path)
    library = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(library)
    for definition in sorted((HOME / "asterix" / "config").glob("*.xml")):
        library.init(str(definition))
    return library


def decoded(data):
    """Return the records of data blocks, each with its category and its items by name."""
    return _library().parse(bytes(data), 0)


def value(record, *names):
    """Return a value of a record by its names, None if it is not there."""
    found = record
    for name in names:
        if found is None:
            return None
        found = found.get(name)
    return None if found is None else found["val"]
