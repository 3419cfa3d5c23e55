"""Where warps of pictures with depth fail. Holes are drawn magenta."""

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import Camera, DepthImage, LayeredDepthImage, quality, warp

from . import Shown, failure

MAGENTA = (255, 0, 255)
SPLATS = (1, 3, "projected", "disparity", "mesh")


def looking(eye, forward=(0.0, 0.0, -1.0), size=(200, 150), fov_y=50.0):
    turned = Camera.look_at((0, 0, 0), forward, fov_y=fov_y, width=size[0], height=size[1])
    pose = turned.world_to_camera.copy()
    pose[:3, 3] = -pose[:3, :3] @ eye
    return turned.replace(world_to_camera=pose)


def shown(warped):
    picture = warped.color.copy()
    picture[warped.hole] = MAGENTA
    return picture


def quad(low, high, z):
    """Two triangles of an upright rectangle."""
    (x0, y0), (x1, y1) = low, high
    return [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]


def scene_of(*quads):
    vertices = np.concatenate(quads)
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(quads))])
    return cyc.Scene(vertices, faces)


def plain(camera, depth, color=200):
    shape = camera.height, camera.width
    return DepthImage(np.full((*shape, 3), color, np.uint8), np.broadcast_to(depth, shape), camera)


@failure(
    "Disocclusion behind a pole",
    method="Warps and splats",
    source="known of all warping of pictures",
    remedy="Several references may be given; `warp.fill` guesses, and says so.",
)
def disocclusion_behind_a_pole():
    """What no reference saw is a hole, of the width that geometry says; a second reference fills it."""
    scene = scene_of(quad((-9, -9), (9, 9), -6), quad((-0.15, -9), (0.15, 9), -2))
    here, there, beyond = (looking((x, 0, 0)) for x in (0, 0.2, 0.5))
    images = [quality.textured(scene, camera, grain=0.4) for camera in (here, beyond)]
    truth = quality.textured(scene, there, grain=0.4)
    seen = quality.seen(scene, truth, here)
    f = here.K[0, 0]
    # Between the right edge of the pole and what was beside it on the wall: 0.2 (f / 2 - f / 6) pixels.
    width = 0.2 * (f / 2 - f / 6)
    middle = slice(0, here.width - int(0.2 * f / 6) - 1)
    pictures, widths = {"truth": truth.color}, []
    for splat, eaten in ((1, 1), (3, 3), ("mesh", 2)):
        out = warp.forward(images[0], there, splat=splat)
        hole = out.hole[75, middle]
        assert width - eaten <= hole.sum() <= width + 1
        widths.append(f"{hole.sum()} with splat={splat!r}")
        assert not (out.hole & seen)[:, 1:-1].mean() > 0.002
        # Filling is a guess that says so.
        assert (warp.fill(out).hole == out.hole).all()
        pictures[f"splat={splat!r}"] = shown(out)
    both = warp.forward(images[::-1], there, splat="mesh")
    either = quality.seen(scene, truth, [here, beyond])
    assert quality.compare(both, truth, either).cracks < 0.002 and not both.hole[:, middle].any()
    return Shown(
        "references",
        "pixels of a row that are hole",
        {"wall beside the pole": {1: float(out.hole[75, middle].sum()), 2: float(both.hole[75, middle].sum())}},
        measured=f"The hole is {width:.1f} pixels wide by geometry, {', '.join(widths)}; "
        "with two references there is none.",
        pictures=pictures | {"two references": shown(both)},
    )


