"""The pictures and tables of a Monte Carlo study: pure functions from its results.

`charts` draws and writes the pictures, and makes the tables. The colours, lines and markers are the
same as in a single run's pictures.
"""

from .charts import markdown, tables, write_all

__all__ = ["markdown", "tables", "write_all"]
