"""A short name for a mesh, by which a file knows the scene that it was made from."""

from __future__ import annotations

import hashlib

import numpy as np

from .scene import Scene

__all__ = ["fingerprint"]


def fingerprint(scene: Scene) -> str:
    """32 hexadecimal digits that depend on every vertex, every face, their order, and which faces are transparent.

    Examples
    --------
    >>> len(fingerprint(Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])))
    32
    """
    digest = hashlib.blake2b(digest_size=16)
    digest.update(np.asarray([len(scene.vertices), len(scene.faces)], dtype="<u8").tobytes())
    # `+ 0.0` makes -0.0 and 0.0, which are the same place, the same bytes.
    digest.update((scene.vertices.astype("<f8") + 0.0).tobytes())
    digest.update(scene.faces.astype("<u4").tobytes())
    if scene.transparent is not None and scene.transparent.any():
        digest.update(np.packbits(scene.transparent).tobytes())
    return digest.hexdigest()
