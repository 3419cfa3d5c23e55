"""Where flat pictures and geometry bent to them fail."""

import numpy as np

import cyclorama as cyc
from cyclorama import geometry_warp

from . import Shown, failure

CORNERS = np.array([[-1.2, 0.9, -3.0], [1.2, 0.9, -3.0], [1.2, -0.9, -3.0], [-1.2, -0.9, -3.0]])


def square_at(distance):
    return CORNERS / 3.0 * distance


@failure(
    "A flat picture has no parallax",
    method="Geometry warping",
    source="found here: a flat picture is right from one viewpoint",
    remedy="Backdrops may be layered images or meshes (`display=`); a plan puts planes as far away as its budget "
    "lets it.",
)
def no_parallax():
    """What lies behind a picture's plane is shown on it. When the eye moves sideways by m it should move by f m / z on
    the screen, and moves by f m / d with the picture at d: f m (1 / d - 1 / z) pixels too far."""
    f, move, depth = 300.0, 0.2, 24.0
    point = np.array([[0.1, -0.2, -depth]])
    curve, expected = {}, {}
    for distance in (2.0, 4.0, 8.0, 16.0):
        eye = np.array([move, 0.0, 0.0])
        camera = cyc.Camera.look_at(
            eye, eye + [0, 0, -1], fov_y=2 * np.degrees(np.arctan(150 / f)), width=400, height=300
        )
        bent = geometry_warp.bend(point, square_at(distance), (0, 0, 0), eye)
        off = camera.project(bent)[0] - camera.project(point)[0]
        curve[distance] = float(np.abs(off).max())
        expected[distance] = f * move * (1 / distance - 1 / depth)
        assert abs(curve[distance] - expected[distance]) < 1e-6
    return Shown(
        "distance of the picture",
        "pixels off the true place",
        {"measured": curve},
        f"The eye moved by 0.2, a point at 24: {curve[2.0]:.1f} pixels off with the picture at 2, "
        f"{curve[16.0]:.1f} at 16, "
        "as the formula says.",
    )


@failure(
    "An eye close to a picture's plane",
    method="Geometry warping",
    source="found here: the double projection has no bound there",
    remedy="On and behind the plane `bend` refuses; a `BackdropWalk` lets go of an image before its plane.",
)
def close_to_the_plane():
    """A picture's pixels grow as the eye comes nearer, without end."""
    curve = {}
    for share in (0.05, 0.25, 0.5, 1.0):
        eye = np.array([0.0, 0.0, -3.0 * (1 - share)])
        camera = cyc.Camera.look_at(eye, eye + [0, 0, -1], fov_y=60, width=400, height=300)
        pair = geometry_warp.bend(np.array([[0.0, 0, -9], [0.01, 0, -9]]), CORNERS, (0, 0, 0), eye)
        (a, _), (b, _) = camera.project(pair)[0]
        own = camera.K[0, 0] * 0.01 / 9
        curve[share] = float((b - a) / own)
        assert abs(curve[share] - 1 / share) < 1e-6 / share
    for behind in (-3.0, -3.5):
        try:
            geometry_warp.bend(CORNERS, CORNERS, (0, 0, 0), (0, 0, behind))
        except ValueError as error:
            assert "image's plane" in str(error)
        else:
            raise AssertionError("an eye behind the plane was taken")
    return Shown(
        "eye's distance from the plane, of the picture's own",
        "screen pixels a pixel of the picture",
        {"magnification": curve},
        f"At a twentieth of the distance a pixel of the picture covers {curve[0.05]:.0f} of the screen, each way.",
    )


@failure(
    "Depth between bent vertices",
    method="Geometry warping",
    source="1998, section 5.1.2: z passed through unchanged",
    remedy="`bent_camera` draws unmoved vertices with a camera of its own: order is that of its depths, exactly.",
)
def depth_between_vertices():
    """With z passed through unchanged a rasteriser interpolates it linearly on the screen, which is no plane's
    depth: in the middle of a long face it is off, and faces behind come before it. Smaller faces are less wrong."""
    camera = cyc.Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=60, width=200, height=150)
    near, far = np.array([-1.0, 0, -4]), np.array([10.0, 0, -40])
    curve = {}
    for parts in (1, 2, 8, 32):
        share = np.linspace(0, 1, parts + 1)
        ends = near + share[:, None] * (far - near)
        x = camera.project(ends)[0][:, 0]
        fine = near + np.linspace(0, 1, 2001)[:, None] * (far - near)
        at, depth = camera.project(fine)
        passed = np.interp(at[:, 0], x, -ends[:, 2])
        curve[parts] = float(np.max(passed / depth - 1))
    # Halfway on the screen 1 / z is the mean, so z is the harmonic one: of 4 and 40 linear z is up to
    # (a + b)^2 / (4 a b) - 1 too far.
    assert abs(curve[1] - (44**2 / (4 * 160) - 1)) < 0.01
    assert curve[32] < 0.02
    # The library draws the face unmoved, whole, with a camera of its own: its depths are those of the bent face.
    aside = cyc.Camera.look_at((0.3, 0.1, -0.5), (0.3, 0.1, -1), fov_y=60, width=200, height=150)
    corners = np.array([near - [0, 2, 0], near + [0, 2, 0], far])
    plane = geometry_warp.ImagePlane.of(CORNERS, (0, 0, 0))
    drawn, scale = geometry_warp.bent_camera(plane, aside)
    got = cyc.Scene(corners, [[0, 1, 2]]).render(drawn)
    bent = geometry_warp.bend(corners, CORNERS, (0, 0, 0), aside.eye)
    truth = cyc.Scene(bent, [[0, 1, 2]]).render(aside)
    both = (got.ids == 0) & (truth.ids == 0)
    assert both.sum() > 500 and (got.ids != truth.ids).sum() <= 2
    off = float(np.abs(got.depth[both] * scale / truth.depth[both] - 1).max())
    assert off < 1e-5
    return Shown(
        "pieces that a long face is cut into",
        "depth too far, share",
        {"z interpolated on the screen": curve, "bent_camera": dict.fromkeys(curve, off)},
        f"A face from 4 to 40 away is {curve[1]:.0%} too far on its way, cut into 32 pieces {curve[32]:.1%}; "
        "`bent_camera` draws it whole, with the depths that float32 can hold.",
    )
