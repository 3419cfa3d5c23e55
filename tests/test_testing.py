"""Renderers that are right pass, and each that is wrong is told what it probably did."""

import numpy as np
import pytest

import cyclorama as cyc
import peers
from cyclorama import testing
from cyclorama.render import BACKGROUND

CAMERA = cyc.Camera.look_at((2, 1.2, 3), (0.1, 0.2, 0), width=128, height=96)


@pytest.fixture(scope="module")
def rubble():
    """Triangles that lie about: of some the backs are seen, some are hidden, and no mirror image is the same."""
    rng = np.random.default_rng(7)
    corners = rng.uniform(-0.9, 0.9, (90, 1, 3)) + rng.normal(0, 0.3, (90, 3, 3))
    return cyc.Scene(corners.reshape(-1, 3), np.arange(270).reshape(90, 3), rng.integers(60, 255, (90, 3), np.uint8))


def moved(camera, dx, dy):
    K = camera.K.copy()
    K[:2, 2] += dx, dy
    return camera.replace(K=K)


def fronts(scene, camera):
    a, b, c = (scene.vertices[scene.faces[:, k]] for k in range(3))
    return np.flatnonzero(np.einsum("ij,ij->i", np.cross(b - a, c - a), camera.eye - a) > 0)


def report(check, *arguments, **options):
    with pytest.raises(AssertionError) as caught:
        check(*arguments, picture=False, **options)
    return str(caught.value)


def test_our_own_pictures_pass(rubble):
    view = rubble.render(CAMERA)
    testing.assert_ids_match(rubble, CAMERA, view.ids, allowed=0)
    testing.assert_ids_match(rubble, CAMERA, view.ids.astype(np.int32), allowed=0)
    testing.assert_depth_matches(rubble, CAMERA, view.depth, allowed=0)
    testing.assert_visible_matches(rubble, CAMERA, rubble.visible(CAMERA), exact=True)
    testing.assert_visible_matches(rubble, CAMERA, np.arange(len(rubble)))


def test_open3d_passes(rubble):
    ids, depth = peers.Embree(rubble.vertices, rubble.faces).render(CAMERA)
    testing.assert_ids_match(rubble, CAMERA, ids)
    testing.assert_depth_matches(rubble, CAMERA, depth)
    testing.assert_visible_matches(rubble, CAMERA, np.unique(ids[ids != BACKGROUND]), exact=True)


def test_pyrender_culls_back_faces_and_is_told_so(rubble):
    both_sides = peers.PyrenderIds(rubble.vertices, rubble.faces)
    ids, depth = both_sides.render(CAMERA)
    testing.assert_ids_match(rubble, CAMERA, ids)
    testing.assert_depth_matches(rubble, CAMERA, depth)
    both_sides.close()
    import pyrender

    near, far = 0.5, 20.0
    view, _ = CAMERA.to_opengl(near, far)
    (fx, _, cx), (_, fy, cy), _ = CAMERA.K
    scene = pyrender.Scene()
    mesh = pyrender.Mesh([pyrender.Primitive(positions=rubble.vertices, indices=rubble.faces, mode=4)])
    node = scene.add(mesh)
    scene.add(pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=near, zfar=far), pose=np.linalg.inv(view))
    renderer = pyrender.OffscreenRenderer(CAMERA.width, CAMERA.height)
    _, culled = renderer.render(scene, flags=pyrender.RenderFlags.SEG, seg_node_map={node: (1, 1, 1)})
    assert "probably: back faces are culled" in report(testing.assert_depth_matches, rubble, CAMERA, culled)
    # The pass that draws colours is multisampled, and resolves to the depth of each pixel's first sample.
    _, resolved = renderer.render(scene, flags=pyrender.RenderFlags.SKIP_CULL_FACES)
    _, both = renderer.render(scene)
    renderer.delete()
    said = report(testing.assert_depth_matches, rubble, CAMERA, resolved)
    assert "beside the pixels' centres is shown: multisampling?" in said
    assert "; and " not in said
    said = report(testing.assert_depth_matches, rubble, CAMERA, both)
    assert "probably: back faces are culled; and a sample" in said
    assert "beside the pixels' centres is shown: multisampling?" in said


