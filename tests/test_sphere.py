"""Viewpoint spheres against SciPy's Qhull and HiGHS, trimesh's rays, and plain NumPy."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import cyclorama as cyc
from cyclorama import Bitfields, sphere

DIRECTIONS = np.random.default_rng(100).normal(size=(4000, 3))


def triple(points, faces, directions):
    """(M, F, 3) triple products: positive where a direction is to the left of an edge."""
    a, b = points[faces], points[np.roll(faces, -1, axis=1)]
    return np.einsum("fek,mk->mfe", np.cross(a, b), directions)


def assert_a_sphere(points, faces):
    """Closed, consistently outward, every point used, each direction covered once."""
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.Trimesh(points, faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.euler_number == 2
    assert np.unique(faces).size == len(points)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    volumes = np.einsum("fk,fk->f", a, np.cross(b, c))
    assert (volumes > 0).all()


def random_positions(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)) * rng.uniform(0.5, 3.0, size=(n, 1))


SPHERES = {
    "octahedron 0": sphere.octahedron(0),
    "octahedron 3": sphere.octahedron(3),
    "fibonacci 25": (sphere.fibonacci(25), sphere.hull(sphere.fibonacci(25))),
    "free 300": (random_positions(300), sphere.hull(random_positions(300))),
    "split": sphere.subdivide(*sphere.octahedron(1), [0, 5, 9])[:2],
}


@pytest.fixture(params=SPHERES, ids=str)
def any_sphere(request):
    return SPHERES[request.param]


# octahedral and Fibonacci spheres ------------------------------------------------------------------------------


@pytest.mark.parametrize("level, count", list(enumerate([6, 18, 66, 258, 1026, 4098])))
def test_octahedral_spheres_have_the_papers_sizes(level, count):
    points, faces = sphere.octahedron(level)
    assert points.shape == (count, 3) and points.dtype == np.float64
    assert faces.shape == (8 * 4**level, 3) and faces.dtype == np.uint32
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, rtol=0, atol=3e-16)
    assert_a_sphere(points, faces)


def test_coarse_points_come_first_and_children_lie_in_their_parents():
    points, faces = sphere.octahedron(3)
    finer_points, finer_faces = sphere.octahedron(4)
    np.testing.assert_array_equal(finer_points[: len(points)], points)
    centers = finer_points[finer_faces].mean(axis=1)
    np.testing.assert_array_equal(sphere.locate(points, faces, centers), np.arange(len(finer_faces)) // 4)


@pytest.mark.parametrize("n", [1, 4, 14, 25, 55, 1000])
def test_fibonacci_points_are_balanced(n):
    points = sphere.fibonacci(n)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-15)
    # Zones of equal area: along the axis the mean is zero, and around it the golden angle balances.
    assert abs(points[:, 1].mean()) < 1e-12
    assert np.abs(points.mean(axis=0)).max() <= (1 if n == 1 else 1.5 / n)


def test_fibonacci_points_leave_no_hole():
    """The farthest that a direction is from its nearest sample, against the best any n points could do."""
    for n in (14, 25, 55):
        points = sphere.fibonacci(n)
        faces = sphere.hull(points)
        a, b, c = np.moveaxis(points[faces], 1, 0)
        normals = np.cross(b - a, c - a)
        radius = np.arccos(np.einsum("fk,fk->f", normals, a) / np.linalg.norm(normals, axis=1))
        # Fejes Tóth: 2 n - 4 equilateral triangles.
        omega = np.pi * n / (6 * (n - 2))
        best = np.arccos(1 / (np.sqrt(3) * np.tan(omega)))
        assert best <= radius.max() < 1.45 * best


# hulls ---------------------------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(st.integers(12, 200), st.integers(0, 2**32 - 1))
def test_hulls_are_qhulls(n, seed):
    spatial = pytest.importorskip("scipy.spatial")
    positions = random_positions(n, seed)
    points = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    qhull = spatial.ConvexHull(points)
    if (qhull.equations[:, 3] > -1e-3).any():
        return  # Does not surround the origin.
    faces = sphere.hull(positions)
    expected = np.unique(np.sort(qhull.simplices, axis=1), axis=0)
    np.testing.assert_array_equal(np.unique(np.sort(faces, axis=1), axis=0), expected)
    assert_a_sphere(points, faces)


def many_on_a_circle():
    turn = np.arange(0, 360, 5)
    x, z = 0.8 * np.cos(np.radians(turn)), 0.8 * np.sin(np.radians(turn))
    return np.concatenate([np.stack([x, np.full_like(x, y), z], axis=1) for y in (0.6, -0.6)])


def coprime_lattice():
    steps = np.array(list(itertools.product(range(-4, 5), repeat=3)))
    return steps[np.gcd.reduce(steps, axis=1) == 1].astype(float)


@pytest.mark.parametrize(
    "positions",
    [
        np.array(list(itertools.product((-1.0, 1.0), repeat=3))),
        np.concatenate([np.eye(3), -np.eye(3)]),
        np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]]),
        sphere.octahedron(4)[0],
        many_on_a_circle(),
        coprime_lattice(),
    ],
    ids=["cube", "octahedron", "tetrahedron", "octahedron 4", "two rings", "lattice"],
)
def test_points_on_common_circles_all_stay(positions):
    spatial = pytest.importorskip("scipy.spatial")
    faces = sphere.hull(positions)
    points = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    assert faces.shape == (2 * len(points) - 4, 3)
    assert_a_sphere(points, faces)
    trimesh = pytest.importorskip("trimesh")
    volume = trimesh.Trimesh(points, faces, process=False).volume
    assert volume == pytest.approx(spatial.ConvexHull(points).volume, rel=1e-12)


def test_a_hull_does_not_depend_on_distances_or_on_the_frame():
    points = sphere.fibonacci(500)
    faces = sphere.hull(points)
    np.testing.assert_array_equal(sphere.hull(points * np.random.default_rng(1).uniform(0.1, 1e9, (500, 1))), faces)
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    np.testing.assert_array_equal(sphere.hull(points @ rotation.T), faces)


def ring(n, height=0.0):
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([np.cos(turn), np.full(n, height), np.sin(turn)], axis=1)


@pytest.mark.parametrize(
    "positions, message",
    [
        (np.eye(3), "at least 4"),
        (
            np.concatenate([np.eye(3), -np.eye(3), [[0, 0, 2.0]]]),
            r"points\[2\] and points\[6\] have the same direction",
        ),
        (
            np.concatenate([np.eye(3), -np.eye(3), [[1, 5e-7, 0]]]),
            r"points\[0\] and points\[6\] have the same direction",
        ),
        (np.concatenate([np.eye(3), -np.eye(3), [[0, 0, 0.0]]]), r"points\[6\] is \[0.0, 0.0, 0.0\]: a zero vector"),
        (np.concatenate([np.eye(3), [[0, np.nan, 1]], -np.eye(3)]), r"points\[3\].*must be finite"),
        (np.concatenate([np.eye(3), [[0, np.inf, 1]], -np.eye(3)]), r"points\[3\].*must be finite"),
        (ring(12), "in one plane"),
        (ring(12) @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0], "in one plane"),
        (ring(12, 0.5), "in one plane"),
        (np.concatenate([ring(12), [[0, 1, 0]]]), "none lies within 90 degrees of direction"),
        (np.concatenate([ring(12, 0.1), [[0, 1, 0]]]), r"direction \(-?0.0000, -1.0000, -?0.0000\)"),
        (np.zeros((5, 2)), r"shape \(N, 3\)"),
        (np.array([["a", "b", "c"]]), "real numbers"),
        (np.zeros((0, 3)), "at least 4"),
    ],
)
def test_positions_that_make_no_sphere_are_refused(positions, message):
    with pytest.raises(ValueError, match=message):
        sphere.hull(positions)


def test_positions_a_little_beyond_the_half_space_surround():
    """The limit itself: from the hemisphere's rim down by 1e-5 radians there is a hull, by 1e-7 there is none."""
    up = [[0, 1, 0]]
    for depth, surrounds in ((1e-5, True), (1e-7, False)):
        positions = np.concatenate([ring(12, -depth), up])
        if surrounds:
            assert_a_sphere(positions, sphere.hull(positions))
        else:
            with pytest.raises(ValueError, match="do not surround"):
                sphere.hull(positions)


