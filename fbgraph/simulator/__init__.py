"""Walks that nobody walked: routes, gait, sensors with their errors, exact truth."""