def test_two_mistakes_at_once_are_told(rubble):
    culled = rubble.render(CAMERA, fronts(rubble, CAMERA))
    said = report(testing.assert_ids_match, rubble, CAMERA, culled.ids[::-1])
    assert "probably: back faces are culled; and rows are flipped" in said
    ids = rubble.render(moved(CAMERA, 0.5, 0.5), fronts(rubble, CAMERA)).ids
    said = report(testing.assert_ids_match, rubble, CAMERA, ids)
    assert "probably: back faces are culled; and the picture is shifted by (+0.5, +0.5)" in said
    far_and_near = np.where(np.isfinite(culled.depth), 1000 * culled.depth, 0)
    said = report(testing.assert_depth_matches, rubble, CAMERA, far_and_near)
    assert "probably: back faces are culled; and depths are 1000 times as large" in said
    nonsense = np.random.default_rng(0).integers(0, len(rubble), culled.ids.shape)
    assert "probably" not in report(testing.assert_ids_match, rubble, CAMERA, nonsense)


ID_MISTAKES = {
    "rows are flipped": lambda scene, ids: ids[::-1],
    "columns are flipped": lambda scene, ids: ids[:, ::-1],
    "turned by 180 degrees": lambda scene, ids: ids[::-1, ::-1],
    "shifted by (+0.5, +0.5)": lambda scene, ids: scene.render(moved(CAMERA, 0.5, 0.5)).ids,
    "shifted by (-1, -1)": lambda scene, ids: scene.render(moved(CAMERA, -1, -1)).ids,
    "back faces are culled": lambda scene, ids: scene.render(CAMERA, fronts(scene, CAMERA)).ids,
    "front faces are culled": lambda scene, ids: (
        scene.render(CAMERA, np.setdiff1d(np.arange(len(scene)), fronts(scene, CAMERA))).ids
    ),
    "mirrored in x": lambda scene, ids: cyc.Scene(scene.vertices * [-1, 1, 1], scene.faces).render(CAMERA).ids,
    "camera_to_world": lambda scene, ids: scene.render(CAMERA.replace(world_to_camera=CAMERA.camera_to_world)).ids,
    "vertical field of view is used as the horizontal": lambda scene, ids: (
        scene.render(
            CAMERA.replace(K=[[CAMERA.K[0, 0] * 4 / 3, 0, 64], [0, CAMERA.K[1, 1] * 4 / 3, 48], [0, 0, 1]])
        ).ids
    ),
    "numbered from 1": lambda scene, ids: np.where(ids == BACKGROUND, 0, ids + 1),
    "0 is written where nothing is seen": lambda scene, ids: np.where(ids == BACKGROUND, 0, ids),
    "numbered in another order": lambda scene, ids: np.where(
        ids == BACKGROUND, BACKGROUND, np.random.default_rng(1).permutation(len(scene))[np.minimum(ids, len(scene) - 1)]
    ),
    "hidden surfaces are not removed": lambda scene, ids: farthest(scene),
}


def farthest(scene):
    """Painter's algorithm in file order: the last face that covers a pixel, one at a time."""
    ids = np.full((CAMERA.height, CAMERA.width), BACKGROUND)
    for face in range(len(scene)):
        ids[scene.render(CAMERA, [face]).ids == face] = face
    return ids


@pytest.mark.parametrize("mistake", ID_MISTAKES)
def test_a_wrong_id_buffer_is_told_what_it_did(rubble, mistake):
    text = report(testing.assert_ids_match, rubble, CAMERA, ID_MISTAKES[mistake](rubble, rubble.render(CAMERA).ids))
    assert mistake in text.splitlines()[-1], text


def zbuffer(depth, near, far):
    with np.errstate(divide="ignore"):
        return np.where(np.isfinite(depth), far / (far - near) * (1 - near / depth), 1.0)


