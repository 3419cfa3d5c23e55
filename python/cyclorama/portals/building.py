"""What an eye in a building sees through its doors (section 6.2.1)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..arguments import checked_whole
from ..camera import Camera
from ..progress import Progress, reporter
from ..scene import Scene
from ..warp import Splat
from .cells import TOUCH, Cell, Portal, parse_cells, parse_portals
from .cones import Cone
from .drawing import PortalDrawn, PortalFrame, draw, frame
from .finding import find
from .images import Kind, PortalImages
from .leaks import Leaks, look
from .reading import read_building
from .voxels import FILLED, NEAR, OUTDOORS

__all__ = ["Building"]

Floats = npt.NDArray[np.float64]
Ids = npt.NDArray[np.uint32]


class Building:
    """A scene in cells that open into each other, and outdoors, through portals.

    Parameters
    ----------
    scene : Scene
        F faces.
    cells : sequence of mapping or Cell
        Each has a ``name``, and ``min`` and ``max`` (3,) of its box or the ``vertices`` (V, 3) and ``faces`` (T, 3) of
        its closed surface. No two may overlap; they need not fill the building, but what is seen is what can be reached
        from cell to cell. With ``shut`` true nothing is seen through it, as where a window's pane is in it.
    portals : sequence of mapping or Portal
        Each has a ``polygon`` (N, 3), flat and convex, and ``cells`` [a, b], the indices of the cells on both sides; b
        is None outdoors.
    faces : sequence of (K,) ndarray of uint32, optional
        The faces that can be seen in each cell, and outdoors last, if they are known. By default those that reach into
        a cell's box.

    Attributes
    ----------
    cells : list of Cell
    portals : list of Portal
    faces : list of (K,) ndarray of uint32
        The scene's faces in each cell; the last entry is outdoors: by default all that are not wholly inside one box.
    leaks : Leaks or None
        What `completed` saw past the portals.

    Raises
    ------
    ValueError
        If cells overlap, a portal belongs to no cell or to one that is not there, or a polygon is not flat and convex.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> home = cyc.scenes.house(rooms=3, seed=1)
    >>> building = Building(home, home.cells, home.portals)
    >>> eye = (home.cells[0]["min"] + home.cells[0]["max"]) / 2
    >>> building.cell(eye), building.cell(eye + 1000)
    (0, None)
    """

    def __init__(
        self,
        scene: Scene,
        cells: Sequence[Mapping[str, Any] | Cell],
        portals: Sequence[Mapping[str, Any] | Portal],
        *,
        faces: Sequence[Ids] | None = None,
    ) -> None:
        self.scene = scene
        self.cells = parse_cells(cells)
        self.portals = parse_portals(portals, self.cells)
        self._size = float(np.max(np.ptp([[c.low for c in self.cells], [c.high for c in self.cells]], axis=(0, 1))))
        self._corners = np.asarray(scene.vertices, np.float64)[scene.faces]
        self._surface = _core.Solid(self._corners.reshape(-1, 9))
        self.faces = self._assigned() if faces is None else list(faces)
        self.leaks: Leaks | None = None
        self._images: PortalImages | None = None
        self.kernel = self._kernel()

    def _kernel(self) -> _core.Portals:
        """Cells and portals as the kernel follows them; outdoors is the place after the last cell."""
        outdoors = len(self.cells)
        return _core.Portals(
            self._corners.reshape(-1, 9),
            np.concatenate([np.empty((0, 3)), *(portal.polygon for portal in self.portals)]),
            np.cumsum([len(portal.polygon) for portal in self.portals], dtype=int).tolist(),
            [(a, outdoors if b is None else b) for a, b in (portal.cells for portal in self.portals)],
            [cell.shut for cell in self.cells],
            [np.ascontiguousarray(faces, np.uint32) for faces in self.faces],
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str], scene: Scene) -> Building:
        """Reads cells and portals from JSON.

        Parameters
        ----------
        path : path-like
            Either ``{"cells": [...], "portals": [...]}`` as the constructor takes them, with null for outdoors; or a
            building model: ``spaces`` (rooms with ``vertices`` and ``faces``), ``doors`` and ``opening_boxes``
            (``aabb_min``, ``aabb_max``), and ``windows`` of the same kind, whose panes let nothing through. Of these,
            an opening becomes a passage, a cell of its own with a portal at each end, and rooms that touch without a
            wall get a portal there.
        scene : Scene
            The building.

        Raises
        ------
        ValueError
            If the file is something else, and as for the constructor.
        """
        return cls(scene, *read_building(path))

    @classmethod
    def find(
        cls,
        scene: Scene,
        *,
        door: float | None = None,
        voxel: float | None = None,
        eye_height: float | None = None,
        max_bytes: float = 2e9,
        probes: int = 4000,
        seed: int = 0,
        threads: int | None = None,
        progress: Progress = None,
    ) -> Building:
        """Finds rooms and the openings between them in a mesh.

        Parameters
        ----------
        scene : Scene
            A building whose walls are faces; they need not be closed, but gaps of less than a voxel or two count as
            closed.
        door : float, optional
            The widest opening that separates rooms, in the scene's units; wider ones make one room of both, and so do
            those larger than its square. By default 1.375 times as much as eyes are high, if that is given, else 0.85
            of the height of rooms, as it is found in the mesh: 2.2 m in both cases in a house.
        voxel : float, optional
            The side of the cubes in which it is searched. By default a tenth of `door`, or such that there are 2
            million if that is smaller; larger where that would take more memory than `max_bytes`.
        eye_height : float, optional
            Of people, above the floor, in the scene's units: says how large the scene is.
        max_bytes : float
            More cubes than fit into so many bytes are refused.
        probes, seed, threads
            As for `completed`, which is done at the end; with 0 probes it isn't.
        progress : bool, callable or None
            See `cyclorama.progress`; units are faces, then probes.

        Returns
        -------
        Building
            Cells are made of cubes. A portal is the smallest section of the free space between two rooms, across an
            axis, and three cubes more on all sides.

        Raises
        ------
        ValueError
            If no room is found, with what to set; a door is not wider than three voxels; or it would take more memory.

        Notes
        -----
        See `cyclorama.portals.finding`. Gratings with gaps narrower than two voxels count as walls; what the probes see
        through them is drawn with the cell that they see it from.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> home = cyc.scenes.house(rooms=4)
        >>> Building.find(home, progress=False)
        <Building: 4 cells, ...
        """
        checked_whole("probes", probes, 0)
        checked_whole("seed", seed, 0)
        with reporter(progress, len(scene) + probes, "faces and probes") as report:
            found = find(scene, door, voxel, eye_height, max_bytes, report)
            report(len(scene))
            building = cls(scene, found.cells, found.portals, faces=found.faces)
            return building._with(look(building, probes, seed, threads, lambda done: report(len(scene) + done)))

    def completed(
        self, probes: int = 4000, *, seed: int = 0, threads: int | None = None, progress: Progress = None
    ) -> Building:
        """The same building, with what is seen past its portals.

        From eyes in each cell and outdoors it is looked, in all directions, at what the portals don't show: through
        gaps that are no portals. Such faces, with those around them, are drawn with the eye's cell from then on.

        Parameters
        ----------
        probes : int
            Eyes to look from.
        seed : int
            Where they are.
        threads : int, optional
            All cores by default. The answer does not depend on it.
        progress : bool, callable or None
            See `cyclorama.progress`; units are probes.

        Returns
        -------
        Building
            Its `leaks` tell how many eyes saw more, and how many of the last ones none.

        Raises
        ------
        ValueError
            If `probes` is negative.

        Examples
        --------
        A building whose windows nobody told of:

        >>> import cyclorama as cyc
        >>> home = cyc.scenes.house(rooms=3)
        >>> doors = [portal for portal in home.portals if None not in portal["cells"]]
        >>> building = Building(home, home.cells, doors).completed(100, progress=False)
        >>> building.leaks.lost.any()
        np.True_
        """
        checked_whole("probes", probes, 0)
        checked_whole("seed", seed, 0)
        with reporter(progress, probes, "probes") as report:
            return self._with(look(self, probes, seed, threads, report))

    def _with(self, leaks: Leaks) -> Building:
        building = Building(self.scene, self.cells, self.portals, faces=leaks.faces)
        building.leaks = leaks
        return building

    def __repr__(self) -> str:
        return f"<Building: {len(self.cells)} cells, {len(self.portals)} portals, {len(self.scene):,} faces>"

    def cell(self, eye: npt.ArrayLike) -> int | None:
        """The cell that a point is in; None outdoors, on a portal, and in something solid.

        Solid is what the scene's faces wind around, so it has to be closed; a wall may reach into a cell's box. Where
        cells were found, it is what is farther than four cubes from all of them.
        """
        at = _eye(eye)
        return None if self._at_portals(at) or self.is_solid(at) else self._holding(at)

    def _holding(self, eye: Floats) -> int | None:
        rooms = self.cells[0].rooms
        if rooms is not None:
            label = rooms.at(eye)
            return label if label >= 0 else None
        return next((index for index, cell in enumerate(self.cells) if cell.holds(eye)), None)

    def is_solid(self, eye: Floats) -> bool:
        """Whether nothing can be seen from a point; see `cell`."""
        rooms = self.cells[0].rooms
        return not (self.is_open(eye) or (rooms is not None and rooms.near(eye, NEAR)))

    def is_open(self, eye: Floats) -> bool:
        """Whether a point is in nothing solid, and where cells were found in no cube that faces reach into either."""
        rooms = self.cells[0].rooms
        if rooms is not None:
            return rooms.at(eye) != FILLED
        return abs(self._surface.winding(eye.tolist())) <= 0.5

    def _at_portals(self, eye: Floats) -> list[int]:
        return self.kernel.at(eye.tolist(), TOUCH * self._size)

    def visible(self, camera: Camera) -> Ids:
        """The faces that a camera may see: those in its frustum as far as the portals let it through.

        Parameters
        ----------
        camera : Camera
            A pinhole camera, in a cell, in an opening or outdoors.

        Returns
        -------
        (K,) ndarray of uint32
            Ascending. No visible face is missing, as long as the portals are all openings there are.

        Raises
        ------
        ValueError
            If the eye is in something solid, or the camera is orthographic.

        Notes
        -----
        Every sequence of portals is followed, each with the frustum that is left of it. A ray crosses a flat portal
        once, so none is taken twice and loops end; what was looked at through a portal already is not again.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> home = cyc.scenes.house(rooms=4)
        >>> building = Building(home, home.cells, home.portals)
        >>> eye = (home.cells[0]["min"] + home.cells[0]["max"]) / 2
        >>> len(building.visible(cyc.Camera.look_at(eye, eye + (1, 0, 0)))) < len(home)
        True
        """
        return self.kernel.walk(*self.start(camera))[0]

    def cells_seen(self, camera: Camera) -> list[int | None]:
        """The cells that a camera looks into, its own first; None is outdoors."""
        places = dict.fromkeys(self.kernel.walk(*self.start(camera))[1])
        return [None if place == len(self.cells) else place for place in places]

    def views(self, camera: Camera) -> list[tuple[int, Cone]]:
        """Each cell that is looked into, for each sequence of portals that shows more of it, with the rest of the view.

        Outdoors is ``len(cells)``.

        Raises
        ------
        ValueError
            As for `visible`.
        """
        found = self.kernel.views(*self.start(camera))
        eye = camera.eye
        return [(place, Cone(eye, planes[:, :3], planes[:, 3])) for place, planes in found]

    def start(self, camera: Camera) -> tuple[list[float], Floats, list[int], list[int]]:
        """What the kernel takes: eye, planes of the frustum (5, 4), the places that the eye is in, its portals."""
        cone = Cone.of(camera)
        places, crossed = self.places(cone.eye)
        return cone.eye.tolist(), np.column_stack([cone.normals, cone.offsets]), places, crossed

    def paint(
        self, kind: Kind = "static", *, on_demand: bool = False, progress: Progress = None, **options: Any
    ) -> PortalImages:
        """Makes the images by which `frame` and `draw` show portals.

        Parameters
        ----------
        kind : {"static", "warped", "layered"}
            Flat pictures, pictures with depth, or layered ones.
        on_demand : bool
            Paint nothing yet, but each image when it is first needed.
        progress : bool or callable, optional
            One unit is an image.
        **options
            As for `portals.images.PortalImages`, such as `up`, and a `folder` to keep them in.

        Returns
        -------
        PortalImages

        Raises
        ------
        ValueError
            As there.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> home = cyc.scenes.house(rooms=4)
        >>> building = Building(home, home.cells, home.portals)
        >>> building.paint("static", step=30, size=(32, 32), progress=False).store.missing()
        []
        """
        images = PortalImages(self, kind, **options)
        if not on_demand:
            images.paint(progress=progress)
        if self._images is not None:
            self._images.close()
        self._images = images
        return images

    @property
    def images(self) -> PortalImages:
        """What `paint` made; before that, static images that are painted on demand."""
        if self._images is None:
            self._images = PortalImages(self)
        return self._images

    def frame(
        self,
        eye: npt.ArrayLike | Camera,
        forward: npt.ArrayLike | None = None,
        *,
        fov_y: float = 60.0,
        size: tuple[int, int] = (510, 480),
    ) -> PortalFrame:
        """What is drawn for an eye if portals are images (section 6.2).

        Parameters
        ----------
        eye : (3,) array_like of float, or Camera
            Where it is; or a pinhole camera, and nothing else.
        forward : (3,) array_like of float
            Where it looks.
        fov_y : float
            Degrees from the lower to the upper border.
        size : (int, int)
            Of the picture in pixels.

        Returns
        -------
        PortalFrame
            `.faces` of the eye's cell, and of those behind portals that are nearer than their transition distance;
            `.views` of the other portals in sight, with the images that show them.

        Raises
        ------
        ValueError
            As for `visible`.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> home = cyc.scenes.house(rooms=4)
        >>> building = Building(home, home.cells, home.portals)
        >>> eye = (home.cells[0]["min"] + home.cells[0]["max"]) / 2
        >>> frame = building.frame(eye, home.portals[0]["polygon"].mean(0) - eye)
        >>> frame.cells, frame.views[0].portal
        ([0], 0)
        """
        return frame(self.images, self._camera(eye, forward, fov_y, size))

    def draw(
        self,
        eye: npt.ArrayLike | Camera,
        forward: npt.ArrayLike | None = None,
        *,
        fov_y: float = 60.0,
        size: tuple[int, int] = (510, 480),
        splat: Splat | None = None,
        max_ms: float | None = None,
        threads: int | None = None,
    ) -> PortalDrawn:
        """The picture of an eye: its cell, and images in the portals.

        Parameters
        ----------
        eye, forward, fov_y, size
            As for `frame`.
        splat : int or str, optional
            What a sample of a warped or layered image covers; see `cyclorama.warp.forward`. By default warped images
            are meshes, and samples of layered ones are as large as they appear.
        max_ms : float, optional
            Spend no more than so many milliseconds of a frame on painting images, though at least one picture is
            taken; until one is done the best that there is takes its place, or geometry. By default an image that is
            needed is painted at once.
        threads : int, optional
            All cores by default. The picture doesn't depend on it.

        Returns
        -------
        PortalDrawn
            `.color`, `.depth`, `.hole`, `.portal` and `.stats`. For transitions see `portals.drawing.PortalWalk`.

        Raises
        ------
        ValueError
            As for `frame`, and if `max_ms` is negative.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> home = cyc.scenes.house(rooms=4)
        >>> building = Building(home, home.cells, home.portals)
        >>> eye = (home.cells[0]["min"] + home.cells[0]["max"]) / 2
        >>> building.draw(eye, home.portals[0]["polygon"].mean(0) - eye, size=(64, 48)).hole.any()
        np.False_
        """
        camera = self._camera(eye, forward, fov_y, size)
        return draw(self.images, camera, splat=splat, max_ms=max_ms, threads=threads)

    def _camera(
        self, eye: npt.ArrayLike | Camera, forward: npt.ArrayLike | None, fov_y: float, size: tuple[int, int]
    ) -> Camera:
        if isinstance(eye, Camera):
            if forward is not None:
                raise ValueError("a camera knows where it looks: leave forward out")
            return eye
        if forward is None:
            raise ValueError("forward is missing: where the eye looks")
        at = _eye(eye)
        gaze = np.asarray(forward, np.float64)
        if gaze.shape != (3,) or not (np.isfinite(gaze).all() and gaze.any()):
            raise ValueError(f"forward must be three finite numbers, not all zero, got {gaze.tolist()}")
        return Camera.look_at(at, at + gaze, self.images.up, fov_y, *size)

    def places(self, eye: Floats) -> tuple[list[int], list[int]]:
        """Where an eye is: a cell, or the sides of the portals that it is in; and those portals."""
        outdoors = len(self.cells)
        at_portals = self._at_portals(eye)
        places = {outdoors if side is None else side for i in at_portals for side in self.portals[i].cells}
        if not places:
            if self.is_solid(eye):
                raise ValueError(f"the eye {eye.tolist()} is inside something solid: nothing can be seen from there")
            places |= self._held_by(eye)
        return sorted(places), at_portals

    def _held_by(self, eye: Floats) -> set[int]:
        """The cell that holds an eye; several, if it is in a cube that faces reach into, so near to them."""
        rooms = self.cells[0].rooms
        if rooms is not None and rooms.at(eye) == FILLED:
            return {len(self.cells) if label == OUTDOORS else label for label in rooms.near(eye, NEAR)}
        cell = self._holding(eye)
        return {len(self.cells) if cell is None else cell}

    def _assigned(self) -> list[Ids]:
        low, high = self._corners.min(axis=1), self._corners.max(axis=1)
        slack = TOUCH * self._size
        indoors = np.zeros(len(low), bool)
        assigned = []
        for cell in self.cells:
            reaches = ((low <= cell.high + slack) & (high >= cell.low - slack)).all(axis=1)
            assigned.append(np.flatnonzero(reaches).astype(np.uint32))
            if cell.triangles is None:
                indoors |= ((low > cell.low + slack) & (high < cell.high - slack)).all(axis=1)
        return [*assigned, np.flatnonzero(~indoors).astype(np.uint32)]


def _eye(eye: npt.ArrayLike) -> Floats:
    at = np.asarray(eye, dtype=np.float64)
    if at.shape != (3,) or not np.isfinite(at).all():
        raise ValueError(f"eye must be three finite numbers, got {at.tolist()}")
    return at
