"""Looking at runs: records read from bags, figures, reports."""
