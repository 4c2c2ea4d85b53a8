"""The report as pictures in the style of the paper's figures."""
