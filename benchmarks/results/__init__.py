"""The summary: goals and whether they are reached, tables and pictures, and the machine."""
