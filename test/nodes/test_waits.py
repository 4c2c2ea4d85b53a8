"""Live tests wait for events, with a deadline, and never for a time, which a load may exceed."""

import re
from pathlib import Path

import pytest

FILES = sorted(Path(__file__).parent.rglob("*.py"))
# Between two looks at what is waited for.
POLL_S = 0.05
# Between two scans that a test sends.
PACE_S = 0.3


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_live_tests_wait_for_events(path):
    text = path.read_text()
    assert all(float(s) <= POLL_S for s in re.findall(r"time\.sleep\(([\d.]+)\)", text))
    assert all(float(s) <= PACE_S for s in re.findall(r"\.pace\(([\d.]+)\)", text))
    # A wait for nothing but time.
    assert not re.findall(r"spin_until\(lambda: False", text.replace("lambda: False, seconds", ""))
