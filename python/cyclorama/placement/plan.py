"""What is drawn for an eye and a gaze: faces, and an image for the rest."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from .. import _core
from ..archives import read_archive, write_archive
from ..arguments import checked_whole
from ..executors import Executor
from ..fingerprint import fingerprint
from ..progress import Progress, reporter
from ..scene import Scene
from .check import Check, audit, check
from .prediction import Prediction, predict
from .several import Several
from .verify import FORMAT, ROUNDING

if TYPE_CHECKING:
    from .backdrops import Backdrops
    from .drawing import Drawn
    from .grid import GridPlan

__all__ = ["Frame", "Image", "Images", "Plan", "Proof", "Sight", "axes"]

Floats = npt.NDArray[np.float64]
Directions = Literal["yaw", "sphere"]

_FORMAT = "cyclorama placement plan 2"
_SAVED = ("budget", "optimize_to", "fov_x", "aspect", "directions", "leaf_depth", "shell")

# Gazes of a yaw plan may be off the horizon by so many degrees: what normalizing in float32 leaves.
_LEVEL = 1e-4


@dataclass(frozen=True, eq=False)
class Image:
    """An image of a plan, and where it is taken from.

    Attributes
    ----------
    index : int
        Its row in `Plan.images`.
    viewpoint : (3,) ndarray of float64
    corners : (4, 3) ndarray of float64
        Of the quadrilateral: top-left, top-right, bottom-right, bottom-left as seen from the viewpoint.
    forward : (3,) ndarray of float64
        The image's own gaze, across which the quadrilateral lies.
    """

    index: int
    viewpoint: Floats
    corners: Floats
    forward: Floats


@dataclass(frozen=True, eq=False)
class Frame:
    """What is drawn for an eye and a gaze.

    Attributes
    ----------
    faces : (K,) ndarray of uint32
        The faces of all cells that the frustum may see, without those behind the image; at most the budget.
    image : Image or None
        What stands for the rest; None where all that is seen fits the budget.
    levels : tuple of ndarray of uint32
        The faces of each coarser level of detail, if the plan has any; with `faces` they are at most the budget.
    others : tuple of Image
        More images of the same frame, if the plan has several for one: what they stand for is not among the faces.
    """

    faces: npt.NDArray[np.uint32]
    image: Image | None
    levels: tuple[npt.NDArray[np.uint32], ...] = ()
    others: tuple[Image, ...] = ()

    @property
    def images(self) -> tuple[Image, ...]:
        """All images of the frame."""
        return () if self.image is None else (self.image, *self.others)

    def __repr__(self) -> str:
        coarser = f" and {sum(map(len, self.levels)):,} coarser ones" if self.levels else ""
        return f"<Frame: {len(self.faces):,} faces{coarser}, {len(self.images)} images>"


@dataclass(frozen=True, eq=False)
class Images:
    """All images of a plan, I of them.

    Attributes
    ----------
    viewpoint : (I,) ndarray of int64
        Rows of `Plan.viewpoints`.
    corners : (I, 4, 3) ndarray of float64
    forward : (I, 3) ndarray of float64
        See `Image`.
    yaw : (I, 2) ndarray of float64
        Degrees, low and high: the gazes that the proof gives to the image. The low one is from 0 to 360, the high one
        may be beyond.
    """

    viewpoint: npt.NDArray[np.int64]
    corners: Floats
    forward: Floats
    yaw: Floats

    def __len__(self) -> int:
        return len(self.viewpoint)


@dataclass(frozen=True, eq=False)
class Sight:
    """What can be seen from where.

    Attributes
    ----------
    regions : (R, 2, 3) ndarray of float64
        Boxes of eyes, lowest and highest coordinates, that tile the domain.
    visible : (R, W) ndarray of uint64
        A bit for each face, bit k of word w is face 64 w + k; those of all levels of detail one after another.
    """

    regions: Floats
    visible: npt.NDArray[np.uint64]


@dataclass(frozen=True, eq=False)
class Proof:
    """Boxes of eyes and gazes that tile all there are, each with what serves it.

    Attributes
    ----------
    boxes : (L, 10) ndarray of float64
        Eyes, low and high; yaws, low and high; pitches, low and high. Radians.
    image : (L,) ndarray of int32
        -1 where no image is needed.
    """

    boxes: Floats
    image: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.boxes)


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """Images such that no frame draws more than a budget; made by `place_images`.

    Attributes
    ----------
    scene : Scene
    budget, optimize_to : int
        No frame draws more faces than the budget; images were chosen to leave no more than the other.
    fov_x, aspect : float
        Of all frames: degrees, and width over height.
    up : (3,) ndarray of float64
    directions : {"yaw", "sphere"}
        Whether gazes are level, or any.
    domain : (2, 3) ndarray of float64
        Where eyes may be: lowest and highest coordinates.
    leaf_depth : int
        Of the octree that faces are counted and culled in.
    viewpoints : (N, 3) ndarray of float64
    parameters : (I, 8) ndarray of float64
        Of each image its viewpoint's row, yaw and pitch in radians, distance of the plane, and where the quadrilateral
        ends over that distance: left, right, bottom, top.
    proof : Proof
    shell : int
        So many of the images, the last ones, are for eyes beyond the domain: all of the scene is behind each.
    grid : GridPlan or None
        The grid that the images are of, where it was asked for; files don't keep it.
    lod : tuple of (Scene, float)
        Coarser levels of detail, and the distances from the eye from which each takes the place of the one before.
    sight : Sight or None
        What can be seen from where; None where everything counts.
    images_per_frame : int
        The most images that stand for something in one frame.
    """

    scene: Scene
    budget: int
    optimize_to: int
    fov_x: float
    aspect: float
    up: Floats
    directions: Directions
    domain: Floats
    leaf_depth: int
    viewpoints: Floats
    parameters: Floats
    proof: Proof
    shell: int
    _cells: _core.Cells = field(repr=False)
    grid: GridPlan | None = field(default=None, repr=False)
    lod: tuple[tuple[Scene, float], ...] = field(default=(), repr=False)
    sight: Sight | None = field(default=None, repr=False)
    images_per_frame: int = 1
    _painted: list[Backdrops] = field(default_factory=list, repr=False)

    def __repr__(self) -> str:
        return (
            f"<Plan: {len(self.scene):,} faces, at most {self.budget:,} a frame by {len(self.images):,} images from "
            f"{len(self.viewpoints):,} viewpoints>"
        )

    def __getstate__(self) -> dict[str, Any]:
        """What other processes make the same plan of: not what kernels own, or what was painted here."""
        return {
            entry.name: getattr(self, entry.name) for entry in fields(self) if entry.name not in ("_cells", "_painted")
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.__dict__["_cells"] = cells_of(self.scene, self.leaf_depth, self.lod, self.sight)
        self.__dict__["_painted"] = []

    @property
    def tangents(self) -> tuple[float, float]:
        """Of half the horizontal and half the vertical angle of view."""
        half = float(np.tan(np.radians(self.fov_x) / 2))
        return half, half / self.aspect

    @cached_property
    def whole(self) -> Scene:
        """The scene with its coarser levels of detail behind it."""
        return joined(self.scene, self.lod)

    @property
    def gaps(self) -> float:
        """The share of all eyes and gazes that no image is proved to serve: 0 but for a grid whose star-shapes are the
        dissertation's."""
        boxes = self.proof.boxes
        spans = boxes[:, [3, 4, 5, 7]] - boxes[:, [0, 1, 2, 6]]
        if self.directions == "sphere":
            spans = np.column_stack([spans, np.sin(boxes[:, 9]) - np.sin(boxes[:, 8])])
        sizes = spans.prod(axis=1)
        return float(sizes[self.proof.image == -2].sum() / sizes.sum())

    @cached_property
    def _kernel(self) -> _core.Plan:
        viewpoints = np.ascontiguousarray(self.viewpoints[self.parameters[:, 0].astype(np.int64)])
        rest = np.ascontiguousarray(self.parameters[:, 1:])
        up = (float(self.up[0]), float(self.up[1]), float(self.up[2]))
        domain = self.domain.tolist()
        return _core.Plan(self._cells, viewpoints, rest, self.shell, domain, up, self.tangents, self.budget)

    @cached_property
    def images(self) -> Images:
        """All images."""
        corners, forward = self._kernel.images()
        count = len(self.parameters)
        spans = np.zeros((count, 2))
        yaws = self.parameters[:, 1]
        served = self.proof.image >= 0
        image, boxes = self.proof.image[served], self.proof.boxes[served]
        # Around the image's own yaw, so that no range is cut at zero.
        turns = (boxes[:, 6:8].mean(axis=1) - yaws[image] + np.pi) % (2 * np.pi) - np.pi
        half = (boxes[:, 7] - boxes[:, 6]) / 2
        np.minimum.at(spans[:, 0], image, turns - half)
        np.maximum.at(spans[:, 1], image, turns + half)
        low = (yaws + spans[:, 0]) % (2 * np.pi)
        return Images(
            viewpoint=self.parameters[:, 0].astype(np.int64),
            corners=corners.reshape(count, 4, 3),
            forward=forward,
            yaw=np.degrees(np.column_stack([low, low + spans[:, 1] - spans[:, 0]])),
        )

    def frame(
        self,
        eye: npt.ArrayLike,
        forward: npt.ArrayLike,
        out: npt.NDArray[np.uint32] | None = None,
        *,
        images: int | None = None,
    ) -> Frame:
        """What to draw for an eye and a gaze.

        Of the images whose viewpoint lies in the reverse frustum, whose plane lies beyond the eye, and with which the
        budget is kept, that of the closest viewpoint is taken. Beyond the domain, an image of the shell stands for all
        of the scene where that is too much.

        Parameters
        ----------
        eye : (3,) array_like of float
            In `domain`, or before the plane of an image of the shell.
        forward : (3,) array_like of float
            The direction of view, of any length but zero.
        out : (B,) ndarray of uint32, optional
            At least `budget` long, or as long as there are faces if those are fewer; the faces are a view of it.
        images : int, optional
            The most images of the frame, `images_per_frame` by default.

        Returns
        -------
        Frame

        Raises
        ------
        ValueError
            If the eye is not finite or nothing is placed for it, the direction is zero or not finite, or not level
            though the plan is for level gazes, or another argument is none of the above.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
        >>> frame = plan.frame([-0.9, 0, 0], [1, 0, 0])
        >>> len(frame.faces) <= 13_000
        True
        """
        at = _vector("eye", eye)
        yaw, pitch = self.angles(forward)
        most = self.images_per_frame if images is None else checked_whole("images", images, 1)
        room = min(self.budget, len(self.whole))
        if out is None:
            out = np.empty(room, np.uint32)
        elif out.dtype != np.uint32 or out.ndim != 1 or len(out) < room:
            raise ValueError(f"out must be {room} uint32, got {out.shape} {out.dtype}")
        count, index = self._kernel.frame((float(at[0]), float(at[1]), float(at[2])), yaw, pitch, out)
        if index == -2:
            if ((at >= self.domain[0]) & (at <= self.domain[1])).all():
                if self.gaps > 0:
                    raise ValueError(
                        f"no image serves eye {at.tolist()} with that gaze: the star-shapes of the plan's grid are not "
                        'proved; star_shape="certified" are'
                    )
                raise AssertionError("the proof says that an image serves this eye and gaze; please report it")
            low, high = self.domain.round(6).tolist()
            raise ValueError(
                f"eye {at.tolist()} is outside plan.domain, {low} to {high}, and not before any image of the shell: "
                "no image is placed for it"
            )
        image = None if index == -1 else self.image(index)
        more: list[int] = []
        if image is not None and most > 1:
            count, more = self._several.add(out, count, index, at, yaw, pitch, most - 1)
        others = tuple(self.image(other) for other in more)
        if not self.lod:
            return Frame(out[:count], image, others=others)
        # Levels follow one another in the answer as they do among the faces.
        ends = np.cumsum([len(self.scene), *(len(scene) for scene, _ in self.lod)])
        cuts = [int((out[:count] < end).sum()) for end in ends]
        levels = [out[a:b] - np.uint32(end) for a, b, end in zip(cuts, cuts[1:], ends, strict=False)]
        return Frame(out[: cuts[0]], image, tuple(levels), others)

    @cached_property
    def _several(self) -> Several:
        return Several(self)

    def angles(self, forward: npt.ArrayLike) -> tuple[float, float]:
        """Yaw and pitch of a gaze, in radians.

        Raises
        ------
        ValueError
            If the direction is zero or not finite, or not level though the plan is for level gazes.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
        >>> plan.angles([0, 0, 2])
        (0.0, 0.0)
        """
        gaze = _vector("forward", forward)
        largest = np.abs(gaze).max()
        if largest == 0:
            raise ValueError("forward is zero: it must be a direction")
        yaw, pitch = self._kernel.angles(tuple((gaze / largest).tolist()))
        if self.directions == "sphere":
            return yaw, pitch
        if abs(np.degrees(pitch)) > _LEVEL:
            raise ValueError(
                f"forward {gaze.tolist()} is pitched by {np.degrees(pitch):.4g} degrees, and this plan is for "
                'level gazes: only those are placed; directions="sphere" places for all'
            )
        return yaw, 0.0

    @property
    def axes(self) -> Floats:
        """(3, 3) unit vectors from which angles of the proof are measured: ahead, beside (a yaw of 90 degrees), up."""
        return axes(self.up)

    def cells(self) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64]]:
        """The faces, those of a cell one after another, and where each cell starts."""
        nodes = self._cells.nodes().astype(np.int64)
        return self._cells.order(), nodes[nodes[:, 1] > nodes[:, 0], 0]

    def check(
        self, frames: int = 1000, seed: int = 0, *, threads: int | None = None, progress: Progress = None
    ) -> Check:
        """Draws random frames, half of them near faces, edges and corners of the domain and looking inwards.

        Each is looked at with other code than drew it: whether the budget holds, each cell of faces is drawn, outside
        the frustum or behind the quadrilateral, the eye before the plane, the viewpoint in the reverse frustum.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
        >>> plan.check(frames=20, progress=False).is_sound
        True
        """
        if not (isinstance(frames, (int, np.integer)) and frames >= 1):
            raise ValueError(f"frames must be an integer of at least 1, got {frames!r}")
        return check(self, int(frames), seed, threads, progress)

    def certify(
        self, path: str | os.PathLike[str] | None = None, *, threads: int | None = None, progress: Progress = None
    ) -> int:
        """Checks the proof box by box, with code that shares nothing with what made it, and writes it if asked to.

        `cyclorama.placement.verify.verify` reads the file and checks it once more in plain NumPy, some hundred boxes a
        second.

        Parameters
        ----------
        path : path, optional
            The certificate, an `.npz` file.
        threads : int, optional
            All cores by default.
        progress : bool or callable, optional
            One unit is a box.

        Returns
        -------
        int
            The boxes of the proof.

        Raises
        ------
        ValueError
            If the proof does not hold: the message names what fails.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
        >>> plan.certify() == len(plan.proof)
        True
        """
        header, arrays = self._certificate()
        slack = ROUNDING * float(np.abs(self.whole.bounds).max() + np.abs(self.domain).max())
        opinion, _ = audit(self, slack)
        with reporter(progress, len(self.proof), "checking the proof") as report:
            domain, pitch = self.domain.tolist(), tuple(header["pitch"])
            opinion.proof(self.proof.boxes, self.proof.image, domain, pitch, threads, report)
        if path is not None:
            write_archive(path, FORMAT, header, arrays)
        return len(self.proof)

    def _certificate(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Header and arrays of the file that `verify` reads."""
        order, starts = self.cells()
        header: dict[str, Any] = {
            "scene": fingerprint(self.whole),
            "budget": self.budget,
            "tangents": self.tangents,
            "axes": self.axes.tolist(),
            "domain": self.domain.tolist(),
            "pitch": [-np.pi / 2, np.pi / 2] if self.directions == "sphere" else [0.0, 0.0],
            "levels": levels_of(self.scene, self.lod),
        }
        arrays: dict[str, npt.NDArray[Any]] = {
            "order": order,
            "starts": starts,
            "boxes": self.proof.boxes,
            "served": self.proof.image,
            "viewpoints": self.viewpoints[self.images.viewpoint],
            "corners": self.images.corners,
        }
        if self.sight is not None:
            arrays |= {"regions": self.sight.regions, "visible": self.sight.visible}
        return header, arrays

    def culled(self, index: int) -> npt.NDArray[np.uint32]:
        """The faces that an image stands for.

        Parameters
        ----------
        index : int
            Row of `images`.

        Returns
        -------
        (K,) ndarray of uint32
            Those of all cells wholly behind the quadrilateral as the viewpoint sees it.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
        >>> len(plan.culled(0)) > 0
        True
        """
        return self._kernel.culled(int(index))

    def paint(
        self,
        scene: Scene,
        size: tuple[int, int] = (512, 384),
        folder: str | os.PathLike[str] = "backdrops",
        *,
        on_demand: bool = False,
        executor: Executor | None = None,
        progress: Progress = None,
        **options: Any,
    ) -> Backdrops:
        """Paints a layered image for each placement into a folder; `draw` shows them.

        Parameters
        ----------
        scene : Scene
            The one that the plan was made for.
        size : (int, int)
            Of an image in pixels.
        folder : path
            Images that are there already are kept.
        on_demand : bool
            Paint nothing yet, but each image when it is first needed.
        executor : Executor, optional
            Paints the images; see `cyclorama.executors`. They don't depend on it.
        progress : bool or callable, optional
            One unit is an image.
        **options
            As for `placement.backdrops.Backdrops`.

        Raises
        ------
        ValueError
            If the scene isn't the plan's, or the folder has other backdrops.
        """
        from .backdrops import Backdrops

        if fingerprint(scene) != fingerprint(self.scene):
            raise ValueError("scene is not the one that the plan was made for: place images anew")
        backdrops = Backdrops(self, scene, folder, size=size, on_demand=on_demand, **options)
        if not on_demand:
            backdrops.paint(executor=executor, progress=progress)
        for old in self._painted:
            old.close()
        self._painted[:] = [backdrops]
        return backdrops

    def draw(
        self, eye: npt.ArrayLike, forward: npt.ArrayLike, size: tuple[int, int] = (510, 480), **options: Any
    ) -> Drawn:
        """The composed picture of an eye; see `placement.backdrops.Backdrops.draw`.

        Raises
        ------
        ValueError
            If nothing was painted, and as there.
        """
        if not self._painted:
            raise ValueError("nothing is painted yet: call plan.paint(scene, folder=...) first")
        return self._painted[0].draw(eye, forward, size, **options)

    def predict(self) -> Prediction:
        """What section 3.5 of the dissertation expects of this budget, beside `len(plan.images)`.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
        >>> plan.predict().case("best", "printed").viewpoints > 1
        True
        """
        return predict(
            len(self.scene),
            self.budget,
            self.optimize_to,
            fov_x=self.fov_x,
            aspect=self.aspect,
            leaf_cells=len(self.cells()[1]),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the plan, but not the scene, to an `.npz` file.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> import cyclorama as cyc
        >>> scene = cyc.scenes.pipes(20_000)
        >>> plan = cyc.place_images(scene, budget=13_000, progress=False)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     plan.save(Path(folder) / "plan.npz")
        ...     len(Plan.load(Path(folder) / "plan.npz", scene).images) == len(plan.images)
        True
        """
        header = {"scene": fingerprint(self.scene)} | {name: getattr(self, name) for name in _SAVED}
        header["lod"] = [(fingerprint(scene), distance) for scene, distance in self.lod]
        header["images_per_frame"] = self.images_per_frame
        arrays: dict[str, npt.NDArray[Any]] = {
            "up": self.up,
            "domain": self.domain,
            "viewpoints": self.viewpoints,
            "parameters": self.parameters,
            "boxes": self.proof.boxes,
            "served": self.proof.image,
        }
        if self.sight is not None:
            arrays |= {"regions": self.sight.regions, "visible": self.sight.visible}
        write_archive(path, _FORMAT, header, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str], scene: Scene, lod: Sequence[tuple[Scene, float]] = ()) -> Plan:
        """The plan that `save` wrote.

        Parameters
        ----------
        path : path
        scene : Scene
        lod : sequence of (Scene, float)
            The levels of detail that it was made with.

        Raises
        ------
        ValueError
            If the file is no whole plan, or the scene is not the one that the plan is for.
        FileNotFoundError
            If there is no such file.

        Examples
        --------
        See `save`.
        """
        with read_archive(path, _FORMAT, "plan") as (header, file):
            if header["scene"] != fingerprint(scene):
                raise ValueError("it is for another scene, or the scene has changed since")
            if header["lod"] != [[fingerprint(level), distance] for level, distance in lod]:
                raise ValueError(f"it has {len(header['lod'])} levels of detail, and lod= are not those")
            proof = Proof(file["boxes"], file["served"])
            names = ("up", "domain", "viewpoints", "parameters")
            known = {name: file[name] for name in names} | {name: header[name] for name in _SAVED}
            sight = Sight(file["regions"], file["visible"]) if "regions" in file.files else None
            cells = cells_of(scene, header["leaf_depth"], lod, sight)
            # Files of before have none.
            known["images_per_frame"] = header.get("images_per_frame", 1)
            return cls(scene=scene, proof=proof, _cells=cells, lod=tuple(lod), sight=sight, **known)

    def image(self, index: int) -> Image:
        """One of the images.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
        >>> plan.image(0).corners.shape
        (4, 3)
        """
        images = self.images
        viewpoint = self.viewpoints[images.viewpoint[index]]
        return Image(int(index), viewpoint, images.corners[index], images.forward[index])


