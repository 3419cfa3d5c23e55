"""Files of bakes: whole or refused, and of the mesh they say."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.bakes import storage


@functools.cache
def scene() -> cyc.Scene:
    return cyc.scenes.gear(faces=1500, teeth=20)


@functools.cache
def bake(patches: int | None = None, join: str = "cells", distances: tuple[float, ...] = (1.0,)) -> cyc.Visibility:
    return cyc.bake(
        scene(), 18, patches, (64, 60), join=join, probes=4, distances=distances, progress=False, max_missed=None
    )


@pytest.mark.parametrize(
    ("patches", "join", "distances"),
    [(None, "cells", (1.0,)), (40, "cells", (1.0,)), (None, "samples", (1.0,)), (40, "samples", (1.0, 2.0, np.inf))],
)
def test_what_is_loaded_is_what_was_saved(tmp_path: Path, patches: int | None, join: str, distances: tuple[float, ...]):
    vis = bake(patches, join, distances)
    vis.save(tmp_path / "bake.npz")
    back = cyc.Visibility.load(tmp_path / "bake.npz")
    assert [p.name for p in tmp_path.iterdir()] == ["bake.npz"]
    assert back.info() == vis.info()
    for a, b in zip(vis.shells, back.shells, strict=True):
        assert a.distance == b.distance and a.bitfields == b.bitfields and a.cells == b.cells
    for name in ("labels", "probes", "found"):
        np.testing.assert_array_equal(getattr(back, name), getattr(vis, name))
    np.testing.assert_array_equal(back.sphere.points, vis.sphere.points)
    for share in (0.2, 0.7, 1.0, 3.0):
        eye = vis.sphere.center + share * vis.sphere.radius * np.array([0.6, 0.0, 0.8])
        np.testing.assert_array_equal(back.visible_faces(eye), vis.visible_faces(eye))
    back.check(scene())


def test_plain_numpy_opens_the_file_without_pickle(tmp_path: Path):
    bake().save(tmp_path / "bake.npz")
    with np.load(tmp_path / "bake.npz", allow_pickle=False) as file:
        assert {"header", "points", "sphere_faces", "rows_stream"} <= set(file)
        assert all(file[name].dtype != object for name in file)


def test_a_file_of_another_mesh_is_refused():
    vis = bake()
    moved = scene().vertices.copy()
    moved[0, 0] = np.nextafter(moved[0, 0], np.inf)
    with pytest.raises(ValueError, match="another mesh"):
        vis.check(cyc.Scene(moved, scene().faces))
    with pytest.raises(ValueError, match="another mesh"):
        vis.check(cyc.Scene(scene().vertices, scene().faces[::-1]))
    with pytest.raises(ValueError, match="faces"):
        vis.check(cyc.scenes.sphere(faces=80))


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_refused(tmp_path: Path, share: float):
    bake().save(tmp_path / "bake.npz")
    whole = (tmp_path / "bake.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=r"cut\.npz is not a whole visibility file"):
        cyc.Visibility.load(tmp_path / "cut.npz")


def test_a_mesh_is_said_to_be_no_archive(tmp_path):
    for text in ("v 0 0 0\n", ""):
        path = tmp_path / "one.obj"
        path.write_text(text)
        with pytest.raises(ValueError, match=r"one\.obj is not a whole visibility file: it is no \.npz archive"):
            cyc.Visibility.load(path)


def test_a_damaged_file_is_refused_or_unchanged(tmp_path: Path):
    bake().save(tmp_path / "bake.npz")
    whole = bytearray((tmp_path / "bake.npz").read_bytes())
    rng = np.random.default_rng(0)
    for at in rng.integers(len(whole), size=40):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << rng.integers(8)
        (tmp_path / "bad.npz").write_bytes(damaged)
        try:
            back = cyc.Visibility.load(tmp_path / "bad.npz")
        except ValueError:
            continue
        assert back.bitfields == bake().bitfields and back.cells == bake().cells


@pytest.mark.parametrize("name", ["labels", "probes", "points"])
def test_a_file_whose_parts_do_not_fit_is_refused(tmp_path: Path, name: str):
    cyc.bake(cyc.scenes.sphere(faces=320), 6, 9, (32, 32), probes=1, progress=False).save(tmp_path / "bake.npz")
    with np.load(tmp_path / "bake.npz") as file:
        parts = dict(file)
    for wrong in (parts[name][:-1], parts[name] + 1000 if name == "labels" else parts[name][None]):
        np.savez(tmp_path / "bad.npz", **{**parts, name: wrong})
        with pytest.raises(ValueError, match="not a whole visibility file"):
            cyc.Visibility.load(tmp_path / "bad.npz")


def test_an_unknown_compression_is_refused(tmp_path: Path):
    bake().save(tmp_path / "bake.npz")
    damaged = bytearray((tmp_path / "bake.npz").read_bytes())
    damaged[damaged.index(b"PK\x01\x02") + 10] = 99
    (tmp_path / "bad.npz").write_bytes(damaged)
    with pytest.raises(ValueError, match="not a whole visibility file"):
        cyc.Visibility.load(tmp_path / "bad.npz")


def test_a_foreign_file_is_refused(tmp_path: Path):
    (tmp_path / "text.npz").write_text("not an archive")
    np.savez(tmp_path / "other.npz", points=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    np.savez(tmp_path / "pickle.npz", header=np.array([{}], dtype=object))
    np.savez(tmp_path / "newer.npz", header=np.array('{"format": "cyclorama visibility 9"}'))
    for name in ("text.npz", "other.npz", "array.npy", "pickle.npz", "newer.npz"):
        with pytest.raises(ValueError, match="not a whole visibility file"):
            cyc.Visibility.load(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        cyc.Visibility.load(tmp_path / "missing.npz")


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(OSError, match="cannot write"):
        bake().save(tmp_path / "no folder" / "bake.npz")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="cannot write"):
        bake().save(tmp_path / "file" / "bake.npz")
    (tmp_path / "bake.npz").write_text("what was there before")

    def interrupted(file: object, **members: object) -> None:
        file.write(b"half")  # type: ignore[attr-defined]
        raise KeyboardInterrupt

    monkeypatch.setattr(storage.np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        bake().save(tmp_path / "bake.npz")
    assert (tmp_path / "bake.npz").read_text() == "what was there before"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bake.npz", "file"]
