"""What every room speaks of: errors, configuration, geometry, logs, places, trajectories."""
