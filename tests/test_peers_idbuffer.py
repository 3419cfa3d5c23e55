"""Id-buffers against Embree, embreex, OpenGL and OpenCV, and against what must hold of any of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay

import cyclorama as cyc
from cyclorama import BACKGROUND, Camera, Scene
from peers import Embree, OpenCV, PyrenderIds, TrimeshEmbree, need

MESHES = [
    "bamboo_truss", "brain_icbm152", "bunny", "chair_duplicated_faces", "dragon_100k", "engine_2cylinder", "fzk_haus",
    "horse", "igea", "kitchen", "legocar", "q3_20kdm2", "scorpion", "sibenik", "tray_plate", "tree", "x_wing",
]  # fmt: skip

#: Eyes inside the rooms, from the README of the meshes: (mesh, eye, up).
INSIDE = [
    ("sibenik", (6, 5, 0), (0, 1, 0)),
    ("fzk_haus", (4.5, 2, 1.6), (0, 0, 1)),
    ("kitchen", (0.84, 1.24, 0.06), (0, 1, 0)),
    ("q3_20kdm2", (1888, 1344, 112), (0, 0, 1)),
]

ENGINES = ["raster", "raycast"]


def outside(scene, direction, *, distance=1.0, **options):
    """A camera that sees the whole scene from this direction."""
    away = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    eye = scene.center + distance * scene.radius / math.sin(math.radians(22.5)) * away
    return Camera.look_at(eye, scene.center, **options)


def compare(ids, depth, their_ids, their_depth):
    """(covered, same id, same id or depth within 1e-4) as masks; covered by either."""
    covered = (ids != BACKGROUND) | (their_ids != BACKGROUND)
    same = ids == their_ids
    with np.errstate(invalid="ignore"):
        close = np.abs(depth - their_depth) <= 1e-4 * np.minimum(depth, their_depth)
    return covered, same & covered, (same | close) & covered


def assert_agree(view, answer, share=0.999):
    covered, _, agree = compare(view.ids, view.depth, *answer)
    assert agree.sum() >= share * covered.sum(), f"{covered.sum() - agree.sum()} of {covered.sum()} pixels differ"


def crossed_by_an_edge(peer, camera, reach):
    """Pixels within `reach` of whose centre, to either side, the peer sees another face."""
    middle = peer.render(camera)[0]
    crossed = np.zeros(middle.shape, dtype=bool)
    for dx, dy in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        K = camera.K.copy()
        K[:2, 2] += reach * dx, reach * dy
        crossed |= peer.render(camera.replace(K=K))[0] != middle
    return crossed


def seen_within(embree, camera, pixels, ids, depth, reach):
    """For each (row, column) whether Embree sees this id or this depth (inf for none) within `reach` of its centre."""
    offsets = np.linspace(-reach, reach, 33)
    centres = np.asarray(pixels)[:, None, ::-1] + 0.5
    probes = centres + np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(1, -1, 2)
    moved = embree.moved(camera)
    directions = moved.unproject(probes, np.ones(probes.shape[:-1])) - moved.eye
    seen, at = embree.cast(np.broadcast_to(moved.eye, directions.shape), directions)
    return ((seen == ids[:, None]) | np.isclose(at, depth[:, None], rtol=1e-4, atol=0)).any(axis=1)


@pytest.fixture(scope="session")
def peer(triangles):
    """`peer(Embree, "bunny")`: the mesh as the peer holds it, made once and kept while its mesh is in use."""
    kept = {}

    def get(kind, name):
        if kept.get("name") != name:
            close(kept)
            kept["name"] = name
        if kind not in kept:
            kept[kind] = kind(*triangles(name))
        return kept[kind]

    def close(kept):
        for value in kept.values():
            if isinstance(value, PyrenderIds):
                value.close()
        kept.clear()

    yield get
    close(kept)


# Real meshes


@pytest.mark.parametrize("name", MESHES)
def test_ids_or_depths_are_embree_s(name, real_scene, peer):
    scene, embree = real_scene(name), peer(Embree, name)
    for camera in (outside(scene, (0.3, 0.4, 0.86)), outside(scene, (-0.9, 0.1, -0.4), distance=0.6)):
        assert_agree(scene.render(camera), embree.render(camera))


@pytest.mark.parametrize(("name", "eye", "up"), INSIDE)
@pytest.mark.parametrize("near", [0.0, 0.25])
def test_ids_or_depths_are_embree_s_from_within_a_room(name, eye, up, near, real_scene, peer):
    scene = real_scene(name)
    camera = Camera.look_at(eye, scene.center + (0.1, 0.2, 0.3), up=up, fov_y=75, near=near * scene.radius)
    assert_agree(scene.render(camera), peer(Embree, name).render(camera))


@pytest.mark.parametrize("name", ["bunny", "kitchen", "tree"])
@pytest.mark.parametrize("engine", ENGINES)
def test_a_scene_ten_thousand_sizes_from_zero_loses_nothing(name, engine, real_scene, triangles, peer):
    vertices, faces = triangles(name)
    here = real_scene(name)
    offset = 1e4 * here.radius * np.array((0.7, -0.5, 0.6))
    there = Scene(vertices.astype(np.float64) + offset, faces)
    camera = outside(there, (0.3, 0.4, 0.86))
    answer = Embree(there.vertices, faces).render(camera)
    assert_agree(there.render(camera, engine=engine), answer)


@pytest.mark.parametrize("name", ["bunny", "x_wing", "tree"])
def test_ids_or_depths_are_embreex_s(name, real_scene, peer):
    camera = outside(real_scene(name), (0.3, 0.4, 0.86))
    assert_agree(real_scene(name).render(camera), peer(TrimeshEmbree, name).render(camera))


@pytest.mark.parametrize("name", ["bunny", "horse", "kitchen", "tree", "legocar", "x_wing"])
@pytest.mark.parametrize(("kind", "reach"), [(PyrenderIds, 1 / 256), (OpenCV, 1 / 4096)])
def test_other_rasterisers_differ_only_where_an_edge_crosses_the_pixel(
    name, kind, reach, real_scene, peer, record_property
):
    """What they show instead is what Embree sees within `reach` of the pixel's centre.

    OpenGL snaps corners to 1/256 of a pixel, which moves an edge by up to 0.7 of that; OpenCV rounds them to float32.
    Snapping also tilts a face that is seen nearly edge-on: OpenGL then draws it at a depth that none of its corners
    has. Such pixels are told by that depth.
    """
    scene, embree = real_scene(name), peer(Embree, name)
    camera = outside(scene, (0.3, 0.4, 0.86))
    view = scene.render(camera)
    their_ids, their_depth = peer(kind, name).render(camera)
    covered, same, agree = compare(view.ids, view.depth, their_ids, their_depth)
    crossed = crossed_by_an_edge(embree, camera, reach)
    differ = covered & ~agree
    record_property(
        "pixels",
        f"{covered.sum()} covered, {crossed.sum()} crossed by an edge, {(covered & ~same).sum()} with another id, "
        f"{differ.sum()} of them at another depth",
    )
    pixels = np.argwhere(differ)
    if len(pixels):
        shown = their_ids[differ]
        explained = seen_within(embree, camera, pixels, shown, their_depth[differ], reach)
        corners = camera.project(scene.vertices[scene.faces[np.where(shown == BACKGROUND, 0, shown)]])[1]
        low, high = corners.min(axis=1) * 0.999, corners.max(axis=1) * 1.001
        explained |= (shown != BACKGROUND) & ((their_depth[differ] < low) | (their_depth[differ] > high))
        assert explained.all(), f"{pixels[~explained].tolist()} are crossed by no edge"
    assert (covered & ~same).sum() <= 0.003 * covered.sum()
    assert differ.sum() <= (5e-4 if kind is PyrenderIds else 5e-5) * covered.sum()


@pytest.mark.parametrize("name", ["bunny", "kitchen", "tree"])
def test_orthographic_views_are_embree_s_and_opengl_s(name, real_scene, peer):
    scene = real_scene(name)
    eye = scene.center + 2 * scene.radius * np.array((0.6, 0.64, 0.48))
    camera = Camera.orthographic_look_at(eye, scene.center, extent=2 * scene.radius)
    view = scene.render(camera)
    assert_agree(view, peer(Embree, name).render(camera))
    assert_agree(view, peer(PyrenderIds, name).render(camera))


@pytest.mark.parametrize("name", ["bunny", "kitchen"])
def test_off_centre_and_skewed_cameras_are_embree_s(name, real_scene, peer):
    camera = outside(real_scene(name), (0.3, 0.4, 0.86))
    K = camera.K @ [[1.3, 0.2, 0.15], [0, 0.8, -0.2], [0, 0, 1]]
    camera = camera.replace(K=K)
    assert_agree(real_scene(name).render(camera), peer(Embree, name).render(camera))


@pytest.mark.parametrize("name", MESHES)
def test_the_two_engines_give_the_same_bits(name, real_scene):
    scene = real_scene(name)
    cameras = [outside(scene, (-0.5, 0.4, 0.7), width=255, height=240)]
    cameras.append(Camera.look_at(scene.center, scene.center + (0.3, 0.1, 1), fov_y=100, width=255, height=240))
    cameras.append(cameras[1].replace(near=0.2 * scene.radius))
    cameras.append(
        Camera.orthographic_look_at(scene.center, scene.center + (1, 2, 3), extent=scene.radius, width=255, height=240)
    )
    for camera in cameras:
        raster, raycast = (scene.render(camera, engine=engine) for engine in ENGINES)
        np.testing.assert_array_equal(raster.ids, raycast.ids)
        np.testing.assert_array_equal(raster.depth, raycast.depth)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_subset_is_drawn_as_if_the_rest_were_not_there(engine, real_scene, triangles, rng):
    vertices, faces = triangles("bunny")
    chosen = np.flatnonzero(rng.random(len(faces)) < 0.3).astype(np.uint32)
    scene = real_scene("bunny")
    camera = outside(scene, (0.3, 0.4, 0.86))
    view = scene.render(camera, faces=chosen, engine=engine)
    embree = Embree(np.vstack([vertices, vertices[:1]]), faces[chosen])
    ids, depth = embree.render(camera)
    hit = ids != BACKGROUND
    ids[hit] = chosen[ids[hit]]
    assert_agree(view, (ids, depth))
    assert np.isin(view.ids[view.ids != BACKGROUND], chosen).all()
    assert (scene.render(camera, faces=[], engine=engine).ids == BACKGROUND).all()


@pytest.mark.parametrize("share", [0.01, 0.3, 0.99])
def test_a_subset_is_drawn_alike_whether_all_faces_were_drawn_before_or_not(share, rng):
    pipes = cyc.scenes.pipes(20_000)
    apart, picked = cyc.Scene(pipes.vertices, pipes.faces), cyc.Scene(pipes.vertices, pipes.faces)
    chosen = np.flatnonzero(rng.random(len(pipes)) < share).astype(np.uint32)
    camera = Camera.look_at((0.1, 0.2, 1.5), (0, 0, 0), width=96, height=72)
    picked.render(camera)
    views = [scene.render(camera, faces=chosen, engine="raster") for scene in (apart, picked)]
    np.testing.assert_array_equal(views[0].ids, views[1].ids)
    np.testing.assert_array_equal(views[0].depth, views[1].depth)


# What must hold of any scene


@st.composite
def soups(draw):
    """Few random faces about a camera among them: some cross its plane, some have no area."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(1, 40))
    vertices = rng.normal(size=(3 * count, 3)) * draw(st.sampled_from([0.5, 1, 3]))
    if draw(st.booleans()):
        vertices = vertices.round()
    faces = rng.integers(0, len(vertices), (count, 3)).astype(np.uint32)
    faces = np.vstack([faces, [[0, 1, 2]]])
    vertices[:3] = (-2, 0.3, 2), (2, 0.1, 3), (0.2, 2, 2)
    eye = rng.normal(size=3).round(1) + (0, 0, 1e-3)
    near = draw(st.sampled_from([0.0, 0.5]))
    size = draw(st.sampled_from([(64, 48), (33, 7), (1, 1)]))
    if draw(st.booleans()):
        return vertices, faces, Camera.look_at(eye, (0, 0, 0), (0, 1, 0), 80, *size, near)
    return vertices, faces, Camera.orthographic_look_at(eye, (0, 0, 0), (0, 1, 0), 4, *size, near)


