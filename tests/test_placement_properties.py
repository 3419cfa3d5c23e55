"""Plans of scenes that nobody chose: a second opinion accepts their proofs, and boxes of them hold face by face."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama.placement.verify import verify


def tangle(seed, faces):
    """Faces of any size, in a box of any shape, some of them in a clump."""
    rng = np.random.default_rng(seed)
    centers = rng.uniform(-1, 1, (faces, 1, 3))
    centers[: faces // 4] *= 0.2
    sizes = rng.uniform(0.002, 0.05) * rng.lognormal(0, 0.5, (faces, 1, 1))
    points = (centers + rng.normal(size=(faces, 3, 3)) * sizes) * rng.uniform(0.2, 1, 3)
    return cyc.Scene(points.reshape(-1, 3), np.arange(3 * faces).reshape(-1, 3))


def left_over(plan, eye, forward, image):
    """How many faces are neither outside a plane of the frustum nor behind the image, each corner looked at."""
    right = np.cross(forward, plan.up)
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    points = plan.scene.vertices.astype(float)[plan.scene.faces]
    x, y, z = ((points - eye) @ axis for axis in (right, up, forward))
    tan_x, tan_y = plan.tangents
    outside = np.zeros(len(points), bool)
    for side in (x + z * tan_x, z * tan_x - x, y + z * tan_y, z * tan_y - y):
        outside |= (side < 0).all(axis=1)
    if image is None:
        return int((~outside).sum())
    rays = np.roll(image.corners, -1, axis=0) - image.viewpoint, image.corners - image.viewpoint
    walls = np.cross(*rays)
    walls *= np.sign(walls @ image.forward)[:, None]
    inside = (((points - image.viewpoint) @ walls.T) >= -1e-12).all(axis=(1, 2))
    beyond = ((points - image.corners[0]) @ image.forward >= -1e-12).all(axis=1)
    return int((~outside & ~(inside & beyond)).sum())


def corners_of(box):
    """Eyes and yaws at the corners of a box of the proof, and one within."""
    rng = np.random.default_rng(0)
    ends = np.array([[box[0], box[3]], [box[1], box[4]], [box[2], box[5]], [box[6], box[7]]])
    chosen = rng.integers(0, 2, (3, 4))
    at = np.vstack([ends[np.arange(4), chosen], rng.uniform(ends[:, 0], ends[:, 1])])
    return at[:, :3], at[:, 3]


scenes = st.builds(tangle, st.integers(0, 10_000), st.integers(200, 600))


@settings(max_examples=6, suppress_health_check=[HealthCheck.too_slow])
@given(
    scenes,
    st.floats(0.5, 0.9),
    st.floats(30, 80),
    st.floats(0.7, 2),
    st.sampled_from([(0, 1, 0), (0, 0, -1), (1, 1, 0.5)]),
    st.integers(2, 4),
)
def test_every_box_of_a_proof_keeps_the_budget(tmp_path_factory, scene, share, fov_x, aspect, up, leaf_depth):
    budget = int(share * len(scene))
    options = {"fov_x": fov_x, "aspect": aspect, "up": up, "leaf_depth": leaf_depth, "shell": 0, "progress": False}
    try:
        plan = cyc.place_images(scene, budget, **options)
    except ValueError as error:
        assert "budget" in str(error)
        return
    path = tmp_path_factory.mktemp("proof") / "proof.npz"
    assert plan.certify(path) == verify(path, scene) == len(plan.proof)
    rng = np.random.default_rng(0)
    for row in rng.choice(len(plan.proof), min(60, len(plan.proof)), replace=False):
        served = int(plan.proof.image[row])
        image = plan.image(served) if served >= 0 else None
        for eye, yaw in zip(*corners_of(plan.proof.boxes[row]), strict=True):
            forward = np.cos(yaw) * plan.axes[0] + np.sin(yaw) * plan.axes[1]
            assert left_over(plan, eye, forward, image) <= budget
            if image is not None:
                assert image.forward @ (eye - image.corners[0]) < 0
                assert np.linalg.norm(eye - image.viewpoint) <= 1.2 * np.ptp(plan.domain, axis=0).max() * (1 + 1e-9)
            frame = plan.frame(eye, forward)
            assert len(frame.faces) <= budget


@pytest.mark.parametrize("factor", [2.0**-7, 2.0**9])
def test_the_size_of_a_scene_changes_nothing(factor):
    scene = tangle(3, 400)
    larger = cyc.Scene(scene.vertices * factor, scene.faces)
    one, other = (cyc.place_images(s, 240, shell=0, progress=False) for s in (scene, larger))
    assert len(one.images) > 2
    np.testing.assert_array_equal(one.viewpoints * factor, other.viewpoints)
    np.testing.assert_array_equal(one.proof.image, other.proof.image)
