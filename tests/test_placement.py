"""Plans keep their budgets and lose nothing; proofs are checked by code that shares nothing with what made them."""

from dataclasses import replace

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import _core, placement
from cyclorama.placement import search
from cyclorama.placement.verify import cell_boxes, check_proof, verify

BUDGET = 12_000


@pytest.fixture(scope="module")
def scene():
    return cyc.scenes.pipes(20_000)


@pytest.fixture(scope="module")
def plan(scene):
    return cyc.place_images(scene, BUDGET, progress=False)


def brute_force(plan, eye, gaze, image):
    """Faces that are outside a plane of the frustum, and those behind the image, corner by corner."""
    forward = np.asarray(gaze) / np.linalg.norm(gaze)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    tan_x = np.tan(np.radians(plan.fov_x / 2))
    points = plan.scene.vertices.astype(float)[plan.scene.faces]
    x, y, z = (points - eye) @ right, (points - eye) @ up, (points - eye) @ forward
    tan_y = tan_x / plan.aspect
    planes = [x + z * tan_x, z * tan_x - x, y + z * tan_y, z * tan_y - y]
    outside = np.any([(p < 0).all(axis=1) for p in planes], axis=0)
    if image is None:
        return outside, np.zeros(len(outside), bool)
    to = points - image.viewpoint
    corners = image.corners - image.viewpoint
    across, down = corners[1] - corners[0], corners[3] - corners[0]
    # Each corner's ray meets the quadrilateral at corners[0] + a across + b down, at a share t of the way.
    a, b, t = np.moveaxis(np.linalg.solve(np.column_stack([across, down, -corners[0]]), to[..., None])[..., 0], -1, 0)
    scale = -t
    behind = (scale >= 1 - 1e-9) & (a >= -1e-9) & (b >= -1e-9) & (a <= scale + 1e-9) & (b <= scale + 1e-9)
    return outside, behind.all(axis=1)


def test_every_face_is_drawn_or_outside_or_behind_the_image(plan):
    eyes, gazes = placement.check.random_frames(plan, 80, 3)
    needed = 0
    for eye, gaze in zip(eyes, gazes, strict=True):
        frame = plan.frame(eye, gaze)
        outside, behind = brute_force(plan, eye, gaze, frame.image)
        drawn = np.zeros(len(plan.scene), bool)
        drawn[frame.faces] = True
        assert len(frame.faces) == drawn.sum() <= BUDGET
        assert (drawn | outside | behind).all()
        if frame.image is not None:
            needed += 1
            image = frame.image
            assert image.forward @ (eye - image.viewpoint) < image.forward @ (image.corners[0] - image.viewpoint)
    assert needed > 5


def test_the_closest_viewpoint_that_serves_is_taken(plan):
    eyes, gazes = placement.check.random_frames(plan, 200, 4)
    reach = 1.2 * (plan.domain[1] - plan.domain[0]).max()
    for eye, gaze in zip(eyes, gazes, strict=True):
        frame = plan.frame(eye, gaze)
        if frame.image is not None:
            assert np.linalg.norm(frame.image.viewpoint - eye) <= reach


def test_random_frames_are_sound(plan):
    report = plan.check(300, seed=1, progress=False)
    assert report.is_sound and report.with_image > 20 and report.most <= BUDGET
    assert report.greatest_distance <= 1.2


def test_the_certificate_is_verified_from_its_file(plan, tmp_path):
    path = tmp_path / "proof.npz"
    assert plan.certify(path) == len(plan.proof) == verify(path, plan.scene)


def test_a_certificate_of_another_scene_is_refused(plan, tmp_path):
    path = tmp_path / "proof.npz"
    plan.certify(path)
    with pytest.raises(ValueError, match="another scene"):
        verify(path, cyc.scenes.pipes(20_000, seed=1))


