"""Rows of a million faces: the union of three, its count, and its faces listed into an array that is there already.

Beside it NumPy: `np.bitwise_or.reduce`, and `np.unpackbits` with `np.flatnonzero`. A row is like a real one: faces
in runs, half of them seen.
"""

from __future__ import annotations

import numpy as np

import bench
from cyclorama import bitfield, lab


def main() -> None:
    asked = bench.options(__doc__, faces=1_000_000, rounds=25)
    rng = np.random.default_rng(0)
    flags = np.repeat(rng.random((3, asked.faces // 40 + 1)) < 0.2, 40, axis=1)[:, : asked.faces]
    words = bitfield.pack(np.ascontiguousarray(flags))
    joined = np.empty(words.shape[1], np.uint64)
    listed = np.empty(asked.faces, np.uint32)
    union = np.bitwise_or.reduce(words, axis=0)

    def numpy_list() -> np.ndarray:
        return np.flatnonzero(np.unpackbits(union.view(np.uint8), bitorder="little", count=asked.faces))

    jobs = {
        "union": (
            lambda: bitfield.union(words, [0, 1, 2], out=joined),
            lambda: np.bitwise_or.reduce(words, axis=0, out=joined),
        ),
        "count": (lambda: bitfield.count(union[None]), lambda: np.bitwise_count(union).sum()),
        "list with out=": (lambda: bitfield.ids(union, out=listed), numpy_list),
        "list": (lambda: bitfield.ids(union), numpy_list),
    }
    np.testing.assert_array_equal(bitfield.ids(union, out=listed), numpy_list())
    runs = [{"job": job, "by": by} for job in jobs for by in (0, 1)]

    def timed(job: str, by: int) -> object:
        call = jobs[job][by]
        return lambda: [call() for _ in range(20)]

    rows = lab.sweep(runs, timed=timed, rounds=5 if asked.quick else asked.rounds, errors="raise", progress=False)
    limits = {"union": 0.1, "list with out=": 1.0}
    table = []
    for ours, numpys in zip(rows[::2], rows[1::2], strict=True):
        job = ours["job"]
        limit = limits.get(job)
        table.append(
            {"job": job, "ours, ms": ours["time"] / 20e-3, "NumPy, ms": numpys["time"] / 20e-3, "asked, ms": limit}
        )
    seen = np.bitwise_count(union).sum()
    bench.show(f"3 rows of {asked.faces:,} faces, {seen:,} in their union; medians of interleaved rounds", table)


if __name__ == "__main__":
    main()
