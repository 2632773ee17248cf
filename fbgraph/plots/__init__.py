"""Figures of runs, fit for a paper. With the study's figures the only room with matplotlib."""