def refused(plan, message, **changes):
    """Both verifiers refuse the plan's certificate with these arrays in the place of its own."""
    header, arrays = plan._certificate()
    with pytest.raises(ValueError, match=message):
        check_proof(header | {"budget": changes.get("budget", plan.budget)}, arrays | changes, plan.scene)
    corners = changes.get("corners", plan.images.corners)
    order, starts = plan.cells()
    low, high = cell_boxes(order, starts, plan.scene)
    sizes = np.diff(np.append(starts, len(order))).astype(np.uint32)
    audit = _core.Audit(
        low,
        high,
        sizes,
        arrays["viewpoints"],
        corners.reshape(-1, 3),
        plan.axes.tolist(),
        plan.tangents,
        changes.get("budget", plan.budget),
        1e-13,
        np.tile([0.0, np.inf], (len(sizes), 1)),
        [],
        np.zeros((0, len(sizes)), np.uint32),
    )
    boxes, served = changes.get("boxes", plan.proof.boxes), changes.get("served", plan.proof.image)
    with pytest.raises(ValueError, match=message):
        audit.proof(boxes, served, plan.domain.tolist(), tuple(header["pitch"]))


def test_a_certificate_without_one_of_its_boxes_is_refused(plan):
    boxes, served = plan.proof.boxes[1:], plan.proof.image[1:]
    refused(plan, "leave a part of the domain out", boxes=boxes, served=served)


