"""Answers about faces, opened by the programs that they are for."""

import itertools
import json
import struct

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import exchange, testing
from cyclorama.parts import Part
from peers import need

CAMERA = cyc.Camera.look_at((2, 3, 4), (0, 0, 0), width=64, height=48)


@pytest.fixture(scope="module")
def ball():
    whole = cyc.scenes.sphere(320)
    parts = [Part("cap", "ball/cap", 0, 100), Part("rest", "ball/rest", 100, len(whole))]
    return cyc.Scene(whole.vertices, whole.faces, parts=parts)


@pytest.fixture(scope="module")
def seen(ball):
    return ball.visible(CAMERA)


def test_masks_are_the_same_from_faces_flags_and_rows(ball, seen):
    mask = exchange.face_mask(ball, seen)
    assert 0 < mask.sum() < len(ball)
    np.testing.assert_array_equal(np.flatnonzero(mask), seen.ids(0))
    for other in (seen.ids(0), mask, mask.tolist()):
        np.testing.assert_array_equal(exchange.face_mask(ball, other), mask)
    assert not exchange.face_mask(ball, []).any()


def test_trimesh_selects_and_colours_by_the_mask(ball, seen):
    need("trimesh")
    mesh = exchange.to_trimesh(ball, seen)
    mask = mesh.face_attributes["seen"]
    assert len(mesh.submesh([mask], append=True).faces) == len(seen.ids(0))
    assert {tuple(color[:3]) for color in mesh.visual.face_colors[~mask].tolist()} == {exchange.NEVER_SEEN}


def test_open3d_selects_and_colours_by_the_mask(ball, seen):
    need("open3d")
    mesh = exchange.to_open3d(ball, seen)
    shown = mesh.select_faces_by_mask(mesh.triangle["seen"])
    assert len(shown.triangle.indices) == len(seen.ids(0))
    hidden = ~mesh.triangle["seen"].numpy()
    np.testing.assert_allclose(mesh.triangle["colors"].numpy()[hidden] * 255, [exchange.NEVER_SEEN] * hidden.sum())


def test_pyvista_selects_and_colours_by_the_mask(ball, seen):
    need("pyvista")
    mesh = exchange.to_pyvista(ball, seen)
    assert mesh.extract_cells(mesh.cell_data["seen"]).n_cells == len(seen.ids(0))
    assert (mesh.cell_data["colors"][~mesh.cell_data["seen"]] == exchange.NEVER_SEEN).all()


def chunks(path):
    content = path.read_bytes()
    (length,) = struct.unpack("<I", content[12:16])
    return json.loads(content[20 : 20 + length])


def test_gltf_has_parts_as_nodes_and_what_is_seen_as_materials(ball, seen, tmp_path):
    trimesh = need("trimesh")
    path = tmp_path / "ball.glb"
    exchange.save_gltf(ball, path, seen)
    mask, expected = exchange.face_mask(ball, seen), {}
    for part in ball.parts:
        own = mask[part.start : part.stop]
        expected |= {f"{part.path} seen": int(own.sum()), f"{part.path} never seen": int((~own).sum())}
    expected = {name: count for name, count in expected.items() if count}
    found = trimesh.load(path)
    assert {name: len(mesh.faces) for name, mesh in found.geometry.items()} == expected
    for name, mesh in found.geometry.items():
        assert mesh.visual.material.name == ("never seen" if name.endswith("never seen") else "seen")
    written = chunks(path)
    assert {node["name"] for node in written["nodes"]} >= {"ball/cap", "ball/rest"}
    extras = [mesh["extras"] for mesh in written["meshes"]]
    assert {(entry["part"], entry["seen"], entry["faces"]) for entry in extras} == {
        (name.removesuffix(" never seen").removesuffix(" seen"), not name.endswith("never seen"), count)
        for name, count in expected.items()
    }
    again = cyc.load(path)
    assert len(again) == len(ball)
    assert sum(len(part) for part in again.parts if part.name.endswith("never seen")) == (~mask).sum()