# look-up -------------------------------------------------------------------------------------------------------


def test_located_faces_hold_their_directions(any_sphere):
    points, faces = any_sphere
    located = sphere.locate(points, faces, DIRECTIONS)
    assert located.dtype == np.uint32
    inside = triple(points, faces, DIRECTIONS).min(axis=2)
    # Exactly one face holds a random direction; NumPy's rounding decides nothing at this distance from an edge.
    clear = np.abs(inside).min(axis=1) > 1e-13
    assert clear.mean() > 0.999
    np.testing.assert_array_equal(located[clear], inside.argmax(axis=1)[clear])
    assert ((inside > 0).sum(axis=1)[clear] == 1).all()


def test_located_faces_are_the_first_that_trimeshs_rays_meet(any_sphere):
    trimesh = pytest.importorskip("trimesh")
    points, faces = any_sphere
    mesh = trimesh.Trimesh(points, faces, process=False)
    hit = trimesh.ray.ray_triangle.RayMeshIntersector(mesh).intersects_first(np.zeros((500, 3)), DIRECTIONS[:500])
    np.testing.assert_array_equal(sphere.locate(points, faces, DIRECTIONS[:500]), hit)


def test_a_direction_through_a_point_belongs_to_the_first_face_around_it(any_sphere):
    points, faces = any_sphere
    first = [np.flatnonzero((faces == v).any(axis=1))[0] for v in range(len(points))]
    np.testing.assert_array_equal(sphere.locate(points, faces, points), first)


