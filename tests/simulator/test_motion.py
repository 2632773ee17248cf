"""The simulated motion: a walker, and a device that moves with him."""
