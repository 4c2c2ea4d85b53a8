"""Files with live tests, found without an import of them."""

import re
from functools import cache

# Fixtures that start nodes or talk to them.
FIXTURES = {"processes", "executables", "peer", "lasting", "demo"}
_NAMED = re.compile(rf"mark\.live|\bdef .*\b({'|'.join(FIXTURES)})\b")


@cache
def names_live_tests(path):
    """Return whether a file marks a test as live, or has one of the fixtures as an argument."""
    return bool(_NAMED.search(path.read_text()))
