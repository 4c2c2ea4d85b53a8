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

"""The pictures and tables of a Monte Carlo study: pure functions from its results.

`charts` lists the pictures and writes them; `over_time` and `over_lag` draw them, `rows` has what
pictures over time share. `summary_tables` has the tables. Colours, lines and markers are those of
a single run's pictures.
"""

from .charts import write_all
from .summary_tables import markdown, tables

__all__ = ["markdown", "tables", "write_all"]