def test_poles_edges_and_extreme_lengths_have_an_answer():
    points, faces = sphere.octahedron(2)
    signs = [0.0, -0.0, 5e-324, -5e-324, 1e-310, 1.0, -1.0, 1e308]
    directions = np.array([d for d in itertools.product(signs, repeat=3) if any(d)])
    located = sphere.locate(points, faces, directions)
    unit = directions / np.abs(directions).max(axis=1, keepdims=True)
    inside = triple(points, faces, unit).min(axis=2)
    assert (inside[np.arange(len(unit)), located] > -1e-15).all()
    # The sign of a zero decides nothing.
    np.testing.assert_array_equal(sphere.locate(points, faces, directions + 0.0), located)
    half = [[1, 1, 0], [2, 2, -0.0], [1e-300, 1e-300, 0]]
    assert len(set(sphere.locate(points, faces, half))) == 1


@settings(max_examples=50, deadline=None)
@given(hnp.arrays(np.float64, 3, elements=st.floats(-1e6, 1e6)), st.floats(1e-3, 1e3))
def test_length_does_not_matter(direction, length):
    if not direction.any():
        return
    points, faces = SPHERES["free 300"]
    exponent = np.floor(np.log2(length))
    one, other = sphere.locate(points, faces, [direction, direction * 2.0**exponent])
    assert one == other


def test_faces_of_very_different_size_are_found():
    points, faces = sphere.octahedron(1)
    for _ in range(12):
        points, faces, _ = sphere.subdivide(points, faces, sphere.locate(points, faces, [[0.2, 0.9, -0.3]]))
    near = np.array([0.2, 0.9, -0.3]) + DIRECTIONS * np.logspace(-6, 0, len(DIRECTIONS))[:, None]
    inside = triple(points, faces, near).min(axis=2)
    located = sphere.locate(points, faces, near)
    assert (inside[np.arange(len(near)), located] >= inside.max(axis=1) - 1e-15).all()