@failure(
    "Grazing surfaces",
    method="Warps and splats",
    source="known of all warping of pictures",
    remedy='`splat="mesh"` has hardly a crack; detail needs another reference.',
)
def grazing_surfaces():
    """A floor seen almost edge-on has few samples for the view from above: splats leave cracks, a mesh only blur."""
    floor = cyc.Scene([[-9, -1, 9], [9, -1, 9], [9, -1, -40], [-9, -1, -40]], [[0, 1, 2], [0, 2, 3]])
    here = Camera.look_at((0, -0.9, 0), (0, -1.2, -3), fov_y=50, width=200, height=150)
    there = Camera.look_at((0, 0.6, 0), (0, -1, -3), fov_y=50, width=200, height=150)
    image, truth = (quality.textured(floor, camera, grain=0.1) for camera in (here, there))
    seen = quality.seen(floor, truth, here)
    measured = {s: quality.compare(warp.forward(image, there, splat=s), truth, seen) for s in SPLATS}
    assert measured[1].cracks > 0.5 and measured[3].cracks > 0.2
    assert measured["mesh"].cracks < 0.005
    # There is hardly a crack, and no detail either: where ten rows of the picture come from one of the reference,
    # nothing could be better. The answer is another reference, not another reconstruction.
    assert measured["mesh"].known_psnr < 25
    assert (image.joins[image.points()[..., 2] > -30] & 3 == 3).mean() > 0.95
    pictures = {"reference": image.color, "truth": truth.color}
    found = ", ".join(f"{100 * q.cracks:.1f} % ({s!r})" for s, q in measured.items())
    return Shown(
        "splat=",
        "share of cracks",
        {"cracks": {str(s): float(measured[s].cracks) for s in (1, 3, "projected", "mesh")}},
        measured=f"Cracks on {found} of what the reference saw; the mesh's pixels are "
        f"{measured['mesh'].known_psnr:.1f} dB.",
        pictures=pictures | {f"splat={s!r}": shown(warp.forward(image, there, splat=s)) for s in SPLATS},
    )


@failure(
    "The new view is closer than the reference",
    method="Warps and splats",
    source="known of splats of a fixed size",
    remedy='"projected", "disparity" and "mesh" grow with what they show.',
)
def the_new_view_is_closer_than_the_reference():
    """A splat of n pixels has no cracks up to n times as close; beyond, the share that geometry says."""
    closer = 4.0
    scene = scene_of(quad((-9, -9), (9, 9), -4))
    here, there = looking((0, 0, 0)), looking((0, 0, -4 * (1 - 1 / closer)))
    image, truth = (quality.textured(scene, camera, grain=0.2) for camera in (here, there))
    pictures, found, curve = {"truth": truth.color}, [], {}
    for splat in SPLATS:
        out = warp.forward(image, there, splat=splat)
        cracks = out.hole.mean()
        expected = 1 - min(1, (splat if isinstance(splat, int) else closer) / closer) ** 2
        assert abs(cracks - expected) < 0.03
        curve[str(splat)] = float(cracks)
        pictures[f"splat={splat!r}, {100 * cracks:.0f} % hole"] = shown(out)
        found.append(f"{100 * cracks:.1f} % ({splat!r})")
    return Shown(
        "splat=, four times as close",
        "share of the picture that is hole",
        {"holes": curve},
        measured=f"{closer:g} times as close, {', '.join(found)} of the picture is hole.",
        pictures=pictures,
    )


@failure(
    "A move to behind the reference",
    method="Warps and splats",
    source="known of all warping of pictures",
    remedy="A second reference, or a layered image with construction images behind its eye.",
)
def a_move_to_behind_the_reference():
    """The reference fills less than the picture, nearer samples still hide farther ones, and all around is hole."""
    scene = scene_of(quad((-99, -99), (99, 99), -6), quad((-0.5, -0.5), (0.5, 0.5), -2))
    here, there = looking((0, 0, 0)), looking((0, 0, 2))
    image, truth = (quality.textured(scene, camera, grain=0.4) for camera in (here, there))
    seen = quality.seen(scene, truth, here)
    pictures, found = {"truth": truth.color}, []
    for splat in (1, 3, "mesh"):
        out = warp.forward(image, there, splat=splat)
        # The wall, 6 away, is 8 away now: the reference's picture is 3 / 4 as large, less what the square hid.
        wall = 6 / 8 * np.array((200, 150))
        assert out.hole[: int(75 - wall[1] / 2) - 2].all() and out.hole[:, : int(100 - wall[0] / 2) - 2].all()
        assert (out.hole & seen).mean() < 0.01 and (~out.hole & ~seen).mean() < 0.04
        # The near square is where it is: nothing of the wall drawn over it.
        near = (truth.depth < 5) & seen
        assert near.sum() > 200 and (out.depth[near] < 5).mean() > (0.999 if splat == "mesh" else 0.97)
        pictures[f"splat={splat!r}"] = shown(out)
        lost = 100 * (out.hole & seen).sum() / seen.sum()
        wrong = 100 * (out.depth[near] >= 5).mean()
        found.append(f"{lost:.2f} % and {wrong:.2f} % ({splat!r})")
    beyond = warp.forward(image, looking((0, 0, -7)))
    assert beyond.hole.all()
    curve = {back: float(warp.forward(image, looking((0, 0, back))).hole.mean()) for back in (2.0, 1.0, 0.5, 0.0)}
    assert curve[2.0] > 1 - (6 / 8) ** 2 - 0.01 and curve[0.0] == 0
    return Shown(
        "eye behind the reference, wall at 6",
        "share of the picture that is hole",
        {"holes": curve},
        measured="Holes in what the reference saw, and pixels of the near square that show the wall: "
        f"{', '.join(found)}. From beyond the wall all is hole.",
        pictures=pictures,
    )


