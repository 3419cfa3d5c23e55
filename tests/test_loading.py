"""Loading against trimesh, Open3D and PyVista, and against files written here byte by byte."""

import json
import struct
import subprocess
import sys
from base64 import b64encode

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import cyclorama as cyc
from cyclorama.loading import describe, load

TETRAHEDRON = (
    np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
)
RED, GREEN, BLUE, WHITE = [255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]

# Faces, vertices, welded, components, watertight, boundary, non-manifold, degenerate, duplicate: the data's own table.
TABLE = {
    "bunny.ply": (69451, 34834, 34834, 1, False, 223, 0, 0, 0),
    "horse.ply": (96966, 48485, 48485, 1, True, 0, 0, 0, 0),
    "brain_icbm152.ply": (163840, 81924, 81924, 2, True, 0, 0, 0, 0),
    "igea.ply": (268686, 134345, 134345, 1, True, 0, 0, 0, 0),
    "dragon_100k.ply": (100000, 50000, 50000, 1, True, 0, 0, 0, 0),
    "scorpion.ply": (99990, 49997, 49997, 1, True, 0, 0, 0, 0),
    "x_wing.ply": (25873, 48375, 13317, 83, False, 751, 262, 6, 31),
    "legocar.obj": (10992, 12358, 5915, 249, True, 0, 0, 112, 68),
    "engine_2cylinder.ply": (121496, 84657, 60039, 85, False, 13308, 1, 11160, 0),
    "sibenik.ply": (80479, 79596, 40835, 329, False, 8357, 935, 3830, 565),
    "fzk_haus.ply": (34330, 25045, 17093, 342, False, 693, 1130, 0, 204),
    "q3_20kdm2.ply": (10332, 15762, 6170, 214, False, 3004, 351, 91, 21),
    "kitchen.ply": (56939, 81714, 33365, 760, False, 8273, 335, 25, 15),
    "tree.ply": (8345, 8409, 7704, 796, False, 5577, 0, 0, 0),
    "bamboo_truss.ply": (18304, 16805, 15624, 382, False, 12978, 160, 0, 128),
    "tray_plate.stl": (4520, 13560, 2216, 1, True, 0, 0, 0, 0),
    "chair_duplicated_faces.obj": (12756, 11250, 3158, 3, False, 0, 9518, 0, 6382),
}


@pytest.mark.parametrize("name", TABLE)
def test_the_real_meshes_are_what_their_table_says(data, name):
    about = describe(load(data / name))
    keys = "faces vertices welded components watertight boundary nonmanifold degenerate duplicate".split()
    assert tuple(about[key] for key in keys) == TABLE[name]


@pytest.mark.parametrize("name", ["bunny.ply", "x_wing.ply", "tray_plate.stl"])
def test_vertices_and_faces_are_those_of_trimesh(data, name):
    mesh = trimesh.load(data / name, process=False)
    scene = load(data / name)
    np.testing.assert_array_equal(scene.vertices, mesh.vertices)
    np.testing.assert_array_equal(scene.faces, mesh.faces)


@pytest.mark.parametrize("name", ["legocar.obj", "chair_duplicated_faces.obj"])
def test_the_parts_of_a_scene_are_joined_as_trimesh_joins_them(data, name):
    mesh = trimesh.load(data / name, process=False).to_geometry()
    scene = load(data / name)
    np.testing.assert_array_equal(scene.vertices[scene.faces], mesh.triangles)


# Arrays and precision -------------------------------------------------------------------------------------------------


def test_arrays_come_back_as_given():
    for dtype in (np.float32, np.float64):
        scene = load((TETRAHEDRON[0].astype(dtype), TETRAHEDRON[1].astype(np.int16)))
        assert scene.vertices.dtype == dtype
        np.testing.assert_array_equal(scene.faces, TETRAHEDRON[1])


def test_a_scene_passes_through():
    scene = cyc.Scene(*TETRAHEDRON)
    assert load(scene) is scene


