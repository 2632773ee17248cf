"""Turns, legs, and the way back along them, after a walk and during one."""