@failure(
    "Two surfaces within the depth tolerance",
    method="Warps and splats",
    source="found here",
    remedy="`tolerance=` in pixels' widths; `samples` says what was kept.",
)
def two_surfaces_within_the_depth_tolerance():
    """Of two sheets closer than the tolerance a layered image keeps one; a mesh takes small steps for one surface."""
    here, aside = looking((0, 0, 0)), looking((0.5, 0, 0))
    pixel = 1 / here.K[0, 0]
    kept, pictures = {}, {}
    for apart in (0.5, 16.0, 64.0):
        # In front half a sheet, behind it a whole one; the second image sees some of it beside the first.
        gap = 4 * apart * pixel
        scene = scene_of(quad((-9, -9), (9, 9), -4 - gap), quad((-9, -9), (0, 9), -4))
        central, other = (
            DepthImage.from_view(view, color=np.full((150, 200, 3), 128, np.uint8))
            for view in (scene.render(here), scene.render(aside))
        )
        # The second image sees so many columns of the sheet behind that the first doesn't.
        beside = round(0.5 * here.K[0, 0] * (1 / 4 - 1 / (4 + gap)))
        kept = {t: LayeredDepthImage.build(central, [other], tolerance=t).samples for t in (128.0, 64.0, 16.0, 2.0)}
        assert kept[2.0] == 30_000 + 150 * beside
        assert all((count == 30_000) == (tolerance >= apart or not beside) for tolerance, count in kept.items())
        step = central.joins[75, :-1] & 1 == 0
        # One surface to the mesh at half a pixel's width, not at 64.
        assert step.sum() == (0 if apart < 1 else 1)
        warped = warp.forward(central, aside, splat="mesh")
        pictures[f"{apart:g} pixels apart"] = shown(warped)
        true_hole = 0.5 * here.K[0, 0] * (1 / 4 - 1 / (4 + gap))
        # What opens between them is papered over by the mesh where it isn't cut: a guess of so many pixels.
        papered = true_hole - warped.hole[75, :-25].sum()
        assert -1 <= papered <= 1.5
    found = ", ".join(f"{count:,} with tolerance={tolerance:g}" for tolerance, count in kept.items())
    return Shown(
        "tolerance=, of sheets 64 pixels' widths apart",
        "share of the second sheet's new samples lost",
        {"lost": {tolerance: 1 - (n - 30_000) / (kept[2.0] - 30_000) for tolerance, n in kept.items()}},
        measured=f"Of sheets 64 pixels' widths apart, samples kept: {found}.",
        pictures=pictures,
    )