@pytest.mark.parametrize("direction", [[0, 0, 0], [0, np.nan, 1], [np.inf, 0, 0]])
def test_vectors_without_direction_are_named(direction):
    directions = np.ones((3000, 3))
    directions[2000] = directions[2500] = direction
    with pytest.raises(ValueError, match=r"directions\[2000\]"):
        sphere.locate(*sphere.octahedron(1), directions)


def test_faces_that_are_no_sphere_are_refused():
    points, faces = sphere.octahedron(1)
    for wrong, message in [
        (faces[:-1], "nothing across its edge"),
        (faces[:, ::-1], "counter-clockwise"),
        (np.where(faces == 17, 18, faces), r"faces\[.*\] is 18, there are 18 points"),
        (faces.astype(np.int64) - 1, r"faces\[.*\] is -1"),
        (faces[:0], "empty"),
        (faces.astype(float), "integers"),
        (np.concatenate([faces, faces]), "both have the edge"),
    ]:
        with pytest.raises(ValueError, match=message):
            sphere.Locator(points, wrong)


def test_a_kept_locator_answers_the_same_and_into_an_array_given(any_sphere):
    points, faces = any_sphere
    locator, out = sphere.Locator(points, faces), np.empty(len(DIRECTIONS), dtype=np.uint32)
    assert locator.locate(DIRECTIONS, out=out) is out
    np.testing.assert_array_equal(out, sphere.locate(points, faces, DIRECTIONS))
    for count in (3, 6):
        np.testing.assert_array_equal(locator.surrounding(out, count), sphere.surrounding(faces, out, count))
    read_only = out.view()
    read_only.flags.writeable = False
    for wrong in (out[:-1], out.astype(np.int64), out[None], read_only, np.repeat(out, 2)[::2]):
        with pytest.raises(ValueError, match="out "):
            locator.locate(DIRECTIONS, out=wrong)
    with pytest.raises(ValueError, match="face is"):
        locator.surrounding(len(faces))


def test_no_directions_have_no_faces():
    assert sphere.locate(*sphere.octahedron(1), np.empty((0, 3))).shape == (0,)


# surrounding samples -------------------------------------------------------------------------------------------


def test_six_samples_are_the_corners_and_those_across_the_edges(any_sphere):
    _, faces = any_sphere
    three, six = sphere.surrounding(faces, np.arange(len(faces))), sphere.surrounding(faces, np.arange(len(faces)), 6)
    np.testing.assert_array_equal(three, faces)
    np.testing.assert_array_equal(six[:, :3], faces)
    for face, samples in zip(faces, six, strict=True):
        for i in range(3):
            shared = {face[i], face[(i + 1) % 3]}
            beyond = [set(other) - shared for other in faces if shared < set(other) and set(other) != set(face)]
            assert beyond == [{samples[3 + i]}]


def test_shapes_follow_the_faces_asked_for():
    _, faces = sphere.octahedron(1)
    assert sphere.surrounding(faces, 3).shape == (3,)
    assert sphere.surrounding(faces, 3, 6).shape == (6,)
    assert sphere.surrounding(faces, [3, 4], 6).shape == (2, 6)
    assert sphere.surrounding(faces, []).shape == (0, 3)
    for face, count, message in [(32, 3, "face is 32"), ([0, -1], 6, r"face\[1\] is -1"), (0, 4, "3 or 6")]:
        with pytest.raises(ValueError, match=message):
            sphere.surrounding(faces, face, count)


