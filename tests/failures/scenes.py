"""Scenes that several entries break."""

import numpy as np

import cyclorama as cyc


def fence():
    """Posts close before a wall: what is behind them changes with the eye."""
    wall = np.array([(-20, -8, -4), (20, -8, -4), (20, 8, -4), (-20, 8, -4)], float)
    post = np.array([(0, -4, -1), (0.15, -4, -1), (0.15, 4, -1), (0, 4, -1)])
    quads = np.stack([wall, *(post + [x, 0, 0] for x in np.arange(-6, 6.1, 0.5))])
    corners = np.arange(4 * len(quads)).reshape(-1, 4)
    return cyc.Scene(quads.reshape(-1, 3), corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3))