def test_gltf_with_patches_is_read_by_open3d_and_pyvista(ball, seen, tmp_path):
    open3d, pyvista = need("open3d"), need("pyvista")
    path = tmp_path / "patches.glb"
    exchange.save_gltf(ball, path, seen, labels=np.arange(len(ball)) // 80)
    names = {node["name"] for node in chunks(path)["nodes"]}
    assert {f"patch {k}" for k in range(4)} <= names
    assert len(open3d.io.read_triangle_mesh(str(path)).triangles) == len(ball)
    assert pyvista.read(path).combine().n_cells == len(ball)


class Elsewhere:
    """An array of another library: nothing but DLPack."""

    def __init__(self, array):
        self._array = np.asarray(array)

    def __dlpack__(self, **options):
        return self._array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self._array.__dlpack_device__()


def test_arrays_come_in_by_dlpack(ball):
    scene = cyc.Scene(Elsewhere(ball.vertices), Elsewhere(ball.faces.astype(np.int64)))
    np.testing.assert_array_equal(scene.vertices, ball.vertices)
    camera = cyc.Camera(Elsewhere(CAMERA.K), Elsewhere(CAMERA.world_to_camera), 64, 48)
    assert camera == CAMERA
    view = scene.render(camera)
    image = cyc.DepthImage(Elsewhere(view.color), Elsewhere(view.depth), camera, ids=Elsewhere(view.ids))
    np.testing.assert_array_equal(image.depth, view.depth)
    np.testing.assert_array_equal(image.ids, view.ids)


def test_warps_layers_and_assertions_take_arrays_by_dlpack(ball):
    aside = cyc.Camera.look_at((0.2, 0, 4), (0, 0, 0), width=64, height=48)
    view = ball.render(CAMERA)
    np.testing.assert_array_equal(
        cyc.warp.map(CAMERA, aside, Elsewhere(np.minimum(view.depth, 9))),
        cyc.warp.map(CAMERA, aside, np.minimum(view.depth, 9)),
    )
    image = ball.depth_image(CAMERA)
    behind = np.full((48, 64, 3), 7, np.uint8)
    warped = cyc.warp.forward(image, aside, background=Elsewhere(behind))
    np.testing.assert_array_equal(warped.color, cyc.warp.forward(image, aside, background=behind).color)
    built = cyc.LayeredDepthImage.build(image, [])
    again = cyc.LayeredDepthImage(
        CAMERA, *(Elsewhere(a) for a in (built.offsets.astype(np.int64), built.color, built.disparity, built.place))
    )
    np.testing.assert_array_equal(again.warp(aside).color, built.warp(aside).color)
    assert cyc.quality.psnr(Elsewhere(warped.color), Elsewhere(warped.color)) == np.inf
    testing.assert_ids_match(ball, CAMERA, Elsewhere(view.ids))
    testing.assert_depth_matches(ball, CAMERA, Elsewhere(view.depth))
    testing.assert_warp_matches(image, aside, Elsewhere(cyc.warp.forward(image, aside).color))


def test_open3d_s_tensors_come_in_and_answers_go_out_without_a_copy(ball):
    open3d = need("open3d")
    points = open3d.core.Tensor(np.asarray(ball.vertices, np.float32))
    scene = cyc.Scene(points, open3d.core.Tensor(ball.faces.astype(np.int64)))
    view = scene.render(CAMERA)
    out = np.from_dlpack(view.depth)
    assert np.shares_memory(out, view.depth)
    there = open3d.core.Tensor.from_dlpack(view.depth.__dlpack__())
    np.testing.assert_array_equal(there.numpy(), view.depth)


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ([320], r"seen\[0\] is 320, the scene has 320 faces"),
        (np.zeros(3, bool), "a flag a face"),
        ([0.5], "integers"),
        (cyc.Bitfields.zeros(1, 40), "are they of patches"),
    ],
)
def test_what_is_no_set_of_faces_is_refused(ball, bad, says):
    with pytest.raises(ValueError, match=says):
        exchange.face_mask(ball, bad)


def test_another_ending_is_refused(ball, tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.glb"):
        exchange.save_gltf(ball, tmp_path / "ball.obj", [])


def test_parts_may_have_any_names(tmp_path):
    need("trimesh")
    ball = cyc.scenes.sphere(80)
    for names in (("x", "x seen"), ("a/b", "a/b"), ("a", "a 2", "a"), ("world", "")):
        ends = np.linspace(0, len(ball), len(names) + 1).astype(int).tolist()
        parts = [Part(name, name, *pair) for name, pair in zip(names, itertools.pairwise(ends), strict=True)]
        scene = cyc.Scene(ball.vertices, ball.faces, parts=parts)
        exchange.save_gltf(scene, tmp_path / "ball.glb", scene.visible(CAMERA))
        again = cyc.load(tmp_path / "ball.glb")
        assert len(again) == len(ball)
        # Each mesh is below the node of its part.
        above = {part.path.removesuffix(f"/{part.name}") for part in again.parts}
        assert len(above) == len(names) and all(part.path != part.name for part in again.parts)


def test_what_is_no_colour_is_refused(ball, seen, tmp_path):
    need("trimesh")
    for colors in (((1, 2), (3, 4)), ((300, 2, 3), (3, 4, 5)), "x", ((1, 2, 3),)):
        with pytest.raises(ValueError, match="colors must be"):
            exchange.to_trimesh(ball, seen, colors=colors)
        with pytest.raises(ValueError, match="colors must be"):
            exchange.save_gltf(ball, tmp_path / "ball.glb", seen, colors=colors)