def test_a_certificate_with_a_smaller_budget_is_refused(plan):
    refused(plan, "faces are left by image", budget=BUDGET // 2)


def test_a_certificate_whose_image_came_nearer_than_its_eyes_is_refused(plan):
    viewpoints = plan.viewpoints[plan.images.viewpoint][:, None]
    corners = viewpoints + (plan.images.corners - viewpoints) * 1e-3
    refused(plan, r"past the plane|reverse frustum", corners=corners)


def test_a_certificate_that_needs_no_images_is_refused_where_they_are_needed(plan):
    refused(plan, "faces are left by image -1", served=np.full_like(plan.proof.image, -1))


def test_a_certificate_that_names_another_image_is_refused(plan):
    served = np.where(plan.proof.image >= 0, len(plan.images), -1).astype(np.int32)
    refused(plan, r"image .*not there", served=served)


@pytest.fixture(scope="module")
def sphere():
    # A budget that few frames exceed, so that the plan takes seconds.
    return cyc.place_images(cyc.scenes.pipes(3_000), 2_650, directions="sphere", progress=False)


def test_a_plan_for_all_gazes_is_proved_and_sound(sphere, tmp_path):
    assert len(sphere.images) > sphere.shell
    assert sphere.certify(tmp_path / "proof.npz") == len(sphere.proof)
    found = sphere.check(2000, progress=False)
    assert found.is_sound and found.with_image > 20
    header, arrays = sphere._certificate()
    assert header["pitch"] == [-np.pi / 2, np.pi / 2]
    boxes, served = arrays["boxes"], arrays["served"]
    with pytest.raises(ValueError, match="leave a part of the domain out"):
        check_proof(header, arrays | {"boxes": boxes[:-1], "served": served[:-1]}, sphere.scene)


def test_poles_have_frames(sphere):
    for gaze in ([0, 1, 0], [0, -1, 0], [1e-9, 1, 0]):
        for eye in ([0, -0.95, 0], [0.3, 0.9, -0.9]):
            frame = sphere.frame(eye, gaze)
            assert len(frame.faces) <= sphere.budget


def test_beyond_the_domain_an_image_stands_for_the_whole_scene(plan):
    low, high = plan.domain
    rng = np.random.default_rng(0)
    needed = 0
    for _ in range(200):
        eye = rng.uniform(-4, 4, 3)
        if ((eye >= low) & (eye <= high)).all():
            continue
        gaze = -eye * [1, 0, 1] + rng.normal(0, 0.3, 3) * [1, 0, 1]
        frame = plan.frame(eye, gaze)
        assert len(frame.faces) <= plan.budget
        if frame.image is None:
            outside, _ = brute_force(plan, eye, gaze, None)
            drawn = np.zeros(len(plan.scene), bool)
            drawn[frame.faces] = True
            assert (outside | drawn).all()
            continue
        needed += 1
        _, behind = brute_force(plan, eye, gaze, frame.image)
        image = frame.image
        assert len(frame.faces) == 0 and behind.all() and image.index >= len(plan.images) - plan.shell
        assert image.forward @ (eye - image.viewpoint) < image.forward @ (image.corners[0] - image.viewpoint)
    assert needed > 20


def test_without_a_shell_eyes_beyond_the_domain_are_refused(scene):
    plan = cyc.place_images(scene, BUDGET, shell=0, progress=False)
    assert plan.shell == 0
    with pytest.raises(ValueError, match=r"outside plan.domain, .* not before any image of the shell"):
        plan.frame([0, 0, -2.5], [0, 0, 1])


def test_a_plan_is_the_same_after_its_file(plan, scene, tmp_path):
    plan.save(tmp_path / "plan.npz")
    again = placement.Plan.load(tmp_path / "plan.npz", scene)
    for eye in ([-0.9, 0, 0], [0.2, 0.1, -0.9]):
        a, b = plan.frame(eye, [0.3, 0, 1]), again.frame(eye, [0.3, 0, 1])
        np.testing.assert_array_equal(a.faces, b.faces)
        assert (a.image is None) == (b.image is None)


def test_another_scene_is_refused(plan, tmp_path):
    plan.save(tmp_path / "plan.npz")
    with pytest.raises(ValueError, match="another scene"):
        placement.Plan.load(tmp_path / "plan.npz", cyc.scenes.pipes(20_000, seed=1))
    with pytest.raises(ValueError, match="not a whole plan"):
        (tmp_path / "cut.npz").write_bytes((tmp_path / "plan.npz").read_bytes()[:5000])
        placement.Plan.load(tmp_path / "cut.npz", plan.scene)


def test_threads_change_nothing(scene, plan):
    other = cyc.place_images(scene, BUDGET, threads=1, progress=False)
    np.testing.assert_array_equal(plan.parameters, other.parameters)
    np.testing.assert_array_equal(plan.proof.boxes, other.proof.boxes)


def test_a_budget_of_the_whole_scene_needs_no_image(scene):
    plan = cyc.place_images(scene, len(scene), progress=False)
    assert len(plan.images) == 0
    assert plan.frame([0, 0, 0], [1, 0, 0]).image is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"budget": 0}, "budget must be"),
        ({"budget": 20_001}, "budget is 20001, the scene has 20000 faces"),
        ({"fov_x": "wide"}, "fov_x must be"),
        ({"lod": 5}, "lod must be"),
        ({"lod": [5]}, "lod must be"),
        ({"budget": 100}, "budget 100 is too small: .* needs"),
        ({"optimize_to": BUDGET + 1}, "optimize_to must be"),
        ({"fov_x": 180.0}, "fov_x must be"),
        ({"aspect": 0.0}, "aspect must be"),
        ({"up": (0, 0, 0)}, "up must be"),
        ({"domain": [[0, 0, 0], [0, 1, 1]]}, "domain must be"),
        ({"leaf_depth": 11}, "leaf_depth must be"),
        ({"reach": 0.0}, "reach must be"),
        ({"shell": -1}, "shell must be"),
        ({"images_per_frame": 0}, "images_per_frame must be an integer from 1 to 16"),
        ({"method": "exact"}, "method must be"),
        ({"directions": "up"}, "directions must be"),
        ({"method": "paper", "directions": "sphere"}, "level gazes"),
        ({"image_fov": 30.0}, "image_fov must be"),
    ],
)
def test_bad_arguments_are_named(scene, arguments, words):
    with pytest.raises(ValueError, match=words):
        cyc.place_images(scene, **({"budget": BUDGET, "progress": False} | arguments))


def test_a_budget_that_is_enough_where_the_proof_stopped_is_not_said_to_be_too_small():
    said = search._too_small(3000, 7, 1525, [-0.91, -0.49, -0.84], 30.8, 0.0, 374)
    assert said.startswith("no proof was found for budget 3000: an eye at [-0.91, -0.49, -0.84]")
    assert "can be served with 1525 faces" in said


