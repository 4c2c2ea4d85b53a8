"""The pictures and tables of a Monte Carlo study: pure functions from its results.

`charts` lists the pictures and writes them; `over_time` and `over_lag` draw them, and `rows` has
the shared code of pictures over time. `summary_tables` makes the tables. The colours, lines and
markers are the same as in a single run's pictures.
"""

from .charts import write_all
from .summary_tables import markdown, tables

__all__ = ["markdown", "tables", "write_all"]
