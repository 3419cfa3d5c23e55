"""Faces that nobody ever sees, parts of scenes, and files without what is hidden."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama.bitfield import Bitfields
from cyclorama.parts import Part
from peers import need


def assembly(trimesh):
    """A crate with a ball in it that nobody sees, two bolts that are one mesh, and a lamp on an arm."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((2, 2, 2)), node_name="crate", geom_name="crate")
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    scene.add_geometry(ball, node_name="ball", geom_name="ball", parent_node_name="crate")
    bolt = trimesh.creation.cylinder(radius=0.1, height=0.6, sections=12)
    bolt.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(name="steel", baseColorFactor=[90, 90, 100, 255])
    )
    here = trimesh.transformations.translation_matrix
    scene.add_geometry(bolt, node_name="bolt 1", geom_name="bolt", parent_node_name="crate", transform=here([0, 0, 1]))
    scene.graph.update("bolt 2", "crate", matrix=here([0.5, 0, 1]), geometry="bolt")
    scene.graph.update("arm", "crate", matrix=here([0, 3, 0]))
    scene.add_geometry(trimesh.creation.box(), node_name="lamp", geom_name="lamp", parent_node_name="arm")
    return scene


@pytest.fixture
def files(tmp_path):
    trimesh = need("trimesh")
    source = tmp_path / "in.glb"
    assembly(trimesh).export(source)
    return source, tmp_path / "out.glb"


def test_nodes_of_a_file_are_parts_with_their_paths(files):
    scene = cyc.load(files[0])
    sizes = {part.path: len(part) for part in scene.parts}
    assert sizes == {"crate": 12, "crate/ball": 320, "crate/bolt 1": 48, "crate/bolt 2": 48, "crate/arm/lamp": 12}
    lamp = next(part for part in scene.parts if part.name == "lamp")
    assert scene.vertices[scene.faces[lamp.start : lamp.stop]].reshape(-1, 3).mean(axis=0) == pytest.approx([0, 3, 0])


def test_a_file_without_nodes_is_one_part_of_its_name(tmp_path):
    need("trimesh").creation.box().export(tmp_path / "crate.ply")
    assert cyc.load(tmp_path / "crate.ply").parts == (Part("crate", "crate", 0, 12),)


@given(st.lists(st.integers(0, 6), min_size=1, max_size=8), st.data())
def test_parts_count_as_numpy_does(sizes, data):
    ends = np.cumsum(sizes).tolist()
    parts = [Part(str(i), str(i), end - size, end) for i, (size, end) in enumerate(zip(sizes, ends, strict=True))]
    faces = data.draw(st.sets(st.integers(0, ends[-1] - 1))) if ends[-1] else set()
    owner = np.repeat(np.arange(len(sizes)), sizes)
    expected = np.bincount(owner[sorted(faces)], minlength=len(sizes))
    np.testing.assert_array_equal(cyc.parts.count(parts, list(faces)), expected)
    assert cyc.parts.seen(parts, list(faces)) == [parts[i] for i in np.flatnonzero(expected)]
    rows = cyc.parts.table(parts, Bitfields.from_ids([sorted(faces), []], ends[-1]))
    assert [row["seen"] for row in rows] == expected.tolist()
    assert [row["best"] for row in rows] == [0 if n else None for n in expected]


def test_parts_that_overlap_or_leave_faces_out_are_refused():
    mesh = (np.eye(3), [[0, 1, 2]] * 3)
    with pytest.raises(ValueError, match=r"parts\[1\] is faces 0 to 3; it must begin at face 1"):
        cyc.Scene(*mesh, parts=[Part("a", "a", 0, 1), Part("b", "b", 0, 3)])
    with pytest.raises(ValueError, match="parts end at face 2, the scene has 3"):
        cyc.Scene(*mesh, parts=[Part("a", "a", 0, 2)])
    with pytest.raises(ValueError, match="face 7 is in none of the parts"):
        cyc.parts.count([Part("a", "a", 0, 2)], [0, 7])


def test_what_is_inside_is_never_seen_and_what_is_outside_is():
    boxes = cyc.scenes.nested_boxes(3)
    found = cyc.never_seen(boxes, max_missed=0.05, progress=False)
    outermost = np.abs(boxes.vertices[boxes.faces]).max(axis=(1, 2)) == np.abs(boxes.vertices).max()
    np.testing.assert_array_equal(found.seen, outermost)
    assert found.missed == 0 and found.bound <= 0.05