def test_scenes_without_room_are_refused():
    flat = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 2, 3]])
    with pytest.raises(ValueError, match="flat"):
        cyc.place_images(flat, 1, progress=False)
    box = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    together = cyc.Scene(box, np.tile([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]], (50, 1)))
    with pytest.raises(ValueError, match="budget 10 is too small"):
        cyc.place_images(together, 10, progress=False)


def test_one_primitive_has_nothing_to_put_behind_an_image():
    one = cyc.Scene([[0, 0, 0], [1, 0, 0.5], [0, 1, 1]], [[0, 1, 2]])
    with pytest.raises(ValueError, match="fewer than two faces"):
        cyc.place_images(one, 1, progress=False)


def test_levels_of_detail_keep_what_is_transparent():
    fine, coarse = cyc.scenes.sphere(320), cyc.scenes.sphere(80)
    glass = cyc.Scene(fine.vertices, fine.faces, transparent=np.arange(len(fine)) < 7)
    both = placement.plan.joined(glass, [(coarse, 1.0)])
    assert both.transparent.sum() == 7 and both.transparent[:7].all() and len(both) == len(fine) + len(coarse)
    assert placement.plan.joined(fine, [(coarse, 1.0)]).transparent is None


@pytest.mark.parametrize(
    ("eye", "gaze", "words"),
    [
        ([np.nan, 0, 0], [1, 0, 0], "must be finite"),
        ([0, 0, 0], [0, 0, 0], "forward is zero"),
        ([0, 0, 0], [1, 0.1, 0], "pitched by 5.7"),
        ([0, 0], [1, 0, 0], "shape"),
    ],
)
def test_frames_of_bad_eyes_are_refused(plan, eye, gaze, words):
    with pytest.raises(ValueError, match=words):
        plan.frame(eye, gaze)


def test_out_is_checked_and_used(plan):
    out = np.empty(BUDGET, np.uint32)
    assert np.shares_memory(plan.frame([0, 0, 0], [1, 0, 0], out).faces, out)
    with pytest.raises(ValueError, match="out must be"):
        plan.frame([0, 0, 0], [1, 0, 0], out[:10])


@pytest.mark.parametrize("images", [0, -1, 1.5, "2"])
def test_a_frame_has_one_image_at_least(plan, images):
    with pytest.raises(ValueError, match="images must be an integer of at least 1"):
        plan.frame([0, 0, 0], [1, 0, 0], images=images)


def test_up_may_be_z(scene):
    turned = cyc.Scene(scene.vertices[:, [2, 0, 1]], scene.faces)
    plan = cyc.place_images(turned, BUDGET, up=(0, 0, 1), progress=False)
    assert plan.check(100, progress=False).is_sound


def test_a_grid_s_plan_answers_as_others_do(tmp_path):
    scene = cyc.scenes.pipes(20_000)
    plan = cyc.place_images(
        scene, 13_000, method="paper", leaf_depth=3, lookahead=0, star_shape="paper", progress=False
    )
    assert plan.check(300, progress=False).violations == 0 or plan.gaps > 0
    if plan.gaps == 0:
        assert plan.certify() == len(plan.proof)
        assert plan.check(300, progress=False).is_sound
    else:
        with pytest.raises(ValueError, match=r"left by image"):
            plan.certify()
    corners, mine = plan.grid.images.corners, plan.images.corners[: len(plan.images) - plan.shell]
    np.testing.assert_allclose(mine[:, 0], corners[:, 0], atol=1e-7)
    assert len(np.unique(plan.grid.images.viewpoint)) == len(plan.viewpoints) - plan.shell
    plan.save(tmp_path / "plan.npz")
    again = placement.Plan.load(tmp_path / "plan.npz", scene)
    assert again.grid is None and again.gaps == plan.gaps


def test_aimed_frames_find_eyes_outside_the_paper_s_star_shapes():
    plan = placement.place_on_grid(cyc.scenes.pipes(20_000), 10_000, leaf_depth=3, lookahead=0, star_shape="paper")
    eyes, gazes = plan.aimed_frames(400)
    far, random = plan.away(eyes, gazes), plan.away(*plan._random_frames(400, 0))
    assert (far > 1).sum() > 10 * (random > 1).sum() + 10