@failure(
    "Mixed pixels at silhouettes",
    method="Warps and splats",
    source="known of sensors and of averaged pictures",
    remedy="`missing=` masks such pixels; `DepthImage` takes the mask.",
)
def mixed_pixels_at_silhouettes():
    """A pixel that averages two surfaces is at a depth where nothing is: it floats, unless it is masked."""
    scene = scene_of(quad((-9, -9), (9, 9), -6), quad((-0.5, -0.5), (0.53, 0.53), -2))
    here, there = looking((0, 0, 0)), looking((0.3, 0, 0))
    # As a sensor does: the mean over each pixel of colour and of disparity.
    fine = quality.textured(scene, here.scaled(4), grain=0.5)

    def mean(a):
        return a.reshape(150, 4, 200, 4, -1).mean(axis=(1, 3))

    color = np.rint(mean(fine.color)).astype(np.uint8)
    disparity = mean(fine.disparity)[..., 0]
    mixed_image = DepthImage.from_disparity(color, disparity, here)
    mixed = (disparity > 1 / 5.9) & (disparity < 1 / 2.05)
    assert 100 < mixed.sum() < 1000
    masked_image = DepthImage.from_disparity(color, disparity, here, missing=mixed)
    truth = quality.textured(scene, there, grain=0.5)
    seen = quality.seen(scene, truth, here)
    pictures, floating = {"truth": truth.color}, {}
    for name, image in (("mixed", mixed_image), ("masked", masked_image)):
        for splat in (1, 3, "mesh"):
            out = warp.forward(image, there, splat=splat)
            floating[name, splat] = int((~out.hole & (out.depth > 2.05) & (out.depth < 5.9)).sum())
            # Before the wall that nobody saw something floats at most; it isn't papered over.
            assert out.hole[50:100, 100:125].any(axis=1).all()
            pictures[f"{name}, splat={splat!r}"] = shown(out)
            measured = quality.compare(out, truth, seen)
            assert measured.cracks < 0.02
    # Nothing tells such pixels from real ones but their depth.
    assert all(floating["mixed", splat] > 50 for splat in (1, 3, "mesh"))
    assert all(floating["masked", splat] == 0 for splat in (1, 3, "mesh"))
    found = ", ".join(f"{floating['mixed', s]} ({s!r})" for s in (1, 3, "mesh"))
    return Shown(
        "silhouettes",
        "pixels that float",
        {f"splat={s!r}": {k: float(floating[k, s]) for k in ("mixed", "masked")} for s in (1, 3, "mesh")},
        measured=f"Of {mixed.sum()} mixed pixels, {found} float; none where they are masked.",
        pictures=pictures,
    )


@failure(
    "Beside a post, before a scene at infinity",
    method="Warps and splats",
    source="found here",
    remedy="Infinite depth is exact: it never moves; only what is before it leaves holes.",
)
def a_scene_at_infinity():
    """What is infinitely far stays where it is when the eye moves, and turns with it; there is no depth to compare."""
    here = looking((0, 0, 0))
    height, width = here.height, here.width
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    sky = DepthImage.from_disparity(color, np.zeros((height, width)), here)
    pictures = {"reference": color}
    for splat in (1, "mesh"):
        for order in ("occlusion", "zbuffer"):
            moved = warp.forward(sky, looking((1e6, -3, 20)), splat=splat, order=order)
            assert (moved.color == color).all() and not moved.hole.any() and np.isinf(moved.depth).all()
            turned = looking((5, 5, 5), (0.1, 0.05, -1))
            out = warp.forward(sky, turned, splat=splat, order=order)
            assert np.isinf(out.depth).all() and 0.1 < out.hole.mean() < 0.6
            pictures[f"turned, {splat!r}, {order}"] = shown(out)
    # Something in front of it hides it from everywhere.
    post = np.zeros((height, width))
    post[:, 90:110] = 0.5
    both = DepthImage.from_disparity(color, post, here)
    for splat in (1, "mesh"):
        out = warp.forward(both, looking((0.2, 0, 0)), splat=splat)
        shift = round(0.2 * here.K[0, 0] / 2)
        assert (out.depth[:, 92 - shift : 108 - shift] < 3).all()
        assert out.hole[:, 112 - shift : 108].all()
    wide = out.hole[75, 50:150].sum()
    curve = {}
    for disparity in (0.5, 0.25, 0.0):
        beside = DepthImage.from_disparity(color, np.where(post > 0, disparity, 0.0), here)
        hole = warp.forward(beside, looking((0.2, 0, 0)), splat="mesh").hole[75]
        curve[disparity] = float(hole.sum())
        assert abs(curve[disparity] - 0.2 * here.K[0, 0] * disparity) <= 2
    return Shown(
        "disparity of the post",
        "pixels of a row that are hole",
        {"beside the post": curve},
        measured="No pixel changes on a move of a million units; a post before it moves by "
        f"{shift} pixels and leaves a hole {wide} wide.",
        pictures=pictures,
    )