@given(soups())
def test_the_two_engines_give_the_same_bits_among_any_faces(soup):
    vertices, faces, camera = soup
    scene = Scene(vertices, faces)
    raster, raycast = (scene.render(camera, engine=engine) for engine in ENGINES)
    np.testing.assert_array_equal(raster.ids, raycast.ids)
    np.testing.assert_array_equal(raster.depth, raycast.depth)


@given(soups())
def test_any_faces_are_seen_as_embree_sees_them(soup):
    vertices, faces, camera = soup
    embree = Embree(vertices, faces)
    covered, _, agree = compare(
        *embree.render(camera), *(getattr(Scene(vertices, faces).render(camera), name) for name in ("ids", "depth"))
    )
    crossed = crossed_by_an_edge(embree, camera, 1 / 1024)
    clipped = np.abs(np.minimum(embree.render(camera)[1], 1e9) - camera.near) < 1e-4
    assert (agree | ~covered | crossed | clipped).all()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("slope", [0.0, 0.7, 3.0])
@pytest.mark.parametrize("near", [0.0, 1.0, 2.5])
def test_near_clipping_cuts_a_plane_where_its_depth_is_near(engine, slope, near):
    # The plane y = slope (z - 2) of the camera's space, wide enough to run behind the eye, or the wall z = 2.
    side = 1e3
    if slope:
        corners = [(x, slope * (z - 2), z) for x, z in ((-side, -side), (side, -side), (side, side), (-side, side))]
    else:
        corners = [(x, y, 2.0) for x, y in ((-side, -side), (side, -side), (side, side), (-side, side))]
    camera = Camera([[60, 0, 32], [0, 60, 24], [0, 0, 1]], np.eye(4), 64, 48, near=near)
    view = Scene(corners, [[0, 1, 2], [0, 2, 3]]).render(camera, engine=engine)
    y = ((np.arange(48) + 0.5) - 24) / 60
    with np.errstate(divide="ignore"):
        depth = 2 * slope / (slope - y) if slope else np.full(48, 2.0)
    x = np.abs((np.array([0.5, 63.5]) - 32) / 60).max()
    inside = (depth > 0) & (np.abs(x * depth) < side) & (depth < side)
    seen = np.repeat(inside & (depth >= near), 64).reshape(48, 64)
    np.testing.assert_array_equal(view.ids != BACKGROUND, seen)
    np.testing.assert_allclose(view.depth[seen], np.repeat(depth, 64).reshape(48, 64)[seen], rtol=1e-6)