def joined(scene: Scene, lod: Sequence[tuple[Scene, float]]) -> Scene:
    """A scene and its coarser levels of detail as one."""
    if not lod:
        return scene
    scenes = [scene, *(level for level, _ in lod)]
    starts = np.cumsum([0, *(len(s.vertices) for s in scenes[:-1])])
    faces = [s.faces.astype(np.int64) + start for s, start in zip(scenes, starts, strict=True)]
    colors = None
    if any(s.colors is not None for s in scenes):
        colors = np.concatenate([_face_colors(s) for s in scenes])
    transparent = None
    if any(s.transparent is not None for s in scenes):
        masks = [np.zeros(len(s), np.bool_) if s.transparent is None else s.transparent for s in scenes]
        transparent = np.concatenate(masks)
    vertices = np.concatenate([s.vertices.astype(np.float64) for s in scenes])
    return Scene(vertices, np.concatenate(faces), colors, transparent=transparent)


def _face_colors(scene: Scene) -> npt.NDArray[np.uint8]:
    """(F, 3) a colour for each face: the mean of its corners', or light grey."""
    if scene.colors is None:
        return np.full((len(scene), 3), 200, np.uint8)
    if len(scene.colors) == len(scene.vertices):
        return np.asarray(scene.colors[scene.faces].mean(axis=1).round().astype(np.uint8))
    return scene.colors


