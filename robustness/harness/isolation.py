"""The shipped profile that keeps Fast DDS on this machine, as the demo uses it."""

from __future__ import annotations

from pathlib import Path

from phd_jdtc_ros.resources import PROFILE_VARIABLES

PROFILE = Path(__file__).parents[2] / "config" / "dds" / "localhost_only.xml"
ISOLATED = dict.fromkeys(PROFILE_VARIABLES, str(PROFILE))
OPEN = dict.fromkeys(PROFILE_VARIABLES, "")
