"""Where answers for whole regions fail: sets from boxes of eyes, and faces that nobody ever sees."""

import numpy as np

import cyclorama as cyc

from . import Shown, failure


def tube(length):
    """A square tube along z, open towards +z, and (last) the two faces of its far end."""
    ring = [[-1, -1], [1, -1], [1, 1], [-1, 1]]
    vertices = [[*xy, z] for z in (0.0, -length) for xy in ring]
    sides = [[i, (i + 1) % 4, 4 + i] for i in range(4)] + [[(i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    return cyc.Scene(vertices, [*sides, [4, 5, 6], [4, 6, 7]])


@failure(
    "Behind a keyhole",
    method="From-region sets",
    source="found here: sampled sets are aggressive, and their estimate knows only of what was nearly seen",
    remedy="Ask for smaller boxes: a region's set is the union of those of its parts.",
)
def keyhole():
    """The end of a long tube is seen from a thousandth of the box. No sampled eye is there, and the estimate of what
    is still unseen, which follows from what was last found, knows nothing of it."""
    scene = tube(4000.0)
    curve, unseen = {}, {}
    for half in (40.0, 10.0, 0.5):
        region = cyc.visible_from(
            scene, [-half, -half, 20], [half, half, 21], resolution=33, max_eyes=40, progress=False
        )
        curve[half] = 1 - float(np.isin([8, 9], region.faces).mean())
        unseen[half] = float(region.unseen)
    assert curve[40.0] == 1 and curve[0.5] == 0
    assert unseen[40.0] < 1
    return Shown(
        "half the side of the box, tube 2 wide",
        "share of the tube's end missed",
        {"missed": curve},
        f"From a box 80 wide the end is missed and {unseen[40.0]:.1f} faces are thought unseen; from one 1 "
        "wide it is there.",
    )


@failure(
    "A box's corners do not see for its inside",
    method="From-region sets",
    source="found here",
    remedy="Eyes are added on its sides, edges and inside until few new faces come into view (`least=`), then, with "
    "`guided=True`, close looks where few of them saw a face.",
)
def corners_of_a_box():
    """In a room each corner of a box of eyes lacks what furniture hides from it; eyes between them find it."""
    scene = cyc.scenes.house(rooms=2, seed=1)
    low, high = scene.cells[0]["min"] + 0.2, scene.cells[0]["max"] - 0.2
    options = {"resolution": 64, "progress": False}
    long = cyc.visible_from(scene, low, high, max_eyes=128, patience=128, **options)
    curve = {}
    for eyes in (1, 8, 16, 64):
        short = cyc.visible_from(scene, low, high, max_eyes=eyes, patience=eyes, **options)
        assert np.isin(short.faces, long.faces).all()
        curve[eyes] = 1 - len(short.faces) / len(long.faces)
    assert curve[1] > curve[8] > curve[16] > curve[64] and curve[8] > 0.01
    return Shown(
        "eyes in the box",
        "share missed of what 128 eyes find",
        {"missed": curve},
        f"8 eyes, one at each corner, miss {curve[8]:.1%} of what 128 find, 64 eyes {curve[64]:.2%}.",
    )


@failure(
    "What few eyes see is taken for hidden",
    method="Faces that nobody sees",
    source="found here: sampled views prove only what they see",
    remedy="The answer states a bound on the pixels that a picture loses; `max_missed=` looks until it is met.",
)
def seen_by_few():
    """The bottoms of deep tubes are seen from a small part of all directions. Few views miss some, and stripping would
    remove them; more views find them."""
    scene = cyc.scenes.tubes(7, length=2.0)
    bottoms = np.arange(2 * 7**2)
    curve, bound = {}, {}
    for views in (20, 100, 800):
        found = cyc.never_seen(scene, max_missed=1e-6, max_views=views, resolution=(96, 90), progress=False)
        curve[views], bound[views] = float((~found.seen[bottoms]).mean()), float(found.bound)
    assert curve[20] > 0.3 and curve[800] < 0.5 * curve[20]
    assert bound[20] > bound[100] > bound[800]
    return Shown(
        "views",
        "share",
        {"bottoms of tubes taken for hidden": curve, "bound on the pixels lost": bound},
        f"20 views take {curve[20]:.0%} of the bottoms for hidden and say that up to {bound[20]:.0%} of the "
        "pixels may be "
        f"lost; 800 take {curve[800]:.0%} and say {bound[800]:.1%}.",
    )