def levels_of(scene: Scene, lod: Sequence[tuple[Scene, float]]) -> list[tuple[int, float, float]]:
    """For each level of detail the end of its faces, and the distances between which it is drawn; none for only one."""
    if not lod:
        return []
    ends = np.cumsum([len(scene), *(len(level) for level, _ in lod)]).tolist()
    distances = [0.0, *(float(distance) for _, distance in lod), np.inf]
    return list(zip(ends, distances[:-1], distances[1:], strict=True))


def cells_of(scene: Scene, depth: int, lod: Sequence[tuple[Scene, float]], sight: Sight | None) -> _core.Cells:
    """The cells of a scene with its levels of detail, and what can be seen of them."""
    mesh, levels = joined(scene, lod)._mesh, levels_of(scene, lod)
    if sight is None:
        return _core.Cells(mesh, depth, levels)
    return _core.Cells(mesh, depth, levels, sight.regions.tolist(), np.ascontiguousarray(sight.visible))


def axes(up: Floats) -> Floats:
    """See `Plan.axes`."""
    x, y, z = np.abs(up)
    upright = up / np.linalg.norm(up)
    axis = np.eye(3)[2 if y >= max(x, z) else 0 if z >= x else 1]
    ahead = axis - upright * (upright @ axis)
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(upright, ahead), upright])


def _vector(name: str, value: npt.ArrayLike) -> Floats:
    vector = np.asarray(value, dtype=np.float64)
    if vector.shape != (3,):
        raise ValueError(f"{name} must have shape (3,), got {vector.shape}")
    if not np.isfinite(vector).all():
        raise ValueError(f"{name} is {vector.tolist()}: coordinates must be finite")
    return vector
