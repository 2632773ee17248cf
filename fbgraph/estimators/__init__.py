"""From steps to trajectories: dead reckoning, the EKF, the factor graph, batch and online."""
