"""Where buildings of cells and portals fail: doors that nobody told of, doors that are not found, pictures in doors."""

import numpy as np

import cyclorama as cyc
from cyclorama.portals import Building, PortalImages
from cyclorama.portals.drawing import draw

from . import Shown, failure


@failure(
    "A door that nobody told of",
    method="Portals",
    source="found here: cells and portals are taken as given",
    remedy="`completed()` looks from all rooms for what the portals don't show; `Building.find` finds rooms and "
    "openings in the mesh itself.",
)
def door_left_out():
    """What is seen through a door is drawn only where there is a portal. With some of the doors left out of the
    building's description, what shows through them is lost."""
    house = cyc.scenes.house(rooms=6, seed=0)
    rng = np.random.default_rng(0)
    views = []
    for cell in house.cells:
        eye = cell["min"] + (0.5, 0.6, 0.5) * (cell["max"] - cell["min"])
        for gaze in rng.normal(size=(6, 3)) * (1, 0.2, 1):
            camera = cyc.Camera.look_at(eye, eye + gaze, fov_y=60, width=96, height=72)
            ids = house.render(camera).ids
            views.append((camera, ids[ids != cyc.BACKGROUND]))
    curve = {}
    for count in (0, 2, 4, len(house.portals)):
        building = Building(house, house.cells, house.portals[:count])
        lost = [1 - np.isin(ids, building.visible(camera)).mean() for camera, ids in views]
        curve[count] = float(np.mean(lost))
    assert curve[0] > curve[2] > curve[len(house.portals)] == 0, curve
    return Shown(
        "doors and windows told of",
        "share of pixels lost",
        {"lost": curve},
        f"Without any portal {curve[0]:.1%} of the pixels are lost, with two {curve[2]:.1%}, with all none.",
    )


def rooms_in_a_row(count, door, wall=0.3):
    """Rooms 4 x 3 x 4, side by side along x, with doors as wide and 2 high between them; all of it solid walls."""
    parts = [
        ((-wall, -wall, -wall), (count * (4 + wall), 0, 4 + wall)),
        ((-wall, 3, -wall), (count * (4 + wall), 3 + wall, 4 + wall)),
    ]
    parts += [((-wall, 0, z), (count * (4 + wall), 3, z + wall)) for z in (-wall, 4)]
    parts += [((x, 0, 0), (x + wall, 3, 4)) for x in (-wall, count * (4 + wall) - wall)]
    for room in range(1, count):
        x = room * (4 + wall) - wall
        low, high = 2 - door / 2, 2 + door / 2
        parts += [((x, 0, 0), (x + wall, 3, low)), ((x, 0, high), (x + wall, 3, 4)), ((x, 2, low), (x + wall, 3, high))]
    vertices, faces = [], []
    for a, b in parts:
        ends = np.array([a, b], float)
        corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces += [
            (c[0] + len(vertices) * 8, *(v + len(vertices) * 8 for v in t))
            for c in quads
            for t in ((c[1], c[2]), (c[2], c[3]))
        ]
        vertices.append(corners)
    return cyc.Scene(np.concatenate(vertices), faces)


@failure(
    "Doors as wide as asked for, or wider, join rooms",
    method="Finding portals",
    source="found here: an opening is a door where a ball of its width gets through",
    remedy="`door=` says how wide the widest opening is that ends a room; `voxel=` has at least three of it.",
)
def wide_doors():
    """Rooms are the places that a ball as wide as `door` moves about in. Through a wider opening it goes, and the two
    rooms are found as one."""
    scene = rooms_in_a_row(3, door=1.2)
    curve = {}
    for door in (0.6, 0.9, 1.5, 2.0):
        building = Building.find(scene, door=door, voxel=0.15, progress=False)
        curve[door] = 3 - len(building.cells)
    assert curve[0.6] == 2 and curve[1.5] == curve[2.0] == 0
    return Shown(
        "door=, openings being 1.2 wide",
        "rooms not told apart",
        {"of three rooms": curve},
        f"With door=0.6 the three rooms are found as {3 - curve[0.6]}, with 1.5 and 2 as three.",
    )


@failure(
    "A picture in a door jumps",
    method="Portal images",
    source="found here: pictures at sampled viewpoints pop",
    remedy='`kind="warped"` or "layered" warp between neighbours; `step=` places more.',
)
def pictures_in_doors():
    """A picture of what a door shows is right at its own viewpoint. An eye between two viewpoints sees one of them: off
    by the angle between."""
    house = cyc.scenes.house(rooms=2, seed=0)
    building = Building(house, house.cells, house.portals)
    inner = next(portal for portal in building.portals if None not in portal.cells)
    cell = building.cells[inner.cells[0]]
    middle = inner.polygon.mean(axis=0)
    rng = np.random.default_rng(2)
    cameras = []
    for _ in range(400):
        eye = cell.low + rng.uniform(0.1, 0.9, 3) * (cell.high - cell.low)
        if building.cell(eye) == inner.cells[0] and np.linalg.norm(eye - middle) > 1.2:
            cameras.append(cyc.Camera.look_at(eye, middle, fov_y=50, width=64, height=48))
        if len(cameras) == 12:
            break
    curve = {}
    for step in (60, 30, 10):
        images = PortalImages(building, step=step, size=(64, 64))
        off = []
        for camera in cameras:
            drawn = draw(images, camera)
            shown = drawn.portal >= 0
            if shown.any():
                truth = images.color(house.render(camera))
                off.append(np.abs(drawn.color[shown].astype(float) - truth[shown]).mean())
        curve[step] = float(np.mean(off))
    assert len(off) >= 6 and curve[60] > 1.1 * curve[10], curve
    return Shown(
        "degrees between viewpoints",
        "mean error of a colour in pictures, of 255",
        {"static pictures": curve},
        f"With a viewpoint every 60 degrees colours are off by {curve[60]:.0f} of 255, with one every 10 by "
        f"{curve[10]:.0f}.",
    )