DEPTH_MISTAKES = {
    "rows are flipped": lambda scene, depth: depth[::-1],
    "range, the distance along the ray": lambda scene, depth: depth * np.linalg.norm(CAMERA.rays()[1], axis=-1),
    "the z-buffer is written": lambda scene, depth: zbuffer(depth.astype(float), 1.0, 30.0),
    "disparity": lambda scene, depth: 1 / depth,
    "depths are negative": lambda scene, depth: np.where(np.isfinite(depth), -depth, 0),
    "depths are 1000 times as large": lambda scene, depth: depth * 1000,
    "off by -1": lambda scene, depth: depth - 1,
    "back faces are culled": lambda scene, depth: scene.render(CAMERA, fronts(scene, CAMERA)).depth,
    "shifted by (-0.5, -0.5)": lambda scene, depth: scene.render(moved(CAMERA, -0.5, -0.5)).depth,
    "far plane": lambda scene, depth: np.where(depth > 3.6, np.inf, depth),
    "near plane": lambda scene, depth: scene.render(CAMERA.replace(near=3.2)).depth,
}


@pytest.mark.parametrize("mistake", DEPTH_MISTAKES)
def test_a_wrong_depth_buffer_is_told_what_it_did(rubble, mistake):
    text = report(
        testing.assert_depth_matches,
        rubble,
        CAMERA,
        DEPTH_MISTAKES[mistake](rubble, rubble.render(CAMERA).depth),
    )
    assert mistake in text.splitlines()[-1], text


def test_a_depth_within_the_slope_of_a_grazing_face_passes_and_beyond_it_does_not():
    floor = cyc.Scene([[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]], [[0, 1, 2], [0, 2, 3]])
    camera = cyc.Camera.look_at((0, 0.2, 0), (0, 0.1, -2), width=64, height=48)
    beside = floor.render(moved(camera, 0, 1 / 300)).depth
    seen = np.isfinite(beside)
    assert (np.abs(beside[seen] / floor.render(camera).depth[seen] - 1) > 1e-4).sum() > 100
    testing.assert_depth_matches(floor, camera, beside)
    assert report(testing.assert_depth_matches, floor, camera, floor.render(moved(camera, 0, 1 / 60)).depth)


def test_touching_faces_may_be_drawn_either_way():
    twice = cyc.Scene([[-9, -9, 0], [9, -9, 0], [9, 9, 0]], [[0, 1, 2], [0, 1, 2]])
    ids = twice.render(CAMERA).ids
    assert (ids == 0).any()
    testing.assert_ids_match(twice, CAMERA, np.where(ids == 0, 1, ids))


def test_sets_lack_nothing_that_owns_a_pixel_and_have_nothing_that_is_hidden(rubble):
    seen = rubble.visible(CAMERA).ids(0)
    assert "back faces are culled" in report(
        testing.assert_visible_matches, rubble, CAMERA, np.intersect1d(seen, fronts(rubble, CAMERA))
    )
    assert "a coarser picture" in report(
        testing.assert_visible_matches,
        rubble,
        CAMERA,
        np.unique(rubble.render(CAMERA.scaled(0.5)).ids)[:-1],
    )
    wide = CAMERA.replace(K=CAMERA.K * [[0.3, 1, 1], [1, 0.3, 1], [1, 1, 1]])
    near = CAMERA.replace(K=CAMERA.K * [[5, 1, 1], [1, 5, 1], [1, 1, 1]])
    assert "another camera or a wider one" in report(
        testing.assert_visible_matches, rubble, near, rubble.visible(wide), exact=True
    )
    hidden = np.setdiff1d(np.arange(len(rubble)), seen)[:1]
    assert f"face {hidden[0]}: in the image and hidden" in report(
        testing.assert_visible_matches, rubble, CAMERA, np.append(seen, hidden), exact=True
    )


@pytest.fixture(scope="module")
def shot(rubble):
    return rubble.depth_image(CAMERA)