def tiling(rng, camera, count, *, on_centres):
    """Faces whose projections tile the image and its surroundings: each pixel lies in one of them.

    A planar triangulation of points of the image, each moved along its ray to a depth of its own. `on_centres` puts
    the points on pixel centres and their depths at powers of two, so that they project there without rounding.
    """
    size = np.array((camera.width, camera.height))
    inner = rng.uniform(-0.2, 1.2, (count, 2)) * size
    frame = np.array([(x, y) for x in (-1.5, 0.5, 2.5) for y in (-1.5, 0.5, 2.5) if (x, y) != (0.5, 0.5)]) * size
    pixels = np.vstack([inner, frame])
    depth = rng.uniform(1, 5, len(pixels))
    if on_centres:
        pixels = np.unique(np.floor(pixels) + 0.5, axis=0)
        depth = 2.0 ** rng.integers(0, 3, len(pixels))
    faces = Delaunay(pixels).simplices.astype(np.uint32)
    return camera.unproject(pixels, depth), faces[rng.permutation(len(faces))]


def times_drawn(scene, camera, engine):
    """How many faces, drawn alone, cover each pixel."""
    drawn = np.zeros((camera.height, camera.width), dtype=int)
    for face in range(len(scene)):
        drawn += scene.render(camera, faces=[face], engine=engine).ids != BACKGROUND
    return drawn


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("orthographic", [False, True])
@given(st.integers(0, 2**32 - 1), st.sampled_from([4, 30, 150]), st.booleans())
def test_shared_edges_are_watertight(engine, orthographic, seed, count, on_centres):
    """Every pixel is covered by exactly one face of a tiling, corners and edges on pixel centres included."""
    rng = np.random.default_rng(seed)
    camera = Camera([[32, 0, 20], [0, 32, 15], [0, 0, 1]], np.eye(4), 40, 30, orthographic=orthographic)
    scene = Scene(*tiling(rng, camera, count, on_centres=on_centres))
    assert (scene.render(camera, engine=engine).ids != BACKGROUND).all()
    np.testing.assert_array_equal(times_drawn(scene, camera, engine), 1)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_floor_that_runs_under_the_eye_and_behind_it_is_watertight(engine, rng):
    x, z = np.meshgrid(np.linspace(-60, 60, 13), np.linspace(-60, 60, 13))
    vertices = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=-1)
    vertices[:, [0, 2]] += rng.uniform(-2, 2, (len(vertices), 2))
    faces = Delaunay(vertices[:, [0, 2]]).simplices.astype(np.uint32)
    scene = Scene(vertices, faces)
    camera = Camera.look_at((0.3, 1.5, 0.2), (4, 0, 3), fov_y=100, width=120, height=90)
    origins, directions = camera.rays()
    with np.errstate(divide="ignore"):
        t = -origins[..., 1] / directions[..., 1]
    on_floor = (t > 0) & (np.abs(origins + t[..., None] * directions)[..., [0, 2]].max(axis=-1) < 50)
    drawn = times_drawn(scene, camera, engine)
    assert on_floor.sum() > 4000
    np.testing.assert_array_equal(drawn[on_floor], 1)
    assert drawn.max() == 1
    view = scene.render(camera, engine=engine)
    np.testing.assert_allclose(view.depth[on_floor], t[on_floor], rtol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_faces_without_area_are_never_seen_and_hide_nothing(engine, triangles, rng):
    vertices, faces = triangles("bunny")
    points = rng.integers(0, len(vertices), (500, 2))
    lines = np.stack([points[:, 0], points[:, 1], points[:, 0]], axis=-1)
    dots = np.repeat(points[:, :1], 3, axis=1)
    with_more = Scene(vertices, np.vstack([lines, faces, dots]).astype(np.uint32))
    camera = outside(with_more, (0.3, 0.4, 0.86))
    plain, more = Scene(vertices, faces).render(camera, engine=engine), with_more.render(camera, engine=engine)
    expected = np.where(plain.ids == BACKGROUND, plain.ids, plain.ids + np.uint32(500))
    np.testing.assert_array_equal(more.ids, expected)
    np.testing.assert_array_equal(more.depth, plain.depth)


@pytest.mark.parametrize("engine", ENGINES)
def test_of_coincident_faces_the_first_is_seen(engine, triangles):
    vertices, faces = triangles("bunny")
    turned = np.roll(faces, 1, axis=1)[:, ::-1]
    scene = Scene(vertices, np.vstack([faces, turned]).astype(np.uint32))
    camera = outside(scene, (0.3, 0.4, 0.86))
    ids = scene.render(camera, engine=engine).ids
    plain = Scene(vertices, faces).render(camera, engine=engine).ids
    # Turned over, a face's depth may round differently by a last bit: the copy then wins, at the same place.
    copy = (ids != BACKGROUND) & (ids >= len(faces))
    ids[copy] -= np.uint32(len(faces))
    np.testing.assert_array_equal(ids, plain)
    assert copy.sum() <= 0.01 * (ids != BACKGROUND).sum()


@pytest.mark.parametrize("engine", ENGINES)
def test_from_inside_a_closed_mesh_every_pixel_is_covered(engine):
    trimesh = need("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=4)
    vertices, faces = ball.vertices, ball.faces.astype(np.uint32)
    scene, embree = Scene(vertices, faces), Embree(vertices, faces)
    for eye, target, fov in (
        ((0, 0, 0), (0, 1, 0), 90),
        ((0.7, 0.5, 0.3), (-1, 0, 0), 150),
        ((0, 0, 0.99), (0, 0, 5), 170),
    ):
        camera = Camera.look_at(eye, target, fov_y=fov)
        view = scene.render(camera, engine=engine)
        assert (view.ids != BACKGROUND).all()
        covered, _, agree = compare(view.ids, view.depth, *embree.render(camera))
        assert agree.sum() >= 0.999 * covered.sum()


@pytest.mark.parametrize(
    "weights",
    [
        pytest.param((1 / 3, 1 / 3, 1 / 3), id="in a face"),
        pytest.param((0.98, 0.01, 0.01), id="close to a vertex"),
        pytest.param((0.5, 0.5, 0), id="on an edge"),
        pytest.param((1, 0, 0), id="on a vertex"),
    ],
)
def test_an_eye_that_touches_a_face_sees_the_rest(weights):
    for seed in (*range(20), 1594103):
        see_from_a_face(weights, np.random.default_rng(seed))


def see_from_a_face(weights, rng):
    """Among random faces, the first of which holds the eye."""
    vertices, faces = rng.normal(size=(30, 3)), rng.integers(0, 30, (20, 3)).astype(np.uint32)
    faces[0] = 0, 1, 2
    eye = np.array(weights) @ vertices[:3]
    camera = Camera.look_at(eye, eye + rng.normal(size=3), fov_y=100, width=40, height=30)
    scene, embree = Scene(vertices, faces), Embree(vertices, faces)
    raster, raycast = (scene.render(camera, engine=engine) for engine in ENGINES)
    np.testing.assert_array_equal(raster.ids, raycast.ids)
    their_ids, their_depth = embree.render(camera)
    covered, _, agree = compare(raster.ids, raster.depth, their_ids, their_depth)
    # Of a face that the eye touches, float32 and float64 see different sides.
    touched = np.flatnonzero((faces <= 2).any(axis=1))
    touching = np.isin(raster.ids, touched) | np.isin(their_ids, touched)
    assert (agree | ~covered | touching | crossed_by_an_edge(embree, camera, 1 / 256)).all()


def test_render_refuses_what_it_cannot_draw():
    scene = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), width=8, height=8)
    with pytest.raises(ValueError, match="engine"):
        scene.render(camera, engine="magic")
    with pytest.raises(ValueError, match="faces"):
        scene.render(camera, faces=[1])
    with pytest.raises(ValueError, match="faces"):
        scene.render(camera, faces=[-1])
