"""The evaluator node: compares estimates with the truth, and records them."""
