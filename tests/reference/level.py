"""The compiled level whose potentially visible sets bound what any eye in it may see (IBSP version 46)."""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt

import cyclorama as cyc

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

# Surface flags: nothing is drawn there, and rays end.
_SKY, _NODRAW = 0x4, 0x80
_TEXTURES, _VERTICES, _MESHVERTS, _FACES = 1, 10, 11, 13


class Level:
    """The level's faces, and behind them, in `scene`, its sky and what is not drawn, which stop rays too."""

    def __init__(self, folder: Path) -> None:
        with np.load(folder / "q3_20kdm2_pvs.npz") as file:
            self._arrays = {name: file[name] for name in file.files}
        arrays = self._arrays
        self.vertices, self.faces = arrays["vertices"], arrays["faces"].astype(np.uint32)
        count = int(arrays["n_clusters"])
        self._sees = np.unpackbits(arrays["pvs_bits"], axis=1, bitorder="little")[:, :count].astype(bool)
        self._holds = np.zeros((count, len(self.faces)), bool)
        for leaf in np.flatnonzero(arrays["leaf_cluster"] >= 0):
            start = arrays["leaf_face_start"][leaf]
            listed = arrays["leaf_faces"][start : start + arrays["leaf_face_count"][leaf]]
            self._holds[arrays["leaf_cluster"][leaf]] |= np.isin(arrays["tri_bspface"], listed)
        packed = folder / "q3_20kdm2.bsp.zst"
        corners = _unseen(packed) if shutil.which("zstd") else np.empty((0, 3, 3))
        vertices = np.concatenate([self.vertices, corners.reshape(-1, 3)])
        more = np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3) + len(self.vertices)
        self.scene = cyc.Scene(vertices, np.concatenate([self.faces, more]))

    def clusters(self, low: Floats, high: Floats) -> set[int]:
        """The clusters that a box touches; -1 is solid."""
        arrays, found, nodes = self._arrays, set(), [0]
        center, half = (low + high) / 2, (high - low) / 2
        while nodes:
            node = nodes.pop()
            if node < 0:
                found.add(int(arrays["leaf_cluster"][-node - 1]))
                continue
            plane = arrays["planes"][arrays["node_plane"][node]].astype(np.float64)
            distance, reach = center @ plane[:3] - plane[3], half @ np.abs(plane[:3])
            front, back = arrays["node_children"][node]
            if distance >= -reach:
                nodes.append(int(front))
            if distance <= reach:
                nodes.append(int(back))
        return found

    def bound(self, clusters: set[int]) -> Flags:
        """The faces that any eye in some clusters may see."""
        rows = self._sees[sorted(clusters - {-1})].any(axis=0)
        return np.asarray(self._holds[rows].any(axis=0))

    def crosses_solid(self, start: Floats, end: Floats) -> bool:
        """Whether a segment goes through something solid, drawn or not, before its last thousandth."""
        arrays = self._arrays
        parts = [(0, 0.0, 1.0)]
        while parts:
            node, near, far = parts.pop()
            if node < 0:
                if arrays["leaf_cluster"][-node - 1] < 0 and near < 0.999 and far - near > 1e-3:
                    return True
                continue
            plane = arrays["planes"][arrays["node_plane"][node]].astype(np.float64)
            a, b = (start + t * (end - start) for t in (near, far))
            height, depth = a @ plane[:3] - plane[3], b @ plane[:3] - plane[3]
            front, back = arrays["node_children"][node].tolist()
            if (height >= 0) == (depth >= 0):
                parts.append((front if height >= 0 else back, near, far))
                continue
            at = near + (far - near) * height / (height - depth)
            first, second = (front, back) if height >= 0 else (back, front)
            parts += [(first, near, at), (second, at, far)]
        return False

    def boxes(self, count: int, seed: int, half: tuple[float, float] = (16, 64)) -> list[tuple[Floats, Floats]]:
        """Boxes in the open, anywhere in the level."""
        rng = np.random.default_rng(seed)
        arrays, boxes = self._arrays, []
        leaves = np.flatnonzero(arrays["leaf_cluster"] >= 0)
        while len(boxes) < count:
            leaf = rng.choice(leaves)
            center = rng.uniform(arrays["leaf_min"][leaf], arrays["leaf_max"][leaf])
            sides = rng.uniform(*half, 3)
            if -1 not in self.clusters(center - sides, center + sides):
                boxes.append((center - sides, center + sides))
        return boxes


def _unseen(path: Path) -> Floats:
    """(T, 3, 3) corners of the triangles that are sky or not drawn."""
    content = subprocess.run(["zstd", "-dc", str(path)], check=True, capture_output=True).stdout

    def lump(index: int, dtype: npt.DTypeLike, width: int) -> npt.NDArray[np.generic]:
        offset, size = struct.unpack_from("<ii", content, 8 + 8 * index)
        return np.frombuffer(content, dtype, size // np.dtype(dtype).itemsize, offset).reshape(-1, width)

    flags = lump(_TEXTURES, np.int32, 18)[:, 16]
    points = lump(_VERTICES, np.float32, 11)[:, :3].astype(np.float64)
    corners = lump(_MESHVERTS, np.int32, 1)[:, 0]
    triangles = []
    for texture, _, kind, first, _, start, size in lump(_FACES, np.int32, 26)[:, :7].astype(int):
        if flags[texture] & (_SKY | _NODRAW) and kind in (1, 3):
            triangles.append(points[first + corners[start : start + size]].reshape(-1, 3, 3))
    return np.concatenate(triangles)
