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

"""The tracker's mathematics: no ROS, no files, numpy and scipy only.

A scan's way through the core, with the module of each step::

    reports (radar, stamp, Detections)         types
      |  grouped by stamp                      scans
    Scan
      |  predict: survive, spawn, be born      prediction, motion, modes, spawn, birth
      |  update, radar by radar                filter, radar, gating, amplitude, signature
      |    one target an origin                correction, association, matching
      |    targets found by detections         detection_birth
    ParticlePHD, split into components         types
      |------------- targets ---------------> extraction -> Estimates (filtered)
      |  resample within (class, origin)       filter, resampling
    stored set t+1
      |  kernel from set t, cached             transition, partners,
      |                                        grids, neighbours
      |  backward over the lag window          smoother
    ParticlePHD at t, smoothed weights
      |------------- targets ---------------> extraction -> Estimates (smoothed)

`engine` runs these steps and is the only place that holds state (the last stored set and the random
generator in its filter, the lag window in its smoother, and the `track_numbers` in use). `config`
turns parameters into an engine. `simulation` makes scans with known truth, from a script that
`scenario` reads; `metrics` and `surveillance` compare with it, `scan_scores`, `run_totals` and
`evaluation` scan by scan and over a run. numba, where it is installed, compiles the inner loops of
`neighbours`, `grids` and `gating` (`neighbours_numba`); the results are the same but for rounding.

The method is that of Y. Qin, "Joint Target Detection, Tracking and Classification with
Forward-Backward PHD Smoothing". Sections cited in the docstrings are the paper's; wherever the
code departs from its text, the docstring says so under "Deviation".
"""
