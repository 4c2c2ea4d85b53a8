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

"""The shipped profile that keeps Fast DDS on this machine, as the demo uses it."""

from __future__ import annotations

from pathlib import Path

from phd_jdtc_ros.tools.shipped import PROFILE_VARIABLES

PROFILE = Path(__file__).parents[1] / "config" / "dds" / "localhost_only.xml"
ISOLATED = dict.fromkeys(PROFILE_VARIABLES, str(PROFILE))
OPEN = dict.fromkeys(PROFILE_VARIABLES, "")