# eyes off the sampling sphere ----------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [1.05, 1.5, 2.0, 2.1, 4.0, 100.0, 1e6])
@pytest.mark.parametrize("radius", [0.3, 0.99, 1.0])
def test_rays_to_the_ball_cross_the_sampling_sphere_within_the_angle(radius, distance):
    sampling = 2.0
    eye = np.array([0, 0, distance])
    rng = np.random.default_rng(3)
    inside = rng.normal(size=(20_000, 3))
    inside *= radius * rng.uniform(0.9, 1, (20_000, 1)) / np.linalg.norm(inside, axis=1, keepdims=True)
    rays = inside - eye
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    # The first crossing of the line, which is behind an eye inside the sphere.
    along = -(rays @ eye)
    crossing = eye + (along - np.sqrt(along**2 - distance**2 + sampling**2))[:, None] * rays
    angle = np.degrees(np.arctan2(np.linalg.norm(crossing[:, :2], axis=1), crossing[:, 2]))
    bound = sphere.crossing_angle(radius, sampling, distance)
    assert angle.max() <= bound + 1e-6
    assert angle.max() >= 0.97 * bound


def test_faces_within_the_crossing_angle_are_all_that_a_far_eyes_rays_cross():
    points, faces = sphere.octahedron(3)
    locator = sphere.Locator(points, faces)
    rng = np.random.default_rng(4)
    for distance in (3.0, 30.0):
        eye = rng.normal(size=3)
        eye *= distance / np.linalg.norm(eye)
        targets = rng.normal(size=(20_000, 3))
        targets /= np.linalg.norm(targets, axis=1, keepdims=True)
        rays = targets - eye
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        along = -(rays @ eye)
        crossing = eye + (along - np.sqrt(along**2 - distance**2 + 2.0**2))[:, None] * rays
        crossed = np.unique(locator.locate(crossing))
        given = sphere.faces_in_cap(points, faces, eye, sphere.crossing_angle(1.0, 2.0, distance))
        assert np.isin(crossed, given).all()
        assert len(given) <= len(crossed) + 8
        # A single look-up, which the 2002 paper (section 4.3) holds to be enough from afar, is far from it.
        assert len(crossed) > 10


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 180))
def test_a_cap_meets_the_faces_that_densely_drawn_points_say(seed, angle):
    points, faces = SPHERES["octahedron 3"]
    direction = np.random.default_rng(seed).normal(size=3)
    direction /= np.linalg.norm(direction)
    steps = np.linspace(0, 1, 25)
    weights = np.array([(a, b, 1 - a - b) for a in steps for b in steps if a + b <= 1 + 1e-9])
    drawn = np.einsum("wk,fkx->fwx", weights, points[faces])
    drawn /= np.linalg.norm(drawn, axis=2, keepdims=True)
    nearest = np.degrees(np.arccos(np.clip(drawn @ direction, -1, 1).max(axis=1)))
    given = np.zeros(len(faces), dtype=bool)
    given[sphere.faces_in_cap(points, faces, direction, angle)] = True
    assert given[nearest < angle].all()
    # Drawn points are at most half a degree from any other of their face.
    assert (nearest[given] < angle + 0.5).all()


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: sphere.crossing_angle(1, 2, 0.5), "radius must be positive"),
        (lambda: sphere.crossing_angle(3, 2, 5), "radius must be positive"),
        (lambda: sphere.crossing_angle(0, 2, 5), "radius must be positive"),
        (lambda: sphere.crossing_angle(1, np.nan, 5), "radius must be positive"),
        (lambda: sphere.crossing_angle(1, 2, np.nan), "radius must be positive"),
        (lambda: sphere.faces_in_cap(*sphere.octahedron(0), [0, 0, 0], 10), r"direction\[0\]"),
        (lambda: sphere.faces_in_cap(*sphere.octahedron(0), [0, 0, 1], -1), "angle must be between"),
        (lambda: sphere.faces_in_cap(*sphere.octahedron(0), [0, 0, 1], np.nan), "angle must be between"),
        (lambda: sphere.faces_in_cap(*sphere.octahedron(0), [0, 1], 10), "shape"),
        (lambda: sphere.octahedron(-1), "level must be an integer from 0 to 10, got -1"),
        (lambda: sphere.octahedron(11), "level must be an integer from 0 to 10, got 11"),
        (lambda: sphere.octahedron(1.5), "level must be an integer"),
        (lambda: sphere.fibonacci(0), "n must be an integer from 1 to 16777216, got 0"),
        (lambda: sphere.fibonacci(10**12), "n must be an integer from 1 to 16777216, got 1000000000000"),
        (lambda: sphere.fibonacci(-3), "n must be an integer from 1 to 16777216, got -3"),
        (lambda: sphere.subdivide(*sphere.octahedron(0), [8]), r"which\[0\] is 8, there are 8 faces"),
        (lambda: sphere.subdivide(*sphere.octahedron(0), [[1]]), "which must have shape"),
        (lambda: sphere.subdivide(*sphere.octahedron(0), [0.5]), "which must be integers"),
    ],
)
def test_bad_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# splitting -----------------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(sorted(SPHERES)), st.lists(st.integers(0, 7), max_size=6))
def test_a_split_sphere_is_a_sphere_and_parts_lie_in_their_parents(name, which):
    points, faces = SPHERES[name]
    finer_points, finer_faces, parents = sphere.subdivide(points, faces, which)
    assert_a_sphere(finer_points, finer_faces)
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(finer_points[: len(points)], unit, atol=1e-15)
    kept = np.flatnonzero(np.bincount(parents) == 1)
    np.testing.assert_array_equal(finer_faces[kept], faces[kept])
    assert (np.bincount(parents)[which] == 4).all()
    np.testing.assert_array_equal(
        parents[sphere.locate(finer_points, finer_faces, DIRECTIONS)], sphere.locate(points, faces, DIRECTIONS)
    )