ASIDE = cyc.Camera.look_at((2.3, 1.2, 2.9), (0.1, 0.2, 0), width=128, height=96)


def test_another_warp_of_the_same_picture_passes(shot):
    """One in plain NumPy, sample by sample, farthest first."""
    pixels, depth = np.indices(shot.depth.shape)[::-1].reshape(2, -1).T + 0.5, shot.depth.reshape(-1)
    known = ~shot.missing.reshape(-1)
    at, far = ASIDE.project(CAMERA.unproject(pixels[known], depth[known]))
    color, hole = np.zeros((96, 128, 3), np.uint8), np.ones((96, 128), bool)
    for k in np.argsort(-far):
        x, y = np.floor(at[k]).astype(int)
        square = np.s_[max(y - 1, 0) : max(y + 2, 0), max(x - 1, 0) : max(x + 2, 0)]
        color[square], hole[square] = shot.color.reshape(-1, 3)[known][k], False
    testing.assert_warp_matches(shot, ASIDE, color, hole, allowed=0)


WARP_MISTAKES = {
    "rows are flipped": lambda shot, warped: (warped.color[::-1], warped.hole[::-1]),
    "red and blue": lambda shot, warped: (warped.color[..., ::-1], warped.hole),
    "nothing is warped": lambda shot, warped: (shot.color, shot.missing),
    "the motion is inverted": lambda shot, warped: inverted(shot),
    "holes are filled": lambda shot, warped: (
        np.where(warped.hole[..., None], np.uint8(77), warped.color),
        np.zeros_like(warped.hole),
    ),
}


def inverted(shot):
    moved = CAMERA.world_to_camera @ ASIDE.camera_to_world @ CAMERA.world_to_camera
    warped = cyc.warp.forward(shot, ASIDE.replace(world_to_camera=moved))
    return warped.color, warped.hole


@pytest.mark.parametrize("mistake", WARP_MISTAKES)
def test_a_wrong_warp_is_told_what_it_did(shot, mistake):
    color, hole = WARP_MISTAKES[mistake](shot, cyc.warp.forward(shot, ASIDE))
    text = report(testing.assert_warp_matches, shot, ASIDE, color, hole)
    assert mistake in text.splitlines()[-1], text


def test_the_report_names_pixels_and_faces_and_a_picture_lies_beside(rubble, tmp_path, monkeypatch):
    image = pytest.importorskip("PIL.Image", reason="needs Pillow to look at the picture")
    view = rubble.render(CAMERA)
    row, column = np.argwhere(view.ids != BACKGROUND)[900]
    wrong = view.ids.copy()
    wrong[row - 2 : row + 3, column - 2 : column + 3] = BACKGROUND
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AssertionError, match=rf"pixel \[{row - 2}, \d+\]: face \d+ at [\d.]+, got nothing") as caught:
        testing.assert_ids_match(rubble, CAMERA, wrong)
    (path,) = tmp_path.glob("cyclorama-differences/*.png")
    assert path.name in str(caught.value)
    assert "test_the_report" in path.name
    picture = np.asarray(image.open(path).convert("RGB"))
    zoom = picture.shape[0] // 96
    red = (picture[::zoom, ::zoom] == (215, 25, 28)).all(axis=2)
    assert red[:, 2 * 132 :].sum() == (view.ids[row - 2 : row + 3, column - 2 : column + 3] != BACKGROUND).sum()


@pytest.mark.parametrize(
    ("check", "value", "says"),
    [
        (testing.assert_ids_match, np.zeros((128, 96), int), "rows come first"),
        (testing.assert_ids_match, np.zeros((96, 128)), "integers"),
        (testing.assert_depth_matches, np.zeros((3, 3)), "depth has shape"),
        (testing.assert_visible_matches, [10**6], r"faces\[0\] is 1000000"),
        (testing.assert_visible_matches, np.zeros(3, bool), "a flag a face"),
    ],
)
def test_bad_input_is_refused(rubble, check, value, says):
    with pytest.raises(ValueError, match=says):
        check(rubble, CAMERA, value)