@failure(
    "A one-pixel image",
    method="Warps and splats",
    source="the smallest image there is",
    remedy="Splats of a pixel's own size cover it all.",
)
def a_one_pixel_image():
    """One sample is one splat, of its own pixel's size where the size is its own; nothing breaks."""
    here = looking((0, 0, 0), size=(1, 1), fov_y=40)
    dot, larger = plain(here, 2.0), here.with_size(9, 9)
    missing = DepthImage(dot.color, np.full((1, 1), np.inf), here)
    curve, pictures = {}, {}
    for splat in SPLATS:
        out = warp.forward(dot, here, splat=splat)
        assert not out.hole.any() and (out.color == 200).all() and abs(out.depth[0, 0] - 2) < 1e-6
        covered = warp.forward(dot, larger, splat=splat)
        assert (~covered.hole).sum() == {1: 1, 3: 9, "projected": 81, "disparity": 81, "mesh": 81}[splat]
        away = warp.forward(dot, looking((5, 0, 0), size=(9, 9), fov_y=40), splat=splat)
        assert away.hole.all() and (away.color == 0).all() and np.isinf(away.depth).all()
        assert warp.forward(missing, larger, splat=splat).hole.all()
        curve[str(splat)] = float(covered.hole.sum())
        pictures[f"splat={splat!r}"] = shown(covered)
    return Shown(
        "splat=",
        "pixels of 81 left open",
        {"open": curve},
        "Splats of 1 and 3 pixels leave 80 and 72 of 9 x 9 pixels open, those as large as the sample none.",
        pictures,
    )


@failure(
    "Extreme disparity",
    method="Warps and splats",
    source="the range of float32",
    remedy="Depths from 1e-30 to 1e30 are taken, others refused; what stays is drawn where float64 says.",
)
def extreme_disparity():
    """Depths sixty powers of ten apart: a move leaves the nearer ones behind, and holes where they were."""
    size = (120, 90)
    here = looking((0, 0, 0), size=size)
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    image = DepthImage(color, 10.0 ** rng.uniform(-30, 30, size[::-1]), here)
    holes, lost, pictures = {}, {}, {}
    for power in (20, 10, 0, -10, -20):
        away = 10.0**power
        there = looking((away, 0.3 * away, -0.1 * away), size=size)
        out = warp.forward(image, there, splat=1)
        at = warp.map(here, there, image.depth)
        inside = np.isfinite(at).all(axis=-1) & (at >= 0).all(axis=-1) & (at < size).all(axis=-1)
        x, y = np.floor(at[inside]).astype(int).T
        holes[f"1e{power}"] = 100 * float(out.hole.mean())
        lost[f"1e{power}"] = 100 * float(out.hole[y, x].mean())
        pictures[f"moved 1e{power}"] = shown(out)
        # What is nearer than the move leaves the picture; a hundred times as far it moves by less than a pixel.
        noise = 5 * 0.5 / np.sqrt(image.depth.size)
        assert (power + 30) / 60 - noise < out.hole.mean() < (power + 32) / 60 + noise
        assert lost[f"1e{power}"] == 0
    still = warp.forward(image, here, splat=1)
    assert not still.hole.any() and (still.color == color).all()
    for value in (1e-31, 1e31):
        with pytest.raises(ValueError, match="from 1e-30 to 1e"):
            plain(here, value)
    return Shown(
        "distance moved",
        "% of the pixels",
        {"holes": holes, "lost": lost},
        f"Holes grow by a sixtieth with each power of ten: {holes['1e-20']:.0f} % to {holes['1e20']:.0f} %. Of "
        "the samples that fall into the picture none is lost.",
        pictures,
    )
