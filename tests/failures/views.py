"""Where bakes of views around a model fail: spheres of samples, patches, rows of bits, error bounds."""

import numpy as np

import cyclorama as cyc
from cyclorama import bitfield

from . import Shown, failure


def lost(vis, scene, sight):
    """Share of the faces known to be seen that a bake leaves out."""
    return float((~np.isin(sight.seen, vis.visible_faces(sight.eye))).mean())


@failure(
    "What only an eye between samples sees",
    method="Views on the sphere",
    source="2001, section 3.3 and figure 4",
    remedy='`join="cells"`, the default, sends probes into each face of the sphere until they find nothing new.',
)
def between_samples():
    """A pit whose apex is hidden from the three corners of a sphere face and shown to the eye between them: the union
    of the three samples lacks it. The next level has samples that see it."""
    scene = cyc.scenes.notch(level=1)
    sight = scene.sights[0]
    curves = {
        f'join="{join}"': {
            views: lost(cyc.bake(scene, views, resolution=(96, 90), join=join, progress=False), scene, sight)
            for views in (6, 18, 66)
        }
        for join in ("samples", "cells")
    }
    samples, cells = curves.values()
    assert samples[18] == 1 and samples[66] == 0
    assert cells[18] == cells[66] == 0
    return Shown(
        "samples on the sphere",
        "share of the apex missed",
        curves,
        f"With 18 samples {samples[18]:.0%} of the apex is lost by their union, {cells[18]:.0%} by cells.",
    )


@failure(
    "Far eyes are not safe",
    method="Views on the sphere",
    source="2002, section 4.3, which takes them to be",
    remedy="An eye gets all sphere faces that its rays to the scene cross, and not only the one beneath it.",
)
def far_eyes():
    """Deep parallel tubes: an eye far away on their axis sees the bottoms of all, each of which only the part of the
    sphere straight above it sees. The sphere faces beneath the eye know of a few."""
    scene = cyc.scenes.tubes(7, length=2.0)
    vis = cyc.bake(scene, 258, resolution=(160, 150), progress=False)
    curves = {"sphere faces beneath the eye": {}, "all that its rays cross": {}}
    for radii in (1000.0, 30.0, 10.0, 3.0):
        eye = vis.sphere.center + [0.0, 0.0, radii * scene.radius]
        fov = 2 * np.degrees(np.arcsin(1 / radii))
        camera = cyc.Camera.look_at(eye, scene.center, fov_y=fov, width=256, height=256)
        seen = np.intersect1d(np.unique(scene.render(camera).ids), np.arange(2 * 7**2))
        beneath = bitfield.ids(vis.cells.union(vis.sphere.locate(eye - vis.sphere.center)))
        for curve, answer in zip(curves.values(), (beneath, vis.visible_faces(eye)), strict=True):
            curve[f"{radii:g}"] = float((~np.isin(seen, answer)).mean())
    beneath, crossed = curves.values()
    assert beneath["1000"] > 0.25 and beneath["3"] == 0
    assert max(crossed.values()) == 0
    return Shown(
        "distance of the eye, radii",
        "share of the bottoms missed",
        curves,
        f"At 1000 radii the faces beneath the eye lack {beneath['1000']:.0%} of the tubes' bottoms, those "
        "crossed none.",
    )


@failure(
    "Eyes inside the sampling sphere",
    method="Views on the sphere",
    source="found here: the papers ask about eyes outside",
    remedy="Within the model's bounding sphere the answer is the whole model; `distances=` bakes nearer shells.",
)
def inside_the_sphere():
    """An eye nearer than the samples looks past the rim of what stands before: it sees faces that no sample saw."""
    scene = cyc.scenes.window_box()
    vis = cyc.bake(scene, 66, resolution=(128, 120), progress=False)
    curve, answered = {}, {}
    for share in (0.3, 0.56, 3.0):
        eye = scene.center + [0.0, 0.0, share * scene.radius]
        camera = cyc.Camera.look_at(eye, eye - [0, 0, 1], fov_y=120, width=200, height=200)
        ids = scene.render(camera).ids
        seen = ids[ids != cyc.BACKGROUND]
        beneath = bitfield.ids(vis.cells.union(vis.sphere.locate(np.array([0.0, 0.0, 1.0]))))
        curve[share] = float((~np.isin(seen, beneath)).mean())
        answered[share] = float((~np.isin(seen, vis.visible_faces(eye))).mean())
    assert curve[0.3] > 0.1 and curve[3.0] == 0
    assert max(answered.values()) == 0
    return Shown(
        "distance of the eye, radii of the model",
        "share of pixels missed",
        {"sphere faces beneath the eye": curve, "the library's answer": answered},
        f"At 0.3 radii {curve[0.3]:.1%} of the pixels show faces that nothing straight above it saw.",
    )


