"""Close looks: what they find, and which faces they would have found without the eyes that saw them."""

import numpy as np

import cyclorama as cyc
from cyclorama.bitfield import unpack
from cyclorama.gaps import _close_up, look_closely
from cyclorama.region import visible_from

BOX = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.5]])


def strip(count=8, width=0.2, distance=6.0):
    """Upright quads side by side along x, two faces each, at a distance in front of the box."""
    left = width * (np.arange(count) - count / 2)
    corners = np.array([[0, -0.1], [width, -0.1], [width, 0.1], [0, 0.1]])
    vertices = [[x + dx, y, -distance] for x in left for dx, y in corners]
    faces = [[4 * k + i for i in half] for k in range(count) for half in ((0, 1, 2), (0, 2, 3))]
    return cyc.Scene(vertices, faces)


def closely(scene, rare, eyes, sightings, seen, most=64):
    rng = np.random.default_rng(0)
    return look_closely(
        scene,
        BOX,
        np.array(rare, int),
        np.array(eyes, float),
        np.array(sightings, bool),
        np.isin(np.arange(len(scene)), seen),
        lambda count: rng.uniform(*BOX, (count, 3)),
        most=most,
        resolution=64,
        fill="rays",
        seed=0,
        threads=1,
    )


def test_what_lies_beside_a_rare_face_is_found_and_where_from():
    scene = strip()
    found = closely(scene, [6], [[0, 0, 0]], [[True]], [6])
    new = np.concatenate(found.faces)
    assert sorted(new.tolist()) == [face for face in range(16) if face != 6]
    assert len(found.eyes) == len(found.faces)
    assert ((found.eyes >= BOX[0]) & (found.eyes <= BOX[1])).all()
    for eye, faces in zip(found.eyes, found.faces, strict=True):
        camera = _close_up(eye, scene.vertices[scene.faces[faces[0]]], 128)
        assert faces[0] in np.flatnonzero(unpack(scene.visible(camera, progress=False).words, len(scene))[0])


def test_only_what_another_eye_led_to_is_found_again():
    """A look that an eye's own sighting led to says nothing of what would be known without that eye."""
    scene = strip(count=2)
    alone = closely(scene, [1], [[0, 0, 0]], [[True]], range(4))
    assert not alone.again.any()
    eyes = [[0, 0, 0], [0.5, 0, 0]]
    apart = closely(scene, [1, 2], eyes, [[True, False], [False, True]], range(4))
    assert apart.again.all()
    one_eye = closely(scene, [1, 2], eyes, [[True, True], [False, False]], range(4))
    assert not one_eye.again.any()


def test_faces_far_from_all_rare_ones_are_not_looked_at():
    near, far = strip(count=2), strip(count=2, distance=-9.0)
    scene = cyc.Scene(
        np.concatenate([near.vertices, far.vertices]), np.concatenate([near.faces, far.faces + len(near.vertices)])
    )
    found = closely(scene, [0], [[0, 0, 0]], [[True]], [0])
    assert sorted(np.concatenate(found.faces).tolist()) == [1, 2, 3]


def test_without_rare_faces_nothing_is_spent():
    found = closely(strip(), [], np.empty((0, 3)), np.empty((0, 0)), [])
    assert len(found.eyes) == len(found.faces) == len(found.again) == 0


def test_they_find_most_of_what_more_eyes_would():
    """And nothing that cannot be seen: each face has a witness."""
    left = {False: 0, True: 0}
    for seed in range(3):
        scene = cyc.scenes.house(rooms=4, seed=seed)
        low, high = scene.cells[0]["min"] + 0.3, scene.cells[0]["min"] + 1.2
        options = {"resolution": 96, "patience": 200, "progress": False}
        long = visible_from(scene, low, high, max_eyes=200, seed=1, **options)
        regions = {guided: visible_from(scene, low, high, max_eyes=64, guided=guided, **options) for guided in left}
        for guided, region in regions.items():
            left[guided] += len(np.setdiff1d(long.faces, region.faces))
        plain, closely = regions.values()
        assert np.isin(plain.faces, closely.faces).all()
        assert (closely.first >= len(plain.eyes)).sum() == len(closely.faces) - len(plain.faces)
        counts = np.bincount(closely.first, minlength=len(closely.eyes))
        np.testing.assert_array_equal(counts.cumsum(), closely.growth)
        _, points = closely.witnesses(scene)
        assert np.isfinite(points).all(axis=1).mean() > 0.97
    assert left[True] < 0.5 * left[False]
