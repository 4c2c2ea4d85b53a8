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

"""``python -m robustness faults | soak | fuzz``."""

import os
import sys

from .isolation import ISOLATED

# Before anything imports rclpy: the shipped profile keeps this process and its children on this
# machine, and they leave no shared memory behind where they are killed. With LOCALHOST for a range
# as well, a restarted node would be heard seconds later.
os.environ.update(ISOLATED)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
os.environ["OMP_NUM_THREADS"] = "1"

from .command import main

sys.exit(main(sys.argv[1:]))
