"""Coefficients of the step length by least squares, θ = (XᵀX)⁻¹ Xᵀ L (paper, section Parameter Selection).

A row of X is what the steps of one leg between known places say: of the paper one, their mean frequency and mean slope,
and L the leg's length over their number. With a prior, θ is what is likeliest after both.
"""

from __future__ import annotations

import numpy as np

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.step_length import FULL_SURGE_M_S, cadence_of
from fbgraph.front_end.step_track import StepTrack

TERMS = ("alpha_m", "beta_m_s", "beta2_m_s2", "gamma_m", "kappa_surge")
"""Keys of ``StepLengthConfig`` that are coefficients, in the order of ``step_terms``."""


def step_terms(track: StepTrack, config: StepLengthConfig) -> FloatArray:
    """(K, 5) what each step's length is made of: its product with the coefficients is ``length_m``.

    One, frequency, its square, slope and root of the surge, times the number of ordinary steps for which it stands.
    Steps that would be shorter than ``shortest_m`` count as they are without that bound.

    Args:
        track: K steps and the standing start before them.
        config: with which it was measured.
    """
    f = np.array([cadence_of(config, one) for one in track.frequency_hz[1:].tolist()])
    root = np.sqrt(np.minimum(track.surge_m_s[1:], FULL_SURGE_M_S))
    terms = np.column_stack((np.ones(len(f)), f, f**2, track.slope[1:], root))
    each_m = np.maximum(terms @ coefficients(config), config.shortest_m)
    return np.asarray(terms * (track.length_m[1:] / each_m)[:, None])


def coefficients(config: StepLengthConfig) -> FloatArray:
    """(5,) in the order of ``TERMS``."""
    return np.array([getattr(config, name) for name in TERMS])


def step_shares(track: StepTrack, start_s: float, end_s: float) -> FloatArray:
    """(K,) which part of each step lies between two times, 0 to 1."""
    begins, ends = track.start_s[1:], track.t_s[1:]
    inside_s = np.clip(np.minimum(ends, end_s) - np.maximum(begins, start_s), 0.0, None)
    return np.asarray(inside_s / (ends - begins))


def least_squares(
    rows: FloatArray, lengths: FloatArray, mean: FloatArray | None = None, precision_root: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Coefficients and their covariance where every row has an error of one.

    Args:
        rows: (S, N), each over the standard deviation of its length; (N,) coefficients are fitted.
        lengths: (S,) likewise.
        mean: (N,) what is known of them beforehand; nothing if None.
        precision_root: (M, N) P with PᵀP the inverse covariance of that.

    Returns:
        (N,) and (N, N).
    """
    if mean is not None and precision_root is not None:
        rows = np.vstack((rows, precision_root))
        lengths = np.concatenate((lengths, precision_root @ mean))
    fitted = np.linalg.lstsq(rows, lengths, rcond=None)[0]
    return np.asarray(fitted), np.asarray(np.linalg.pinv(rows.T @ rows, hermitian=True))