def coarser(scene, size):
    """A level of detail: vertices rounded to a grid, without the faces that this leaves flat."""
    cells, vertices = np.unique(np.round(scene.vertices / size), axis=0, return_inverse=True)
    faces = vertices.reshape(-1)[scene.faces]
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return cyc.Scene(cells * size, faces[~flat])


@pytest.fixture(scope="module")
def leveled(scene):
    level = coarser(scene, 0.15)
    assert len(level) < 0.7 * len(scene)
    return cyc.place_images(scene, BUDGET, lod=[(level, 0.9)], progress=False)


def test_levels_of_detail_save_images_and_leave_nothing_out(plan, leveled):
    assert len(leveled.images) < len(plan.images)
    assert leveled.certify() == len(leveled.proof)
    assert leveled.check(500, progress=False).is_sound
    eyes, gazes = placement.check.random_frames(leveled, 60, 5)
    (level, distance) = leveled.lod[0]
    for eye, gaze in zip(eyes, gazes, strict=True):
        frame = leveled.frame(eye, gaze)
        assert len(frame.faces) + len(frame.levels[0]) <= BUDGET
        for scene, drawn, is_level in (
            (leveled.scene, frame.faces, lambda away: away < distance),
            (level, frame.levels[0], lambda away: away >= distance),
        ):
            of = Levels(scene, leveled.fov_x, leveled.aspect)
            outside, behind = brute_force(of, eye, gaze, frame.image)
            there = np.zeros(len(scene), bool)
            there[drawn] = True
            away = np.linalg.norm(scene.vertices.astype(float)[scene.faces] - eye, axis=2)
            # A face with any corner at its level's distances is there.
            assert (there | outside | behind | ~is_level(away).any(axis=1)).all()


class Levels:
    """What `brute_force` asks of a plan."""

    def __init__(self, scene, fov_x, aspect):
        self.scene, self.fov_x, self.aspect = scene, fov_x, aspect


def test_levels_of_detail_come_with_the_file(leveled, tmp_path):
    # NumPy looks at the corner of the domain that the proof starts from.
    header, arrays = leveled._certificate()
    low, high = leveled.domain
    mine = (arrays["boxes"][:, 3:6] <= low + (high - low) * 0.2500001).all(axis=1)
    arrays |= {"boxes": arrays["boxes"][mine], "served": arrays["served"][mine]}
    header["domain"] = [low.tolist(), arrays["boxes"][:, 3:6].max(axis=0).tolist()]
    assert check_proof(header, arrays, leveled.whole) == mine.sum() > 0
    leveled.save(tmp_path / "plan.npz")
    with pytest.raises(ValueError, match="levels of detail"):
        placement.Plan.load(tmp_path / "plan.npz", leveled.scene)
    again = placement.Plan.load(tmp_path / "plan.npz", leveled.scene, leveled.lod)
    a, b = leveled.frame([0, 0, -0.9], [0, 0, 1]), again.frame([0, 0, -0.9], [0, 0, 1])
    np.testing.assert_array_equal(a.levels[0], b.levels[0])


def test_a_level_drawn_too_late_is_found(leveled):
    # Said to be drawn from another distance than it is, the level leaves something out.
    object.__setattr__(leveled, "lod", ((leveled.lod[0][0], 1.2),))
    try:
        assert not leveled.check(300, progress=False).is_sound
    finally:
        object.__setattr__(leveled, "lod", ((leveled.lod[0][0], 0.9),))


