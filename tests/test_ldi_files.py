"""Files of layered images: both kinds come back bit for bit, and other programs read them."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cyclorama import DepthImage, LayeredDepthImage
from peers import need
from test_ldi import camera_at, random_layers

KINDS = ["npz", "exr"]


@pytest.fixture(params=KINDS)
def kind(request):
    if request.param == "exr":
        need("OpenEXR")
    return request.param


def same(a, b):
    arrays = all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in ("offsets", "color", "disparity", "place")
    )
    return arrays and a.camera == b.camera and (a.normals is None) == (b.normals is None)


@given(seed=st.integers(0, 2**32 - 1), most=st.integers(0, 5), size=st.tuples(st.integers(1, 20), st.integers(1, 20)))
@settings(max_examples=20)
def test_what_is_written_is_read(kind, tmp_path, seed, most, size):
    rng = np.random.default_rng(seed)
    camera = camera_at(rng.normal(size=3), rng.normal(size=3), *size).replace(near=0.1)
    image = random_layers(rng, camera, most, lowest=1e-12, highest=1e3)
    image.save(tmp_path / f"view.{kind}")
    assert same(image, LayeredDepthImage.load(tmp_path / f"view.{kind}"))
    assert [path.name for path in tmp_path.iterdir()] == [f"view.{kind}"]


def test_normals_are_written_and_read(kind, tmp_path):
    plain = random_layers(np.random.default_rng(6), camera_at())
    words = np.random.default_rng(7).integers(0, 2**16, plain.samples)
    image = LayeredDepthImage(plain.camera, plain.offsets, plain.color, plain.disparity, plain.place, words)
    image.save(tmp_path / f"view.{kind}")
    back = LayeredDepthImage.load(tmp_path / f"view.{kind}")
    assert same(image, back) and not same(plain, back)
    np.testing.assert_array_equal(back.normals, words)


def test_plain_numpy_reads_the_samples(tmp_path):
    image = random_layers(np.random.default_rng(1), camera_at())
    image.save(tmp_path / "view.npz")
    with np.load(tmp_path / "view.npz", allow_pickle=False) as file:
        np.testing.assert_array_equal(file["disparity"], image.disparity)
        np.testing.assert_array_equal(file["offsets"], image.offsets)
        assert json.loads(str(file["header"]))["size"] == [image.camera.width, image.camera.height]


def test_openexr_reads_the_samples_of_each_pixel(tmp_path):
    OpenEXR = need("OpenEXR")
    image = random_layers(np.random.default_rng(2), camera_at())
    image.save(tmp_path / "view.exr")
    with OpenEXR.File(str(tmp_path / "view.exr"), separate_channels=True) as file:
        assert file.header()["type"] == OpenEXR.deepscanline
        channels = file.channels()
        assert set(channels) >= {"R", "G", "B", "A", "Z"}
        depth, red = channels["Z"].pixels, channels["R"].pixels
    for y, x in np.argwhere(image.counts > 0):
        first = image.offsets[y * image.camera.width + x]
        own = slice(first, first + image.counts[y, x])
        with np.errstate(divide="ignore"):
            np.testing.assert_allclose(depth[y, x], 1 / image.disparity[own], rtol=1e-6)
        assert np.all(np.diff(np.where(np.isinf(depth[y, x]), 1e30, depth[y, x])) >= 0)
        np.testing.assert_array_equal(np.rint(red[y, x].astype(float) * 255), image.color[own, 0])


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.95])
def test_files_that_are_cut_off_are_refused(kind, tmp_path, share):
    path = tmp_path / f"view.{kind}"
    random_layers(np.random.default_rng(3), camera_at()).save(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ValueError, match="is not a whole layered image"):
        LayeredDepthImage.load(path)


def test_files_of_something_else_are_refused(kind, tmp_path):
    path = tmp_path / f"view.{kind}"
    path.write_bytes(b"cyclorama" * 100)
    with pytest.raises(ValueError, match="is not a whole layered image"):
        LayeredDepthImage.load(path)
    if kind == "npz":
        DepthImage(np.zeros((2, 3, 3), np.uint8), np.ones((2, 3)), camera_at(width=3, height=2)).save(path)
    else:
        OpenEXR = need("OpenEXR")
        pixels = {"Z": np.ones((2, 3), np.float32)}
        with OpenEXR.File({"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}, pixels) as file:
            file.write(str(path))
    with pytest.raises(ValueError, match="is not a whole layered image"):
        LayeredDepthImage.load(path)


def test_other_endings_missing_files_and_folders_are_said(kind, tmp_path):
    image = random_layers(np.random.default_rng(4), camera_at())
    for call in (image.save, LayeredDepthImage.load):
        with pytest.raises(ValueError, match=r"must end in \.npz or \.exr"):
            call(tmp_path / "view.png")
    with pytest.raises(FileNotFoundError):
        LayeredDepthImage.load(tmp_path / f"none.{kind}")
    with pytest.raises(OSError, match="cannot write there"):
        image.save(tmp_path / "none" / f"view.{kind}")


def test_a_write_that_fails_leaves_what_was_there(kind, tmp_path, monkeypatch):
    path = tmp_path / f"view.{kind}"
    image = random_layers(np.random.default_rng(5), camera_at())
    image.save(path)
    before = path.read_bytes()

    def fail(*args, **kwargs):
        raise RuntimeError("no more")

    if kind == "npz":
        monkeypatch.setattr(np, "savez_compressed", fail)
    else:
        monkeypatch.setattr(need("OpenEXR").File, "write", fail)
    with pytest.raises(RuntimeError, match="no more"):
        image.save(path)
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == [path.name]