@failure(
    "Patches are seen as soon as one of their faces is",
    method="Bitfields and patches",
    source="2002, table 1: culling falls with the number of patches",
    remedy="`cyc.tradeoff` charts both; `patches=None` keeps a bit for each face.",
)
def coarse_patches():
    """A bit stands for a group of faces, so a group with one visible face is drawn whole."""
    scene = cyc.scenes.gear(2400)
    vis = cyc.bake(scene, 18, resolution=(96, 90), progress=False)
    exact = np.mean([len(bitfield.ids(row)) for row in vis.bitfields.words]) / len(scene)
    curve = {}
    for count in (2, 20, 100, 400):
        labels = cyc.patches.tile(scene.vertices, scene.faces, count, progress=False)
        grouped = vis.in_patches(labels)
        rows = [np.isin(labels, bitfield.ids(row)).mean() for row in grouped.bitfields.words]
        curve[count] = float(np.mean(rows)) - float(exact)
    assert all(more >= 0 for more in curve.values())
    assert curve[2] > 0.3 * (1 - exact) and curve[400] < 0.5 * curve[20]
    return Shown(
        "patches",
        "share of the faces drawn in vain",
        {"drawn beyond what was seen": curve},
        f"2 patches draw {curve[2]:.0%} of the faces in vain, 400 draw {curve[400]:.1%}; a bit per face draws none.",
    )


@failure(
    "Rows of bits that nothing predicts",
    method="Bitfields and patches",
    source="found here",
    remedy="The coder learns as it goes and falls back to a bit a bit; rows of one sphere belong in one call.",
)
def noise_in_rows():
    """Coding needs rows that resemble each other. Bits flipped at random cost their entropy, and no coder can do
    better."""
    scene = cyc.scenes.gear(4000)
    rows = cyc.bake(scene, 66, resolution=(96, 90), progress=False).bitfields.unpack()
    rng = np.random.default_rng(0)
    curve, floor = {}, {}
    for share in (0.5, 0.2, 0.05, 0.0):
        bits = cyc.Bitfields.pack(rows ^ (rng.random(rows.shape) < share))
        coded = sum(part.nbytes for part in bitfield.encode(bits.words, bits.size).values())
        curve[share] = 8 * coded / rows.size
        floor[share] = 0.0 if share == 0 else float(-share * np.log2(share) - (1 - share) * np.log2(1 - share))
    # Entropy is what noise costs, whatever the rows; beside it a coder pays for learning, here at most 8 %.
    assert all(floor[share] * 0.98 <= curve[share] for share in curve)
    assert curve[0.5] < 1.08 and curve[0.0] < 0.3
    return Shown(
        "share of bits flipped at random",
        "coded bits a bit",
        {"coded": curve, "entropy of the flips": floor},
        f"Noise takes {curve[0.5]:.2f} bits a bit, real rows {curve[0.0]:.2f}.",
    )


@failure(
    "Few views that miss nothing prove little",
    method="Adaptive subdivision",
    source="2001 and 2002: *all random test views identical*",
    remedy="`max_missed=` asks for a bound that holds with a confidence; `evaluation.bound` states it.",
)
def few_test_views():
    """A needle's hole is met by one view in hundreds. Test views that don't meet it say *identical*; how much may be
    missed nevertheless depends on their number alone."""
    scene = cyc.scenes.tubes(3, length=3.0, wall=0.8)
    vis = cyc.bake(scene, 6, resolution=(64, 60), join="samples", progress=False)
    bound, found = {}, {}
    for views in (10, 40, 160):
        report = cyc.evaluate(vis, scene, views=views, seed=2, resolution=(64, 60), progress=False)
        bound[views], found[views] = float(report.bound), float(report.mean_missed)
    # With n views and 95 % even nothing missed bounds the mean by 1 - 0.05^(1/n) at best.
    assert all(bound[n] >= max(found[n], (1 - 0.05 ** (1 / n)) * 0.99) for n in bound)
    assert bound[10] > 2 * bound[160]
    return Shown(
        "test views",
        "share of pixels",
        {"bound on the mean missed": bound, "mean missed, found": found},
        f"10 views find {found[10]:.1e} missed and allow {bound[10]:.2f}; 160 find {found[160]:.1e}, allow "
        f"{bound[160]:.2f}.",
    )
