"""Whether a walk may be believed: checks of what sensors, steps and estimators say against one another."""