def test_from_inside_only_the_inner_side_counts():
    boxes = cyc.scenes.nested_boxes(3)
    inner = np.abs(boxes.vertices).max(axis=1).min() * 0.9
    found = cyc.never_seen(boxes, inside=([-inner] * 3, [inner] * 3), max_missed=0.05, progress=False)
    innermost = np.abs(boxes.vertices[boxes.faces]).max(axis=(1, 2)) == np.abs(boxes.vertices).max(axis=1).min()
    np.testing.assert_array_equal(found.seen, innermost)


def test_too_few_views_say_so():
    found = cyc.never_seen(cyc.scenes.tree(faces=2000), max_missed=1e-3, max_views=100, progress=False)
    assert found.views == 100 and found.bound > 1e-3


def test_a_stripped_file_keeps_nodes_materials_and_instances(files):
    trimesh = need("trimesh")
    source, out = files
    done = cyc.strip_hidden(source, out, max_missed=0.03, progress=False)
    before, after = (trimesh.load(path, process=False) for path in files)
    assert sorted(after.graph.nodes) == sorted(before.graph.nodes)
    for node in before.graph.nodes:
        np.testing.assert_allclose(after.graph[node][0], before.graph[node][0], atol=1e-12)
        assert after.graph.transforms.parents.get(node) == before.graph.transforms.parents.get(node)
    assert after.graph["ball"][1] is None, "nobody sees the ball"
    assert after.graph["bolt 1"][1] == after.graph["bolt 2"][1], "one mesh for both bolts"
    assert after.geometry[after.graph["bolt 1"][1]].visual.material.name == "steel"
    scene = cyc.load(out)
    assert len(scene) == done.kept < len(cyc.load(source)) - 320
    by_part = {row["part"]: row for row in done.parts}
    assert by_part["crate/ball"]["kept"] == 0 and by_part["crate"]["kept"] == 12
    assert by_part["crate/bolt 1"]["kept"] == by_part["crate/bolt 2"]["kept"] < 48


def test_pictures_of_a_stripped_file_are_those_of_the_whole(files):
    source, out = files
    done = cyc.strip_hidden(source, out, max_missed=0.03, progress=False)
    whole, stripped = cyc.load(source), cyc.load(out)
    rng = np.random.default_rng(5)
    lost = []
    for _ in range(20):
        eye = whole.center + (lambda d: 3 * whole.radius * d / np.linalg.norm(d))(rng.normal(size=3))
        camera = cyc.Camera.look_at(eye, whole.center, width=160, height=120)
        lost.append((whole.render(camera).depth != stripped.render(camera).depth).mean())
    assert np.mean(lost) <= done.hidden.bound


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"max_missed": 0}, "max_missed must be a share between 0 and 1, got 0"),
        ({"max_missed": "a"}, "max_missed must be from 0 to 1, got 'a'"),
        ({"max_views": 0}, "max_views must be an integer of at least 1, got 0"),
        ({"max_views": 2.5}, "max_views must be an integer of at least 1, got 2.5"),
        ({"seed": -1}, "seed must be an integer of at least 0, got -1"),
        ({"inside": [0, 0, 0]}, "inside must be two corners"),
        ({"inside": ([1, 0, 0], [0, 1, 1])}, r"low\[0\] is 1.0, above high\[0\], 0.0"),
    ],
)
def test_bad_questions_are_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        cyc.never_seen(cyc.scenes.sphere(faces=80), progress=False, **kwargs)


def test_few_views_are_enough_where_much_may_be_lost():
    found = cyc.never_seen(cyc.scenes.sphere(faces=80), max_missed=0.2, resolution=(64, 60), progress=False)
    assert found.bound <= 0.2


def test_the_file_itself_and_unknown_formats_are_not_written(files, tmp_path):
    source, _ = files
    before = source.read_bytes()
    with pytest.raises(ValueError, match="is the file that is read"):
        cyc.strip_hidden(source, source, max_missed=0.05)
    with pytest.raises(ValueError, match=r"trimesh does not write \.xyzw"):
        cyc.strip_hidden(source, tmp_path / "out.xyzw", max_missed=0.05, progress=False)
    with pytest.raises(ValueError, match=r"out\.gltf: \.gltf is several files; \.glb has the same in one"):
        cyc.strip_hidden(source, tmp_path / "out.gltf", max_missed=0.05, progress=False)
    assert source.read_bytes() == before and not list(tmp_path.glob("out.*"))


def test_the_command_says_what_it_did(files, capsys):
    from cyclorama.cli import main

    source, out = files
    assert main(["strip", str(source), str(out), "--max-missed", "0.03", "--quiet"]) == 0
    said = capsys.readouterr().out
    assert "4 of 5 have faces left" in said and "never seen         crate/ball" in said
    assert main(["strip", str(source), str(out), "--inside", "1,2"]) == 2
