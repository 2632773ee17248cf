"""Errors that many steps share: no node carries them, they are added to the covariance of a solved walk."""

from __future__ import annotations

import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray


def walk_covariance(poses: FloatArray, config: GraphConfig) -> FloatArray:
    """(N, 3, 3) covariance of the errors that all steps of a walk share: its scale and its mount.

    They turn and stretch the walk about its start and nothing inside it can tell, a closed end included; they need no
    node of their own: with r = p - p_0, the scale moves p by r and the mount turns it by r⊥.
    """
    rx, ry = poses[:, 0] - poses[0, 0], poses[:, 1] - poses[0, 1]
    zeros, ones = np.zeros(len(poses)), np.ones(len(poses))
    scale = np.column_stack((rx, ry, zeros)) * config.sigma_length_scale
    mount = np.column_stack((-ry, rx, ones)) * config.sigma_mount_rad
    return np.asarray(np.einsum("ni,nj->nij", scale, scale) + np.einsum("ni,nj->nij", mount, mount))
