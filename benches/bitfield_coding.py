"""What coders make of the rows of a bake: share of the raw bits, and speed.

Rows are those of 258 octahedral views. `bitfield.encode` is beside deflate (what `np.savez_compressed` does) and LZMA
(XZ), each on packed rows in the input's order of faces and in Morton order of their centroids. A permuted row is of no
use without its permutation, so that one's bytes count: stored as differences, split into the four bytes of each,
by the same coder. Ratios are raw bits to coded bits; speeds are of raw bytes, on all cores for ours and on one
for the others.
"""

from __future__ import annotations

import lzma
import zlib
from collections.abc import Callable

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import bitfield, lab


def cameras(scene: cyc.Scene, level: int) -> list[cyc.Camera]:
    """A camera at each point of the octahedral sphere, at the distance at which the scene's ball just fits."""
    points, _ = cyc.sphere.octahedron(level)
    distance = scene.radius / np.sin(np.radians(45.0 / 2))
    return [cyc.Camera.look_at(scene.center + distance * p, scene.center, width=510, height=480) for p in points]


def permutation(order: np.ndarray) -> bytes:
    """An order as the bytes of its zigzag differences, lowest bytes first."""
    steps = np.diff(order.astype(np.int64), prepend=0)
    zigzag = np.where(steps < 0, -2 * steps - 1, 2 * steps).astype("<u4")
    return np.ascontiguousarray(zigzag.view(np.uint8).reshape(-1, 4).T).tobytes()


def timed(call: Callable[[], object], rounds: int) -> tuple[object, float]:
    """What a call gives, and the median of its seconds."""
    return call(), lab.medians({"call": call}, rounds, warm_up=0)["call"] / 1e3


def rows_of(name: str, bits: cyc.Bitfields, order: np.ndarray, rounds: int) -> list[dict[str, object]]:
    raw = len(bits) * bits.size / 8
    flags = bits.unpack()
    table = []

    def add(coder: str, stored: int, encode: float, decode: float, permuted: int = 0) -> None:
        table.append(
            {
                "rows": name,
                "coder": coder,
                "bytes": stored + permuted,
                "of them order": permuted,
                "ratio": round(raw / (stored + permuted), 2),
                "encode, MB/s": round(raw / encode / 1e6, 1),
                "decode, MB/s": round(raw / decode / 1e6, 1),
            }
        )

    coded, encode = timed(lambda: bitfield.encode(bits.words, bits.size), rounds)
    back, decode = timed(lambda: bitfield.decode(coded), rounds)
    assert back == bits
    add("bitfield.encode", sum(len(zlib.compress(a.tobytes())) for a in coded.values()), encode, decode)
    others = {"deflate": (zlib.compress, zlib.decompress), "LZMA": (lzma.compress, lzma.decompress)}
    for coder, (compress, decompress) in others.items():
        for kind, faces in (("input order", None), ("Morton order", order)):
            packed = np.packbits(flags if faces is None else flags[:, faces], axis=1, bitorder="little").tobytes()
            stored, encode = timed(lambda data=packed, compress=compress: compress(data), 1)
            _, decode = timed(lambda data=stored, decompress=decompress: decompress(data), rounds)
            extra = 0 if faces is None else len(compress(permutation(faces)))
            add(f"{coder}, {kind}", len(stored), encode, decode, extra)
    return table


def main() -> None:
    asked = bench.options(__doc__, scenes=["bunny", "brain_icbm152"], rounds=5)
    for name in asked.scenes[:1] if asked.quick else asked.scenes:
        scene = bench.scene(asked.meshes, name)
        views = cameras(scene, 2 if asked.quick else 3)
        order = bitfield.morton_order(scene.vertices[scene.faces].mean(axis=1))
        for fill in (None,) if asked.quick else ("rays", None):
            bits = scene.visible(views, fill=fill)
            table = rows_of(f"{name}, fill={fill}", bits, order, 1 if asked.quick else asked.rounds)
            bench.show(f"{len(views)} rows of {len(scene):,} faces of {name}, fill={fill!r}", table)


if __name__ == "__main__":
    main()