# the fewest samples --------------------------------------------------------------------------------------------


def fewest(seen, tolerance=0.0):
    """The size of the smallest cover, by trying all."""
    needed = seen.any(axis=0).sum() * (1 - tolerance) - 1e-9
    for size in range(len(seen) + 1):
        for rows in itertools.combinations(range(len(seen)), size):
            if seen[list(rows)].any(axis=0).sum() >= needed:
                return size
    raise AssertionError("all rows cover all that any row sees")


small_cases = hnp.arrays(np.bool_, st.tuples(st.integers(1, 8), st.integers(1, 80)), elements=st.booleans())


@settings(max_examples=60, deadline=None)
@given(small_cases, st.sampled_from([0.0, 0.1, 0.5, 1.0]))
def test_a_cover_holds_what_all_rows_hold_and_is_nearly_smallest(seen, tolerance):
    rows = sphere.cover(seen, tolerance)
    assert rows.dtype == np.uint32 and np.unique(rows).size == len(rows)
    covered, all_seen = seen[rows].any(axis=0).sum(), seen.any(axis=0).sum()
    assert covered >= all_seen * (1 - tolerance) - 1e-9
    best = fewest(seen, tolerance)
    if tolerance == 0:
        largest = seen.sum(axis=1).max()
        assert len(rows) <= max(1, (1 / np.arange(1, largest + 1)).sum()) * best
    solved = sphere.cover(seen, tolerance, exact=True)
    assert len(solved.indices) == best == solved.lower_bound and solved.gap == 0
    assert seen[solved.indices].any(axis=0).sum() >= all_seen * (1 - tolerance) - 1e-9


def test_greedy_is_the_plain_greedy():
    """Against the textbook's loop, ties to the first row, before needless rows are dropped."""
    rng = np.random.default_rng(5)
    # A face of its own for each row makes every picked row needed.
    seen = np.concatenate([rng.random((30, 700)) < 0.05, np.eye(30, dtype=bool)], axis=1)
    left, expected = seen.any(axis=0), []
    while left.any():
        expected.append(int((seen & left).sum(axis=1).argmax()))
        left &= ~seen[expected[-1]]
    assert sphere.cover(seen).tolist() == expected


