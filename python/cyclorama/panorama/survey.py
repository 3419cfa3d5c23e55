"""What culling saves and loses on a track: tables 1 and 2 of the 2003 paper, and what they don't say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..arguments import checked_pair, checked_whole
from ..camera import Camera
from ..progress import Progress, reporter
from ..scene import Scene
from .culling import Method, check_culling, eyes_around, kept_tiles
from .projection import Kind, Projection
from .renderers import BuiltIn, Renderer
from .slicing import closed_step, mesh_error, places_of, ranges_between, reach_of, slabs_of
from .store import Reference, Slab
from .tiles import ACROSS, Codec, encode, tile_numbers
from .track import Track
from .viewing import seen_between

__all__ = ["Losses", "Row", "Survey"]

Mask = npt.NDArray[np.bool_]

# What is farther by so much is another surface.
_FARTHER = 1.05
# A tile is shown by a view that has so many pixels of it.
_SHOWN = 3


@dataclass(frozen=True)
class Row:
    """A slab's line of a table: sums over all references.

    Attributes
    ----------
    slab : int
        The nearest is 1.
    method : str
    alpha : float
    all : int
        Tiles of the panoramas, empty ones with them.
    tiles, kept : int
        Tiles with something in them, and those of them that are kept.
    bytes, kept_bytes : int
        Of their pictures and quads as they are stored.
    kept_pictures : int
        Of `kept_bytes`, those of pictures.
    raw, kept_raw : int
        Of 4 bytes a pixel and the quads uncompressed, which is what the paper's sizes are.
    """

    slab: int
    method: str
    alpha: float
    all: int
    tiles: int
    kept: int
    bytes: int
    kept_bytes: int
    kept_pictures: int
    raw: int
    kept_raw: int

    @property
    def reduction(self) -> float:
        """Share of the tiles with something in them that is dropped: the paper's reduction rate."""
        return 1 - self.kept / self.tiles if self.tiles else 0.0


@dataclass(frozen=True)
class Losses:
    """What views along a track lose by culling.

    Attributes
    ----------
    views : int
    pixels : int
        Of all views.
    lost : int
        Pixels that show nothing, or a surface a twentieth farther away, instead of what the view with all tiles shows;
        where the built-in renderer draws, only those that were right before and are farther than what the scene has
        there. (Quads move surfaces by their stated error: where two slabs have the same surface, the nearer copy may
        be dropped, and the one that stays be the truer one. Near a panorama's upper and lower edge, where near
        surfaces are cut off, views with all tiles show what the scene hides.)
    changed : int
        Pixels whose colour differs, lost ones with them: where slabs overlap a surface is in both, and its edge falls
        half a pixel elsewhere when one of the two is dropped.
    views_hit : int
        Views with lost pixels.
    worst : float
        The largest share of a view.
    tiles_dropped, tiles_wrong : int
        Tiles that were dropped, and those of them of which some view shows three pixels or more, by one of its two
        references alone; None if that wasn't asked for.
    """

    views: int
    pixels: int
    lost: int
    changed: int
    views_hit: int
    worst: float
    tiles_dropped: int
    tiles_wrong: int | None