def test_what_is_no_mesh_is_refused_by_its_type():
    with pytest.raises(TypeError, match=r"builtins\.int"):
        load(3)
    with pytest.raises(TypeError, match="pair"):
        load((TETRAHEDRON[0],))


def _double_ply(vertices, faces):
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = b"".join(struct.pack("<B3i", 3, *face) for face in faces)
    return head.encode() + np.asarray(vertices, dtype="<f8").tobytes() + rows


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(-1e8, 1e8), min_size=3, max_size=3),
    st.floats(-30, 30).map(lambda power: 10.0**power),
)
def test_places_far_from_zero_and_tiny_sizes_lose_nothing(tmp_path_factory, offset, scale):
    vertices = (TETRAHEDRON[0] + 1 / 3) * scale + np.array(offset) * scale
    path = tmp_path_factory.mktemp("far") / "far.ply"
    path.write_bytes(_double_ply(vertices, TETRAHEDRON[1]))
    scene = load(path)
    assert scene.vertices.dtype == np.float64
    np.testing.assert_array_equal(scene.vertices, vertices)


@pytest.mark.parametrize("kind", ["obj", "off"])
def test_text_files_keep_all_digits(tmp_path, kind):
    vertices = np.random.default_rng(4).uniform(size=(4, 3)) + 12345.0
    rows = "\n".join(("v " if kind == "obj" else "") + " ".join(map(repr, row)) for row in vertices.tolist())
    shift, mark = (1, "f") if kind == "obj" else (0, "3")
    faces = "\n".join(f"{mark} {a + shift} {b + shift} {c + shift}" for a, b, c in TETRAHEDRON[1])
    path = tmp_path / f"m.{kind}"
    path.write_text(f"{'' if kind == 'obj' else 'OFF 4 4 0'}\n{rows}\n{faces}\n")
    scene = load(path)
    np.testing.assert_array_equal(scene.vertices[scene.faces], vertices[TETRAHEDRON[1]])


# Files ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["ply", "obj", "stl", "glb", "gltf", "off"])
def test_every_format_brings_the_same_triangles(tmp_path, kind):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / f"m.{kind}"
    if kind == "gltf":
        for name, content in mesh.scene().export(file_type="gltf").items():
            (tmp_path / name).write_bytes(content)
        path = tmp_path / "model.gltf"
    else:
        mesh.export(path)
    scene = load(path)
    np.testing.assert_allclose(scene.vertices[scene.faces], mesh.triangles, atol=1e-6)
    assert describe(scene)["watertight"]


def test_polygons_are_cut_into_triangles(tmp_path):
    house = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (0, 0, 1)]  # a pentagon of area 3
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in house)
    ply = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    ply += f"element face 2\nproperty list uchar int vertex_indices\nend_header\n{rows}5 0 1 2 3 4\n3 0 1 5\n"
    obj = "".join(f"v {x} {y} {z}\n" for x, y, z in house) + "f 1 2 3 4 5\nf 1 2 6\n"
    for name, text in {"p.ply": ply, "p.obj": obj, "p.off": f"OFF\n6 2 0\n{rows}5 0 1 2 3 4\n3 0 1 5\n"}.items():
        (tmp_path / name).write_text(text)
        scene = load(tmp_path / name)
        assert len(scene) == 4
        assert trimesh.Trimesh(scene.vertices, scene.faces).area == pytest.approx(3.0 + 1.0)


def test_off_colours_and_comments(tmp_path):
    text = "COFF # a comment\n\n4 4 6\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n0 0 1 255 255 255 255\n"
    (tmp_path / "c.off").write_text(text + "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n")
    np.testing.assert_array_equal(load(tmp_path / "c.off").colors, [RED, GREEN, BLUE, WHITE])
    (tmp_path / "f.off").write_text("OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 1.0 0 0\n3 0 2 1 0 0 1.0\n")
    scene = load(tmp_path / "f.off")
    np.testing.assert_array_equal(scene.colors, [RED, RED, BLUE])
    (tmp_path / "bent.off").write_text("OFF\n4 1 0\n0 0 0\n2 0 0\n0.2 0.2 0\n0 2 0\n4 1 2 3 0\n")
    with pytest.raises(ValueError, match=r"bent\.off.*polygon 0 is not convex"):
        load(tmp_path / "bent.off")