def test_all_ways_to_give_bits_agree():
    seen = np.random.default_rng(6).random((20, 130)) < 0.2
    packed = Bitfields.pack(seen)
    np.testing.assert_array_equal(sphere.cover(packed), sphere.cover(seen))
    np.testing.assert_array_equal(sphere.cover(packed.words), sphere.cover(seen))


def test_a_few_views_of_a_scan_hold_all_that_66_see(real_scene):
    scene = real_scene("bunny")
    points, _ = sphere.octahedron(2)
    cameras = [cyc.Camera.look_at(scene.center + 2.7 * scene.radius * d, scene.center) for d in points]
    seen = scene.visible(cameras, fill=None, progress=False).unpack()
    rows = sphere.cover(seen)
    np.testing.assert_array_equal(seen[rows].any(axis=0), seen.any(axis=0))
    assert len(rows) < 22
    few = sphere.cover(seen, tolerance=0.01)
    assert seen[few].any(axis=0).sum() >= 0.99 * seen.any(axis=0).sum()
    assert len(few) < len(rows) / 2


def test_where_greedy_fails_the_solver_says_so():
    """Johnson's example: two rows hold everything, but each time a third one holds more of what is left."""
    size = 2**6 - 2
    halves = np.arange(2 * size) % 2 == 0
    blocks = np.repeat(np.arange(5), 2 ** np.arange(6, 1, -1))[: 2 * size]
    seen = np.stack([halves, ~halves, *(blocks == b for b in range(5))])
    greedy, solved = sphere.cover(seen), sphere.cover(seen, exact=True)
    assert len(greedy) == 5
    assert solved.indices.tolist() == [0, 1] and solved.lower_bound == 2 and solved.gap == 0


def test_a_solver_out_of_time_still_gives_a_cover_and_a_bound():
    rng = np.random.default_rng(7)
    seen = rng.random((120, 400)) < 0.08
    solved = sphere.cover(seen, exact=True, time_limit=0.2)
    assert seen[solved.indices].any(axis=0).all() or not seen.any(axis=0).all()
    assert 1 <= solved.lower_bound <= len(solved.indices) <= len(sphere.cover(seen))
    assert 0 <= solved.gap < 1


def test_empty_rows_need_no_samples():
    assert sphere.cover(np.zeros((3, 5), dtype=bool)).size == 0
    assert sphere.cover(np.zeros((0, 5), dtype=bool)).size == 0
    assert sphere.cover(np.zeros((3, 0), dtype=bool)).size == 0
    nothing = sphere.cover(np.zeros((3, 5), dtype=bool), exact=True)
    assert nothing.indices.size == 0 and nothing.lower_bound == 0 and nothing.gap == 0


@pytest.mark.parametrize(
    "bits, options, message",
    [
        (np.zeros((2, 3)), {}, "array of uint64 or"),
        (np.zeros(3, dtype=bool), {}, "array of uint64 or"),
        (np.zeros((2, 3), dtype=bool), {"tolerance": -0.1}, "tolerance must be between"),
        (np.zeros((2, 3), dtype=bool), {"tolerance": np.nan}, "tolerance must be between"),
        (np.ones((2, 3), dtype=bool), {"exact": True, "time_limit": 0}, "time_limit must be positive"),
    ],
)
def test_bad_cover_arguments_are_named(bits, options, message):
    with pytest.raises(ValueError, match=message):
        sphere.cover(bits, **options)


def test_without_scipy_the_exact_cover_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    seen = np.ones((2, 3), dtype=bool)
    assert sphere.cover(seen).tolist() == [0]
    with pytest.raises(ImportError, match=r"pip install cyclorama\[mesh\]"):
        sphere.cover(seen, exact=True)
