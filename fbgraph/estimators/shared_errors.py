"""Errors that many steps share: no node carries them, they are added to the covariance of a solved walk."""

from __future__ import annotations

import math

import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray


def walk_covariance(poses: FloatArray, sigma_turned_rad: FloatArray, config: GraphConfig) -> FloatArray:
    """(N, 3, 3) covariance of the errors that many steps of a walk share: its scale, and how the device was held.

    They turn and stretch the walk about the breadcrumb where they begin and nothing inside it can tell, a closed end
    included; they need no node of their own: with r = p - p_0, the scale moves p by r and the mount turns it by r⊥.

    Args:
        poses: (N, 3) x, y, yaw.
        sigma_turned_rad: (N,) how well is known what each step changed of how the device is held, as in ``Step``.
        config: the whole walk's.
    """
    x, y, ones = poses[:, 0], poses[:, 1], np.ones(len(poses))
    scale = np.column_stack((x - x[0], y - y[0], 0.0 * ones)) * config.sigma_length_scale
    covariance = np.einsum("ni,nj->nij", scale, scale)
    begins = sigma_turned_rad.copy()
    begins[0] = math.hypot(begins[0], config.sigma_mount_rad)
    for k in np.flatnonzero(begins).tolist():
        about = max(k - 1, 0)
        turned = np.column_stack((y[about] - y, x - x[about], ones))[k:] * begins[k]
        covariance[k:] += np.einsum("ni,nj->nij", turned, turned)
    return np.asarray(covariance)


def curvature_covariance(length_m: FloatArray, yaw_rad: FloatArray, var_yaw: FloatArray) -> FloatArray:
    """(N, 3, 3) covariance of what uncertain headings do to places beyond first order: they bend the walk inwards.

    A heading that is off by δ moves a step's end by (1 - cos δ) against its direction, whichever way it is off; the
    covariance of a linearised graph knows only sin δ, to the side. With δ normal, of variance v, and the same for
    neighbouring steps, E[(1 - cos δ)²] = 3/2 - 2 exp(-v/2) + exp(-2v)/2.

    Args:
        length_m: (N,) of the steps.
        yaw_rad: (N,) their headings.
        var_yaw: (N,) variance of the headings, rad².
    """
    short = np.sqrt(np.maximum(1.5 - 2.0 * np.exp(-0.5 * var_yaw) + 0.5 * np.exp(-2.0 * var_yaw), 0.0))
    bent = np.cumsum(np.column_stack((np.cos(yaw_rad), np.sin(yaw_rad))) * (length_m * short)[:, None], axis=0)
    moved = np.column_stack((bent, np.zeros(len(bent))))
    return np.asarray(np.einsum("ni,nj->nij", moved, moved))
