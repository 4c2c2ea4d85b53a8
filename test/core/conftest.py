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

import pytest

from phd_jdtc_ros.core import neighbours


@pytest.fixture(params=["numpy", "numba"])
def backend(request, monkeypatch):
    """Run a test with the plain and with the compiled kernels."""
    if request.param == "numba":
        pytest.importorskip("numba", reason="numba is optional: pip install '.[fast]'")
    monkeypatch.setattr(neighbours, "BACKEND", neighbours.backend(request.param))
