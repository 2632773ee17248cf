"""Many logs smoothed as one is: which they are, what becomes of each, the index of all, and its report."""
