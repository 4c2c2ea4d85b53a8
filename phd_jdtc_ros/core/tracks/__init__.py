"""From the targets of a filter to tracks: labels, numbers, confirmation and what is reported."""
