"""Cameras from and to the files of other programs."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama.camera_files import (
    pose,
    read_colmap,
    read_gltf,
    read_transforms,
    write_colmap,
    write_gltf,
    write_transforms,
)
from peers import need

WRITE_AND_READ = {
    "colmap": (write_colmap, read_colmap, ""),
    "nerfstudio": (write_transforms, read_transforms, "transforms.json"),
    "gltf": (write_gltf, read_gltf, "cameras.gltf"),
}

coordinate = st.floats(-100, 100)
place = st.tuples(coordinate, coordinate, coordinate)


@st.composite
def looks(draw):
    eye, target = np.array(draw(place)), np.array(draw(place))
    if np.linalg.norm(target - eye) < 1e-3:
        target = eye + [0, 0, 1]
    size = draw(st.integers(1, 2000)), draw(st.integers(1, 2000))
    return cyc.Camera.look_at(eye, target, (0, 1, 0), draw(st.floats(1, 150)), *size)


def same(a, b):
    np.testing.assert_allclose(a.K, b.K, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.world_to_camera, b.world_to_camera, atol=1e-9)
    assert (a.width, a.height) == (b.width, b.height)


@pytest.mark.parametrize("kind", WRITE_AND_READ)
@settings(max_examples=30)
@given(cameras=st.lists(looks(), max_size=4))
def test_what_is_written_is_read_again(kind, cameras, tmp_path_factory):
    write, read, name = WRITE_AND_READ[kind]
    path = tmp_path_factory.mktemp(kind) / name
    named = {f"{i}.png": camera for i, camera in enumerate(cameras)}
    write(path, named)
    back = read(path)
    assert list(back) == list(named)
    for key, camera in named.items():
        same(back[key], camera)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3))
def test_rotations_are_those_of_scipy(quaternion):
    rotations = need("scipy.spatial.transform").Rotation
    matrix = pose.rotation(np.array(quaternion))
    theirs = rotations.from_quat(quaternion, scalar_first=True)
    np.testing.assert_allclose(matrix, theirs.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(pose.rotation(pose.quaternion(matrix)), matrix, atol=1e-12)


@pytest.mark.parametrize(
    ("number", "model", "lens"),
    [
        (2, "SIMPLE_RADIAL", [50, 31, 23, 0]),
        (3, "RADIAL", [50, 31, 23, 0, 0]),
        (4, "OPENCV", [50, 51, 31, 23, 0, 0, 0, 0]),
    ],
)
def test_colmap_models_with_distortion_are_read_where_it_is_zero(tmp_path, number, model, lens):
    def files(parameters):
        text = f"8 {model} 64 48 " + " ".join(map(str, parameters))
        (tmp_path / "text").mkdir(exist_ok=True)
        (tmp_path / "text" / "cameras.txt").write_text(text + "\n")
        (tmp_path / "text" / "images.txt").write_text("1 1 0 0 0 0 0 4 8 a.png\n\n")
        (tmp_path / "binary").mkdir(exist_ok=True)
        packed = struct.pack(f"<QiiQQ{len(lens)}d", 1, 8, number, 64, 48, *parameters)
        (tmp_path / "binary" / "cameras.bin").write_bytes(packed)
        image = struct.pack("<Qi7di", 1, 1, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0, 8) + b"a.png\0" + struct.pack("<Q", 0)
        (tmp_path / "binary" / "images.bin").write_bytes(image)
        return [tmp_path / kind for kind in ("text", "binary")]

    for folder in files(lens):
        camera = read_colmap(folder)["a.png"]
        np.testing.assert_array_equal(camera.K, [[50, 0, 31], [0, lens[1] if model == "OPENCV" else 50, 23], [0, 0, 1]])
    for folder in files([*lens[:-1], 0.1]):
        with pytest.raises(ValueError, match=f"camera 8 is {model}, which has distortion .*0.1"):
            read_colmap(folder)


def test_a_binary_colmap_model_is_read_as_its_format_says(tmp_path):
    camera = struct.pack("<Q", 2) + struct.pack("<iiQQ3d", 7, 0, 640, 480, 500.0, 320.0, 240.0)
    camera += struct.pack("<iiQQ4d", 8, 1, 64, 48, 50.0, 51.0, 31.0, 23.0)
    half = np.sqrt(0.5)
    image = struct.pack("<Q", 2)
    image += struct.pack("<i7di", 1, half, 0.0, half, 0.0, 1.0, 2.0, 3.0, 7) + b"a b.png\0"
    image += struct.pack("<Q", 2) + bytes(48)
    image += struct.pack("<i7di", 2, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 8) + b"c.png\0" + struct.pack("<Q", 0)
    (tmp_path / "cameras.bin").write_bytes(camera)
    (tmp_path / "images.bin").write_bytes(image)
    cameras = read_colmap(tmp_path)
    assert list(cameras) == ["a b.png", "c.png"]
    turned = cameras["a b.png"]
    np.testing.assert_allclose(turned.world_to_camera[:3, :3] @ [0, 0, 1], [1, 0, 0], atol=1e-12)  # 90 degrees about y
    np.testing.assert_allclose(turned.world_to_camera[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(cameras["c.png"].K, [[50, 0, 31], [0, 51, 23], [0, 0, 1]])
    (tmp_path / "images.bin").write_bytes(image[:-20])
    with pytest.raises(ValueError, match=r"images\.bin: not a readable COLMAP file, or cut off"):
        read_colmap(tmp_path)


def test_colmap_text_with_points_and_comments(tmp_path):
    (tmp_path / "cameras.txt").write_text("# a comment\n1 SIMPLE_PINHOLE 640 480 500 320 240\n")
    (tmp_path / "images.txt").write_text(
        "# a comment\n1 1 0 0 0 0 0 4 1 a.png\n10 20 -1 30 40 5\n2 1 0 0 0 0 0 5 1 b.png\n\n"
    )
    cameras = read_colmap(tmp_path)
    assert [camera.eye[2] for camera in cameras.values()] == [-4, -5]


def test_a_gltf_camera_is_where_trimesh_puts_its_node(tmp_path):
    trimesh = need("trimesh")
    scene = trimesh.Scene(trimesh.creation.box())
    scene.graph.update("arm", matrix=trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [3, 2, 1]))
    scene.graph.update("head", "arm", matrix=trimesh.transformations.translation_matrix([4, 5, 6]))
    raw = bytearray(scene.export(file_type="glb"))
    size = int.from_bytes(raw[12:16], "little")
    tree = json.loads(raw[20 : 20 + size])
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 1.5, "znear": 0.1}}]
    next(node for node in tree["nodes"] if node["name"] == "head")["camera"] = 0
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text + bytes(raw[20 + size :])
    (tmp_path / "scene.glb").write_bytes(b"glTF\2\0\0\0" + (12 + len(body)).to_bytes(4, "little") + body)
    camera = read_gltf(tmp_path / "scene.glb", height=100)["head"]
    placed = scene.graph["head"][0]
    np.testing.assert_allclose(camera.eye, placed[:3, 3], atol=1e-6)
    np.testing.assert_allclose(camera.forward, -placed[:3, 2], atol=1e-6)
    assert (camera.width, camera.height) == (150, 100) and camera.fov_y == pytest.approx(np.degrees(1.0))


def test_transforms_take_an_angle_for_a_focal_length_and_what_is_common_to_all(tmp_path):
    turn = np.diag([1.0, 1.0, 1.0, 1.0])
    turn[:3, 3] = [1, 2, 3]
    whole = {
        "camera_angle_x": np.pi / 2,
        "w": 200,
        "h": 100,
        "frames": [{"file_path": "a", "transform_matrix": turn.tolist()}],
    }
    (tmp_path / "t.json").write_text(json.dumps(whole))
    camera = read_transforms(tmp_path / "t.json")["a"]
    np.testing.assert_allclose(camera.K, [[100, 0, 100], [0, 100, 50], [0, 0, 1]])
    np.testing.assert_allclose(camera.eye, [1, 2, 3])
    np.testing.assert_allclose(camera.forward, [0, 0, -1], atol=1e-12)


def test_what_such_files_cannot_say_or_we_cannot_do_is_refused(tmp_path):
    parallel = {"a": cyc.Camera.orthographic_look_at([0, 0, 5], [0, 0, 0])}
    for kind, (write, _, name) in WRITE_AND_READ.items():
        with pytest.raises(ValueError, match="'a' is orthographic"):
            write(tmp_path / kind / name if kind == "colmap" else tmp_path / name, parallel)
    beside = cyc.Camera([[100, 0, 40], [0, 100, 24], [0, 0, 1]], np.eye(4), 64, 48)
    with pytest.raises(ValueError, match="looks beside the middle"):
        write_gltf(tmp_path / "b.gltf", {"b": beside})
    for kind, (write, _, name) in WRITE_AND_READ.items():
        with pytest.raises(ValueError, match="cameras must be named by text, got 1"):
            write(tmp_path / kind / name, {1: beside})
    with pytest.raises(ValueError, match=r"b\.glb must end in \.gltf"):
        write_gltf(tmp_path / "b.glb", {})
    with pytest.raises(ValueError, match="is no name for an image"):
        write_colmap(tmp_path, {"a b": beside})
    (tmp_path / "cameras.txt").write_text("1 OPENCV 64 48 50 50 32 24 0.1 0 0 0\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 4 1 a.png\n\n")
    with pytest.raises(ValueError, match=r"cameras\.txt.*OPENCV, which has distortion"):
        read_colmap(tmp_path)
    frame = {"file_path": "a", "transform_matrix": np.eye(4).tolist(), "w": 64, "h": 48, "fl_x": 50}
    for change, message in [({"k1": 0.1}, r"frames\[0\].*distortion \(k1\)"), ({"w": None}, r"frames\[0\]")]:
        (tmp_path / "t.json").write_text(json.dumps({"frames": [frame | change]}))
        with pytest.raises(ValueError, match=message):
            read_transforms(tmp_path / "t.json")
    (tmp_path / "t.json").write_text('{"frames": [')
    with pytest.raises(ValueError, match="not JSON, or cut off"):
        read_transforms(tmp_path / "t.json")
    with pytest.raises(FileNotFoundError, match=r"neither cameras\.bin"):
        read_colmap(tmp_path / "nowhere")


def test_two_cameras_of_one_name_are_not_mistaken_for_one(tmp_path):
    frame = {"file_path": "a", "transform_matrix": np.eye(4).tolist(), "w": 64, "h": 48, "fl_x": 50}
    (tmp_path / "t.json").write_text(json.dumps({"frames": [frame, frame]}))
    with pytest.raises(ValueError, match=r"frames\[1\]: another camera is named 'a', too"):
        read_transforms(tmp_path / "t.json")
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 64 48 50 32 24\n")
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 4 1 a.png\n\n2 1 0 0 0 0 0 5 1 a.png\n\n")
    with pytest.raises(ValueError, match=r"images\.txt: image a\.png: another camera"):
        read_colmap(tmp_path)
    # Names of nodes are for people: two may have the same.
    lens = {"type": "perspective", "perspective": {"yfov": 1.0}}
    nodes = [{"name": "a", "camera": 0, "translation": [k, 0, 0]} for k in range(2)]
    (tmp_path / "t.gltf").write_text(json.dumps({"asset": {}, "cameras": [lens], "nodes": nodes}))
    assert {name: camera.eye[0] for name, camera in read_gltf(tmp_path / "t.gltf").items()} == {"a": 0, "1": 1}


@pytest.mark.parametrize(
    "nodes, message",
    [
        ([{"camera": 0, "children": [1]}, {"children": [0]}], r"nodes\[0\]: its parents form a cycle, 0 in 1 in 0"),
        ([{"camera": 0, "children": [0]}], r"nodes\[0\]: its parents form a cycle, 0 in 0"),
        ([{"camera": 0}, 7], "nodes must be a list of objects"),
        ({"camera": 0}, "nodes must be a list of objects"),
        ([{"camera": 0, "children": 3}], "children of nodes must be lists of numbers"),
        ([{"camera": 5}], r"nodes\[0\]"),
        ([{"camera": 0, "scale": [0, 0, 0]}], r"nodes\[0\]"),
        ([{"camera": 0, "rotation": [0, 0, 0, 0]}], r"nodes\[0\].*no rotation"),
    ],
)
def test_nodes_that_are_no_tree_are_refused(nodes, message, tmp_path):
    lens = {"type": "perspective", "perspective": {"yfov": 1.0}}
    (tmp_path / "t.gltf").write_text(json.dumps({"asset": {}, "cameras": [lens], "nodes": nodes}))
    with pytest.raises(ValueError, match=message):
        read_gltf(tmp_path / "t.gltf")


def test_what_is_wrong_with_a_camera_is_said_with_its_name(tmp_path):
    (tmp_path / "t.json").write_text('{"frames": [5]}')
    with pytest.raises(ValueError, match=r"frames\[0\]: it must be an object, got 5"):
        read_transforms(tmp_path / "t.json")
    (tmp_path / "cameras.txt").write_text("1 SIMPLE_PINHOLE 64 48 50 32 24\n")
    (tmp_path / "images.txt").write_text("1 0 0 0 0 0 0 4 1 a.png\n\n")
    with pytest.raises(ValueError, match=r"images\.txt: image a\.png: .*no rotation"):
        read_colmap(tmp_path)
    (tmp_path / "cameras.txt").write_text("1 OPENCV 64 48 50 50 32 24 0.1 0 0 0\n")
    with pytest.raises(ValueError, match=r"cameras\.txt: camera 1 is OPENCV"):
        read_colmap(tmp_path)
    camera = cyc.Camera.look_at([0, 0, 5], [0, 0, 0])
    for kind, (write, _, name) in WRITE_AND_READ.items():
        path = tmp_path / kind / name if kind == "colmap" else tmp_path / name
        with pytest.raises(ValueError, match="a mapping from names to cameras, got a list"):
            write(path, [camera])
        with pytest.raises(ValueError, match=r"cameras\['a'\] must be a Camera, got a str"):
            write(path, {"a": "camera"})
