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

"""What the package does under faults, measured on live nodes: ``make faults``, ``soak``, ``fuzz``.

Not part of the installed package. The way of a figure::

    rig         a ROS domain of its own: the nodes under test as processes, and
    radars      a peer beside them that publishes scans and hears what comes back
      |
    scans, bad_scans, stamps_and_time, overload, restarts    faults, on live nodes
    warm_restart, publishers
    bags, recordings, network                                files, disks, rogue peers
    soak, decoders, raw_bytes                                a day of scans; random input
      |
    figures -> report (table), out/<command>/summary.json

All traffic stays on this machine: loopback, or network namespaces that are made and removed here.
Every loop is bounded in count and time.
"""
