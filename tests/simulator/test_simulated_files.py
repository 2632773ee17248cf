"""Simulated walks as files."""
