"""The shipped profile that keeps Fast DDS on this machine, as the demo uses it."""

from __future__ import annotations

from pathlib import Path

PROFILE = Path(__file__).parents[1] / "config" / "dds" / "localhost_only.xml"
# Fast DDS 2 and 3.
VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
ISOLATED = dict.fromkeys(VARIABLES, str(PROFILE))
OPEN = dict.fromkeys(VARIABLES, "")