class Survey:
    """The references of a walkthrough in memory, with all their tiles: for tables, not for walking.

    Parameters
    ----------
    scene, track, slabs, size, projection, tile, spacing, places, mesh_pixels, up
        As for `bake`.
    allow_outside : bool
    progress : bool or callable, optional

    Attributes
    ----------
    references : list of Reference
    cuts : list of (float, float)
        The ranges of the slabs.
    places : (R,) ndarray

    Examples
    --------
    >>> import cyclorama as cyc
    >>> house = cyc.scenes.house(rooms=2)
    >>> eye = (house.cells[0]["min"] + house.cells[0]["max"]) / 2
    >>> survey = Survey(house, [eye, eye + [0.2, 0, 0]], 2, (256, 64), tile=8, spacing=0.1, progress=False)
    >>> [(row.slab, row.kept <= row.tiles) for row in survey.table()]
    [(1, True), (2, True)]
    >>> survey.losses(views=5, size=(64, 48)).lost < 10
    True
    """

    def __init__(
        self,
        scene: Scene | Renderer,
        track: Track | npt.ArrayLike,
        slabs: int | Sequence[float] = 3,
        size: tuple[int, int] = (4096, 1024),
        projection: Kind = "cylinder",
        tile: int = 32,
        *,
        spacing: float | None = None,
        places: npt.ArrayLike | None = None,
        mesh_pixels: float = 0.25,
        up: npt.ArrayLike = (0.0, 1.0, 0.0),
        allow_outside: bool = False,
        progress: Progress = None,
    ) -> None:
        renderer = BuiltIn(scene) if isinstance(scene, Scene) else scene
        self._renderer = renderer
        self.track = track if isinstance(track, Track) else Track(track)
        self.projection = Projection(projection, size, up=up)
        self.tile = tile
        self._mesh_pixels = mesh_pixels
        if isinstance(renderer, BuiltIn):
            self.track.check(renderer.scene, allow_outside=allow_outside)
        self.places = places_of(self.track, renderer, self.projection, spacing, places)
        eyes = self.track.at(self.places)
        self.cuts = ranges_between(slabs, renderer, self.projection, eyes)
        self._reach = reach_of(self.track, self.places)
        self.references: list[Reference] = []
        self._disparities: list[list[npt.NDArray[np.float32]]] = []
        if len(eyes) < 2 or self.places[0] != 0 or self.places[-1] != 1:
            raise ValueError(f"a survey needs references at both ends of the track, got {self.places.tolist()}")
        with reporter(progress, len(eyes), "references") as report:
            for index, eye in enumerate(eyes):
                made, disparities = slabs_of(
                    renderer, self.projection, eye, self.cuts, tile, mesh_pixels, float(self._reach[index])
                )
                self.references.append(Reference(eye, tuple(made)))
                self._disparities.append(disparities)
                report(index + 1)
        self._kept: dict[tuple[str | None, float, bool], list[list[Mask]]] = {}
        self._sizes: dict[tuple[str | None, float, bool, str], npt.NDArray[np.int64]] = {}

    def kept(self, method: Method | None = "exact", alpha: float = 1.0, *, smallest: bool = False) -> list[list[Mask]]:
        """The tiles that are kept, by reference and slab: see `kept_tiles`."""
        check_culling(method, alpha)
        key = (method, alpha, smallest)
        if key not in self._kept:
            self._kept[key] = [
                kept_tiles(
                    self.projection,
                    disparities,
                    self.cuts,
                    eyes_around(self.track, self.places, index),
                    tile=self.tile,
                    method=method,
                    alpha=alpha,
                    closed=closed_step(self.projection, float(self._reach[index])),
                    error=mesh_error(self.projection, float(self._reach[index]), self._mesh_pixels),
                    smallest=smallest,
                )
                for index, disparities in enumerate(self._disparities)
            ]
        return self._kept[key]

    def culled(self, kept: list[list[Mask]]) -> list[Reference]:
        """The references with only some of their tiles."""
        return [
            Reference(
                reference.eye,
                tuple(slab.without(keep) for slab, keep in zip(reference.slabs, masks, strict=True)),
            )
            for reference, masks in zip(self.references, kept, strict=True)
        ]

    def table(
        self,
        method: Method = "exact",
        alphas: Sequence[float] = (1.0,),
        *,
        codec: Codec = "smallest",
        smallest: bool = False,
    ) -> list[Row]:
        """Tiles and bytes of each slab before and after culling: the paper's tables 1 and 2, with its empty tiles.

        Parameters
        ----------
        method : {"exact", "paper"}
        alphas : sequence of float
        codec : {"smallest", "png", "webp"}
        smallest : bool
            See `kept_tiles`.
        """
        before = self._bytes(None, 1.0, codec, False).tolist()
        rows = []
        for alpha in alphas:
            after = self._bytes(method, alpha, codec, smallest).tolist()
            kept, full = self.kept(method, alpha, smallest=smallest), self.kept(None)
            for slab in range(len(self.cuts)):
                tiles = sum(int(np.count_nonzero(masks[slab])) for masks in full)
                stay = sum(int(np.count_nonzero(masks[slab])) for masks in kept)
                rows.append(
                    Row(
                        slab + 1,
                        method,
                        alpha,
                        full[0][slab].size * len(full),
                        tiles,
                        stay,
                        before[slab][0],
                        after[slab][0],
                        after[slab][1],
                        before[slab][2],
                        after[slab][2],
                    )
                )
        return rows

    def _bytes(self, method: Method | None, alpha: float, codec: Codec, smallest: bool) -> npt.NDArray[np.int64]:
        """(S, 3) bytes of each slab as stored, those of pictures, and uncompressed."""
        key = (method, alpha, smallest, codec)
        if key not in self._sizes:
            sizes = np.zeros((len(self.cuts), 3), np.int64)
            for reference in self.culled(self.kept(method, alpha, smallest=smallest)):
                for index, slab in enumerate(reference.slabs):
                    sizes[index] += _sizes(self.projection, slab, self.tile, codec)
            self._sizes[key] = sizes
        return self._sizes[key]

    def losses(
        self,
        method: Method = "exact",
        alpha: float = 1.0,
        *,
        views: int = 500,
        size: tuple[int, int] = (320, 240),
        fov_y: float = 60.0,
        seed: int = 0,
        smallest: bool = False,
        counts_tiles: bool = False,
        progress: Progress = None,
    ) -> Losses:
        """Draws views along the track with all tiles and without the dropped ones, and counts what differs.

        Parameters
        ----------
        method : {"exact", "paper"}
        alpha : float
        views : int
            At places of the track spread evenly but for a random part, looking in random directions along the horizon
            and up to 20 degrees off it.
        size : (int, int)
            Columns and rows of a view.
        fov_y : float
            Degrees.
        seed : int
        smallest : bool
            See `kept_tiles`.
        counts_tiles : bool
            Also counts the dropped tiles that some view shows, by drawing each view once more.
        progress : bool or callable, optional
        """
        views, size, seed = checked_whole("views", views, 1), checked_pair("size", size), checked_whole("seed", seed, 0)
        kept = self.kept(method, alpha, smallest=smallest)
        full, culled = self.references, self.culled(kept)
        rng = np.random.default_rng(seed)
        # A mixture of two tiles' colours is hardly ever a third one's.
        count = self.projection.height // self.tile * (self.projection.width // self.tile)
        colors = rng.integers(1, 256, (len(self.cuts), count, 3), dtype=np.uint8)
        codes = {int(code): tile for tile, code in enumerate(_codes(colors.reshape(-1, 3)))}
        wrong: set[tuple[int, int]] = set()
        labelled: dict[int, Reference] = {}
        lost = changed = hit = 0
        worst = 0.0
        ts = (np.arange(views) + rng.uniform(0, 1, views)) / views
        with reporter(progress, views, "views") as report:
            for done, t in enumerate(ts):
                first = int(np.clip(np.searchsorted(self.places, t, side="right") - 1, 0, len(self.places) - 2))
                between = float((t - self.places[first]) / (self.places[first + 1] - self.places[first]))
                eye = self.track.at(t)
                camera = self._camera(eye, rng, size, fov_y)
                pair = slice(first, first + 2)
                whole = seen_between(full[pair], between, self.projection, camera, (255, 0, 255))
                less = seen_between(culled[pair], between, self.projection, camera, (255, 0, 255))
                changed += int(np.count_nonzero((whole.color != less.color).any(axis=-1)))
                differs = (less.depth > _FARTHER * whole.depth) | (less.hole & ~whole.hole)
                if isinstance(self._renderer, BuiltIn):
                    there = _FARTHER * self._renderer.scene.render(camera).depth
                    differs &= (whole.depth <= there) & (less.depth > there)
                pixels = int(np.count_nonzero(differs))
                lost += pixels
                hit += pixels > 0
                worst = max(worst, pixels / differs.size)
                if counts_tiles:
                    for index in (first, first + 1):
                        if index not in labelled:
                            labelled = {i: picture for i, picture in labelled.items() if i == first}
                            labelled[index] = self._labelled(full[index], kept[index], colors)
                        shown = seen_between([labelled[index]], 0.0, self.projection, camera, (0, 0, 0))
                        found, times = np.unique(_codes(shown.color.reshape(-1, 3)), return_counts=True)
                        wrong.update((index, codes[code]) for code in found[times >= _SHOWN].tolist() if code in codes)
                report(done + 1)
        dropped = sum(
            int(np.count_nonzero(there & ~stay))
            for masks, stays in zip(self.kept(None), kept, strict=True)
            for there, stay in zip(masks, stays, strict=True)
        )
        return Losses(
            views, views * size[0] * size[1], lost, changed, hit, worst, dropped, len(wrong) if counts_tiles else None
        )

    def _camera(
        self, eye: npt.NDArray[np.float64], rng: np.random.Generator, size: tuple[int, int], fov_y: float
    ) -> Camera:
        turn, tilt = rng.uniform(0, 2 * np.pi), rng.uniform(-1, 1) * np.radians(20)
        right, up, back = self.projection.axes
        ahead = np.cos(tilt) * (np.sin(turn) * right - np.cos(turn) * back) + np.sin(tilt) * up
        return Camera.look_at(eye, eye + ahead, up=up, fov_y=fov_y, width=size[0], height=size[1])

    def _labelled(self, reference: Reference, kept: list[Mask], colors: npt.NDArray[np.uint8]) -> Reference:
        """The reference with each dropped tile in a colour of its own, all else black."""
        slabs = []
        for slab, keep, own in zip(reference.slabs, kept, colors, strict=True):
            label = np.where((slab.tiles & ~keep)[..., None], own.reshape(*keep.shape, 3), 0).astype(np.uint8)
            pixels = slab.pixels.copy()
            pixels[..., :3] = np.repeat(np.repeat(label, self.tile, axis=0), self.tile, axis=1)
            slabs.append(replace(slab, pixels=pixels))
        return Reference(reference.eye, tuple(slabs))


def _sizes(panorama: Projection, slab: Slab, tile: int, codec: Codec) -> tuple[int, int, int]:
    """Bytes of a slab's files, those of pictures, and uncompressed."""
    shape, kept = panorama.shape, slab.tiles.ravel()
    owners = slab.quads[:, 1].astype(np.int64) // tile * (shape[1] // tile) + slab.quads[:, 0] // tile
    stored = pictures = 0
    for sector in range(-(-(shape[1] // tile) // ACROSS)):
        numbers = tile_numbers(shape, tile, sector)
        numbers = numbers[kept[numbers]]
        if len(numbers):
            own = slab.quads[np.isin(owners, numbers)]
            picture, _, packed = encode(panorama, slab.pixels, own, numbers, tile, codec)
            stored += len(picture) + len(packed)
            pictures += len(picture)
    return stored, pictures, int(np.count_nonzero(kept)) * tile * tile * 4 + slab.quads.nbytes


def _codes(colors: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    """(N,) one number for each of (N, 3) colours."""
    return np.asarray(colors.astype(np.int64) @ np.array([1, 256, 65536]))