def test_scene_graphs_are_flattened_with_their_instances(tmp_path):
    part = trimesh.creation.box()
    graph = trimesh.Scene()
    graph.add_geometry(part, node_name="a", geom_name="box")
    move = trimesh.transformations.translation_matrix([10.0, 0.0, 0.0])
    mirror = np.diag([-2.0, 1.0, 1.0, 1.0])
    graph.graph.update(frame_to="b", matrix=move, geometry="box")
    graph.graph.update(frame_to="c", frame_from="b", matrix=mirror, geometry="box")
    graph.export(tmp_path / "s.glb")
    for scene in (load(graph), load(tmp_path / "s.glb")):
        assert len(scene) == 36
        np.testing.assert_allclose(scene.bounds, [[-0.5, -0.5, -0.5], [11.0, 0.5, 0.5]])
        copies = [trimesh.Trimesh(scene.vertices, scene.faces[i : i + 12]).volume for i in (0, 12, 24)]
        assert sorted(copies) == pytest.approx([1.0, 1.0, 2.0])  # the mirrored one still faces outward


# Colours --------------------------------------------------------------------------------------------------------------

# A checkerboard of 2 x 2 texels, as stored from the top row; and four triangles, each with its centroid in a texel and
# its first corner in another.
CHECKER = np.array([[RED, GREEN], [BLUE, WHITE]], dtype=np.uint8)
CHECKED = {(0.25, 0.75): RED, (0.75, 0.75): GREEN, (0.25, 0.25): BLUE, (0.75, 0.25): WHITE}


def _textured_obj(folder):
    Image.fromarray(np.kron(CHECKER, np.ones((4, 4, 1), dtype=np.uint8))).save(folder / "checker.png")
    (folder / "m.mtl").write_text("newmtl paint\nKd 1 1 1\nmap_Kd checker.png\n")
    lines, faces = ["mtllib m.mtl", "usemtl paint"], []
    for index, (u, v) in enumerate(CHECKED):
        for corner, (du, dv) in enumerate([(-0.3, 0.0), (0.15, -0.2), (0.15, 0.2)]):
            lines += [f"v {index + du} {dv} 0", f"vt {u + du} {v + dv}"]
            faces.append(3 * index + corner + 1)
    lines += ["f " + " ".join(f"{i}/{i}" for i in faces[at : at + 3]) for at in range(0, 12, 3)]
    (folder / "m.obj").write_text("\n".join(lines) + "\n")
    return folder / "m.obj"


def test_textures_become_face_colours(tmp_path):
    path = _textured_obj(tmp_path)
    scene = load(path)
    assert scene.vertices.shape == (12, 3)
    np.testing.assert_array_equal(scene.colors, list(CHECKED.values()))
    trimesh.load(path, process=False).export(tmp_path / "m.glb")
    np.testing.assert_array_equal(load(tmp_path / "m.glb").colors, list(CHECKED.values()))


def test_open3d_textures_become_the_same_face_colours(tmp_path):
    open3d = pytest.importorskip("open3d")
    path = _textured_obj(tmp_path)
    legacy = open3d.io.read_triangle_mesh(str(path))
    np.testing.assert_array_equal(load(legacy).colors, list(CHECKED.values()))
    np.testing.assert_array_equal(load(open3d.t.io.read_triangle_mesh(str(path))).colors, list(CHECKED.values()))


def test_texture_coordinates_repeat(tmp_path):
    path = _textured_obj(tmp_path)
    words = [line.split() for line in path.read_text().splitlines()]
    moved = [f"vt {float(w[1]) + 3} {float(w[2]) - 2}" if w[0] == "vt" else " ".join(w) for w in words]
    path.write_text("\n".join(moved))
    np.testing.assert_array_equal(load(path).colors, list(CHECKED.values()))