def test_what_cannot_be_seen_saves_images(scene, plan, tmp_path):
    rng = np.random.default_rng(0)
    low, high = plan.domain
    middle = (low + high) / 2
    halves = [(low, [middle[0], *high[1:]]), ([middle[0], *low[1:]], high)]
    seen = [np.flatnonzero(rng.random(len(scene)) < 0.8) for _ in halves]
    sight = [(*half, ids) for half, ids in zip(halves, seen, strict=True)]
    less = cyc.place_images(scene, BUDGET, visibility=sight, progress=False)
    assert len(less.images) < len(plan.images)
    assert less.certify(tmp_path / "proof.npz") == len(less.proof) == verify(tmp_path / "proof.npz", scene)
    assert less.check(500, progress=False).is_sound
    for eye, gaze in zip(*placement.check.random_frames(less, 60, 5), strict=True):
        frame = less.frame(eye, gaze)
        outside, behind = brute_force(less, eye, gaze, frame.image)
        visible = np.zeros(len(scene), bool)
        visible[seen[int(eye[0] > middle[0])]] = True
        drawn = np.zeros(len(scene), bool)
        drawn[frame.faces] = True
        assert (drawn | outside | behind | ~visible).all()
        assert not (drawn & ~visible).any()
    less.save(tmp_path / "plan.npz")
    assert placement.Plan.load(tmp_path / "plan.npz", scene).check(100, progress=False).is_sound


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"visibility": 0}, "visibility must be 1 to"),
        ({"visibility": [([-1, -1, -1], [0, 1, 1], [0])], "domain": [[-1, -1, -1], [1, 1, 1]]}, "0.5 of its volume"),
        ({"visibility": [([-1, -1, -1], [1, 1, 1], [20_000])]}, r"visibility\[0\] must have faces from 0 to 19999"),
        ({"lod": [(cyc.scenes.sphere(80), 0.0)]}, "lod must have ascending distances"),
    ],
)
def test_bad_levels_and_regions_are_named(scene, change, words):
    with pytest.raises(ValueError, match=words):
        cyc.place_images(scene, BUDGET, progress=False, **change)


def test_several_images_of_a_frame_leave_fewer_faces_and_lose_none(scene, plan, tmp_path):
    several = replace(plan, images_per_frame=3)
    eyes, gazes = placement.check.random_frames(plan, 150, 3)
    counts, fewer = [], 0
    for eye, gaze in zip(eyes, gazes, strict=True):
        one, frame = plan.frame(eye, gaze), several.frame(eye, gaze)
        counts.append(len(frame.images))
        assert (frame.image is None) == (one.image is None)
        if frame.image is None:
            continue
        assert frame.image.index == one.image.index
        assert np.isin(frame.faces, one.faces).all()
        fewer += len(frame.faces) < len(one.faces)
        there = np.zeros(len(scene), bool)
        there[frame.faces] = True
        outside, behind = brute_force(plan, eye, gaze, frame.image)
        for image in frame.others:
            assert image.index < len(plan.images) - plan.shell and image.index != frame.image.index
            assert image.forward @ eye < image.forward @ image.corners[0]
            # The viewpoint sees the eye in the frustum of the same gaze.
            assert is_seen(plan, image.viewpoint, gaze, eye)
            behind |= brute_force(plan, eye, gaze, image)[1]
        assert (there | outside | behind).all()
    assert max(counts) == 3 and fewer > 10
    several.save(tmp_path / "plan.npz")
    assert placement.Plan.load(tmp_path / "plan.npz", scene).images_per_frame == 3


def is_seen(plan, viewpoint, gaze, point):
    """Whether a point lies in the frustum of an eye, to rounding."""
    forward = np.asarray(gaze) / np.linalg.norm(gaze)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    x, y, z = (point - viewpoint) @ np.column_stack([right, np.cross(right, forward), forward])
    tan = np.tan(np.radians(plan.fov_x / 2)) * z + 1e-9
    return abs(x) <= tan and abs(y) <= tan / plan.aspect


def test_an_image_serves_with_others_until_the_eye_comes_to_its_plane(plan):
    several, images = plan._several, plan.images
    own = len(images) - plan.shell
    for index in range(own):
        viewpoint, forward = plan.viewpoints[images.viewpoint[index]], images.forward[index]
        distance = (images.corners[index, 0] - viewpoint) @ forward
        yaw, pitch = plan.angles(forward)
        for share, serves in ((0.01, True), (0.99, True), (1.01, False), (3.0, False), (-0.01, False)):
            assert (index in several.serving(viewpoint + share * distance * forward, yaw, pitch)) == serves
    # One of the shell would stand for all.
    assert several.serving(plan.domain.mean(axis=0), 0.0, 0.0).max(initial=-1) < own