def test_vertex_colours_stay_on_vertices_and_mix_with_others(tmp_path):
    colored = trimesh.Trimesh(*TETRAHEDRON, process=False)
    colored.visual.vertex_colors = np.array([RED, GREEN, BLUE, WHITE])
    colored.export(tmp_path / "v.ply")
    np.testing.assert_array_equal(load(tmp_path / "v.ply").colors, [RED, GREEN, BLUE, WHITE])
    plain = trimesh.creation.box()
    both = load(trimesh.Scene([colored, plain]))
    assert both.colors.shape == (12, 3)
    np.testing.assert_array_equal(both.colors[4:], np.full((8, 3), 200))


def test_face_colours_where_a_mesh_has_as_many_vertices_as_faces():
    mesh = trimesh.Trimesh(*TETRAHEDRON, process=False)
    mesh.visual.face_colors = np.array([RED, GREEN, BLUE, WHITE])
    scene = load(mesh)
    assert scene.vertices.shape == (5, 3)
    np.testing.assert_array_equal(scene.colors, [RED, GREEN, BLUE, WHITE])


def test_base_colours_and_blending_of_materials(tmp_path):
    graph = trimesh.Scene()
    for name, alpha, mode in (("solid", 255, None), ("glass", 80, "BLEND")):
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=[10, 200, 30, alpha], alphaMode=mode)
        box = trimesh.creation.box()
        box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=material)
        graph.add_geometry(box, node_name=name, geom_name=name)
    graph.export(tmp_path / "m.glb")
    scene = load(tmp_path / "m.glb")
    np.testing.assert_array_equal(scene.colors, np.tile([10, 200, 30], (24, 1)))
    assert scene.transparent is not None
    assert sorted([scene.transparent[:12].all(), scene.transparent[12:].all()]) == [False, True]


def test_vertex_colours_beside_a_material_are_multiplied_by_its_base_colour(tmp_path):
    positions = TETRAHEDRON[0].astype("<f4").tobytes()
    paint = (np.array([RED, GREEN, BLUE, WHITE]) / 255).astype("<f4").tobytes()
    indices = TETRAHEDRON[1].astype("<u2").tobytes()
    blob = positions + paint + indices
    views = [(0, 48), (48, 48), (96, 24)]
    kinds = [(5126, 4, "VEC3"), (5126, 4, "VEC3"), (5123, 12, "SCALAR")]
    document = {
        "asset": {"version": "2.0"},
        "buffers": [
            {"uri": "data:application/octet-stream;base64," + b64encode(blob).decode(), "byteLength": len(blob)}
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": size} for start, size in views],
        "accessors": [
            {"bufferView": i, "componentType": kind, "count": count, "type": shape}
            for i, (kind, count, shape) in enumerate(kinds)
        ],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.2, 1.0, 1.0]}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}]}],
        "nodes": [{"mesh": 0, "translation": [0.0, 0.0, 5.0]}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    (tmp_path / "c.gltf").write_text(json.dumps(document))
    scene = load(tmp_path / "c.gltf")
    np.testing.assert_array_equal(scene.vertices, TETRAHEDRON[0] + [[0, 0, 5]])
    np.testing.assert_array_equal(scene.colors, [RED, [0, 51, 0], BLUE, [255, 51, 255]])


def test_obj_materials_without_a_texture(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\nd 0.5\n")
    rows = "".join(f"v {x} {y} {z}\n" for x, y, z in TETRAHEDRON[0])
    (tmp_path / "m.obj").write_text(f"mtllib m.mtl\n{rows}usemtl a\nf 1 3 2\nf 1 2 4\nusemtl b\nf 2 3 4\nf 1 4 3\n")
    scene = load(tmp_path / "m.obj")
    slanted = (scene.vertices[scene.faces] != 0).any(axis=1).all(axis=1)  # the first face of material b
    assert np.flatnonzero(slanted).size == 1
    glass = (scene.colors == BLUE).all(axis=1)
    np.testing.assert_array_equal(scene.colors[~glass], [RED, RED])
    np.testing.assert_array_equal(scene.transparent, glass)
    assert glass.sum() == 2 and glass[slanted].all()


# Other libraries' meshes ----------------------------------------------------------------------------------------------


def test_open3d_meshes_legacy_and_tensor():
    open3d = pytest.importorskip("open3d")
    legacy = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(TETRAHEDRON[0]), open3d.utility.Vector3iVector(TETRAHEDRON[1])
    )
    assert load(legacy).colors is None
    legacy.vertex_colors = open3d.utility.Vector3dVector(np.array([RED, GREEN, BLUE, WHITE]) / 255)
    tensor = open3d.t.geometry.TriangleMesh.from_legacy(legacy)
    for scene in (load(legacy), load(tensor)):
        np.testing.assert_array_equal(scene.vertices, TETRAHEDRON[0])
        np.testing.assert_array_equal(scene.faces, TETRAHEDRON[1])
        np.testing.assert_array_equal(scene.colors, [RED, GREEN, BLUE, WHITE])
    with pytest.raises(ValueError, match="no triangles"):
        load(open3d.t.geometry.TriangleMesh())


def test_pyvista_surfaces_with_polygons_and_colours():
    pyvista = pytest.importorskip("pyvista")
    sphere = pyvista.Sphere()
    scene = load(sphere)
    np.testing.assert_array_equal(scene.vertices, sphere.points)
    np.testing.assert_array_equal(scene.faces, sphere.faces.reshape(-1, 4)[:, 1:])
    cube = pyvista.Cube()  # six quadrilaterals
    cube.cell_data["RGB"] = np.array([RED, GREEN, BLUE, WHITE, RED, GREEN], dtype=np.uint8)
    scene = load(cube)
    assert len(scene) == 12
    assert trimesh.Trimesh(scene.vertices, scene.faces).volume == pytest.approx(1.0)
    np.testing.assert_array_equal(scene.colors, np.repeat([RED, GREEN, BLUE, WHITE, RED, GREEN], 2, axis=0))


def test_pyvista_cells_are_counted_past_loose_points_and_lines():
    pyvista = pytest.importorskip("pyvista")
    mesh = pyvista.PolyData(TETRAHEDRON[0], faces=[3, 0, 2, 1, 3, 0, 1, 3], lines=[2, 0, 1, 2, 1, 2], verts=[1, 0])
    mesh.cell_data["RGB"] = np.array([WHITE, WHITE, WHITE, RED, BLUE], dtype=np.uint8)
    np.testing.assert_array_equal(load(mesh).colors, [RED, BLUE])


def test_pyvista_volumes_and_blocks_are_refused():
    pyvista = pytest.importorskip("pyvista")
    for mesh in (
        pyvista.Sphere().cast_to_unstructured_grid(),
        pyvista.MultiBlock([pyvista.Sphere()]),
        pyvista.ImageData(),
    ):
        with pytest.raises(ValueError, match="extract_surface"):
            load(mesh)
    with pytest.raises(ValueError, match="not convex"):
        load(pyvista.PolyData([[0, 0, 0], [2, 0, 0], [0.2, 0.2, 0], [0, 2, 0]], faces=[4, 1, 2, 3, 0]))
    with pytest.raises(ValueError, match="strips"):
        load(pyvista.Sphere().strip())


def test_no_mesh_library_is_imported_for_arrays_and_objects():
    code = "import sys, cyclorama, numpy; cyclorama.load((numpy.eye(3), [[0, 1, 2]]));"
    code += "print([name for name in ('trimesh', 'open3d', 'pyvista', 'scipy') if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


def test_a_missing_trimesh_is_said(tmp_path, monkeypatch):
    trimesh.creation.box().export(tmp_path / "m.ply")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(ImportError, match=r"pip install cyclorama\[mesh\]"):
        load(tmp_path / "m.ply")


# Bad files ------------------------------------------------------------------------------------------------------------


def test_missing_and_foreign_files(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.ply"):
        load(tmp_path / "nothing.ply")
    with pytest.raises(ValueError, match="folder"):
        load(tmp_path)
    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(ValueError, match=r"a\.txt: \.txt is not one of"):
        load(str(tmp_path / "a.txt"))
    noise = np.random.default_rng(0).bytes(4000)
    for kind in ("ply", "obj", "stl", "glb", "gltf", "off"):
        for content in (noise, b"", b"\x89PNG\r\n\x1a\n" + noise):
            path = tmp_path / f"foreign.{kind}"
            path.write_bytes(content)
            with pytest.raises(ValueError, match=rf"foreign\.{kind}: "):
                load(path)


@pytest.mark.parametrize("kind", ["ply", "ascii ply", "stl", "glb", "off"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.7, 0.95])
def test_files_cut_off_are_refused(tmp_path, kind, share):
    mesh, path = trimesh.creation.icosphere(subdivisions=2), tmp_path / f"cut.{kind[-3:]}"
    whole = mesh.export(file_type=path.suffix[1:], **({"encoding": "ascii"} if "ascii" in kind else {}))
    whole = whole.encode() if isinstance(whole, str) else whole
    path.write_bytes(whole)
    assert len(load(path)) == len(mesh.faces)
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=rf"cut\.{kind[-3:]}: "):
        load(path)


@pytest.mark.parametrize("kind", ["ply", "off"])
def test_text_files_that_end_after_a_whole_face_are_refused(tmp_path, kind):
    mesh, path = trimesh.creation.icosphere(subdivisions=1), tmp_path / f"short.{kind}"
    whole = mesh.export(file_type=kind, **({"encoding": "ascii"} if kind == "ply" else {}))
    whole = whole.decode() if isinstance(whole, bytes) else whole
    path.write_text("\n".join(whole.strip().split("\n")[:-3]) + "\n")
    with pytest.raises(ValueError, match="promise"):
        load(path)


def test_broken_meshes_in_files_are_named(tmp_path):
    path = tmp_path / "nan.ply"
    path.write_bytes(_double_ply(np.array([[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]]), [[0, 1, 2]]))
    with pytest.raises(ValueError, match=r"nan\.ply: .*1"):
        load(path)
    path = tmp_path / "index.ply"
    path.write_bytes(_double_ply(TETRAHEDRON[0], [[0, 1, 2], [0, 1, 9]]))
    with pytest.raises(ValueError, match=r"index\.ply: "):
        load(path)
    document = {"asset": {"version": "2.0"}, "buffers": [{"uri": "gone.bin", "byteLength": 36}]}
    (tmp_path / "gone.gltf").write_text(json.dumps(document))
    with pytest.raises(ValueError, match=r"gone\.gltf: "):
        load(tmp_path / "gone.gltf")


# Counting -------------------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_counts_agree_with_trimesh_on_random_soups(seed):
    random = np.random.default_rng(seed)
    vertices = random.integers(0, 3, size=(12, 3)).astype(float)
    faces = random.integers(0, 12, size=(random.integers(1, 20), 3))
    if (trimesh.triangles.area(vertices[faces]) == 0).all():
        return
    about = describe(cyc.Scene(vertices, faces))
    _, weld = np.unique(vertices, axis=0, return_inverse=True)
    welded = np.sort(weld.reshape(-1)[faces], axis=1)
    assert about["duplicate"] == len(welded) - len(np.unique(welded, axis=0))
    assert about["degenerate"] == np.count_nonzero(trimesh.triangles.area(vertices[faces]) == 0)
    whole = welded[(np.diff(welded, axis=1) > 0).all(axis=1)]
    edges = np.sort(trimesh.geometry.faces_to_edges(whole), axis=1)
    owners = np.unique(edges, axis=0, return_counts=True)[1]
    assert (about["boundary"], about["nonmanifold"]) == ((owners == 1).sum(), (owners > 2).sum())
    groups = trimesh.graph.connected_components(edges, nodes=np.arange(weld.max() + 1), min_len=1)
    assert about["components"] == len(groups)
