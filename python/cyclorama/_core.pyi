"""The compiled kernels. Users call the modules beside this one."""

from collections.abc import Callable
from typing import Any, final

import numpy as np
import numpy.typing as npt

from .camera import CameraArrays

@final
class Mesh:
    def __new__(
        cls,
        vertices: npt.NDArray[np.float64],
        faces: npt.NDArray[np.uint32],
        transparent: npt.NDArray[np.bool_] | None = None,
    ) -> Mesh: ...
    def degenerate_faces(self) -> npt.NDArray[np.uint32]: ...
    def render(
        self,
        camera: tuple[object, ...],
        ids: npt.NDArray[np.uint32],
        depth: npt.NDArray[np.float32],
        faces: npt.NDArray[np.uint32] | None = None,
        engine: str = "auto",
        threads: int | None = None,
    ) -> None: ...
    def stages(
        self, cameras: tuple[object, ...], fill: str | None = None, supersampling: int = 3, points: int = 24
    ) -> list[tuple[str, float]]: ...
    def visible(
        self,
        cameras: tuple[object, ...],
        rows: npt.NDArray[np.uint64],
        fill: str | None = None,
        engine: str = "auto",
        threads: int | None = None,
        progress: object = None,
        rings: int = 1,
        supersampling: int = 3,
        points: int = 24,
    ) -> None: ...
    def hits(
        self,
        camera: tuple[object, ...],
        faces: npt.NDArray[np.uint32] | None,
        most: int,
        near: float,
        threads: int | None = None,
    ) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32], npt.NDArray[np.float32]]: ...
    def shade(
        self,
        camera: tuple[object, ...],
        ids: npt.NDArray[np.uint32],
        picture: npt.NDArray[np.uint8],
        colors: npt.NDArray[np.uint8] | None = None,
    ) -> None: ...

@final
class Layered:
    def __new__(
        cls,
        camera: tuple[object, ...],
        offsets: npt.NDArray[np.uint32],
        colors: npt.NDArray[np.uint8],
        disparities: npt.NDArray[np.float32],
        places: npt.NDArray[np.int8],
    ) -> Layered: ...
    @staticmethod
    def build(
        cameras: tuple[object, ...],
        pictures: list[tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.bool_]]],
        footprints: float,
        color: int,
        corners: bool,
        threads: int | None = None,
    ) -> tuple[Layered, npt.NDArray[np.uint8], npt.NDArray[np.uint32]]: ...
    def warp(
        self,
        camera: tuple[object, ...],
        out: tuple[npt.NDArray[Any], ...],
        size: int,
        order: str,
        exact: bool,
        background: npt.NDArray[np.uint8] | None = None,
        keep: bool = False,
        threads: int | None = None,
    ) -> tuple[int, int, int]: ...
    def warp_patches(
        self,
        camera: tuple[object, ...],
        out: tuple[npt.NDArray[Any], ...],
        wanted: npt.NDArray[np.bool_] | None = None,
        background: npt.NDArray[np.uint8] | None = None,
        keep: bool = False,
        threads: int | None = None,
    ) -> None: ...
    def warp_as_paper(
        self,
        camera: tuple[object, ...],
        out: tuple[npt.NDArray[Any], ...],
        size: int,
        count: int,
        side: int,
        background: npt.NDArray[np.uint8] | None = None,
        keep: bool = False,
        threads: int | None = None,
    ) -> npt.NDArray[np.uint8]: ...
    def octree(self, count: int, side: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int64]]: ...
    def epipolar_nodes(self, camera: tuple[object, ...], count: int, side: int) -> tuple[int, list[int]]: ...
    def shown(
        self, cameras: tuple[object, ...], size: int, order: str, threads: int | None = None
    ) -> npt.NDArray[np.uint32]: ...
    def filter(self, keep: npt.NDArray[np.bool_]) -> Layered: ...
    def __len__(self) -> int: ...
    def offsets(self) -> npt.NDArray[np.uint32]: ...
    def disparities(self) -> npt.NDArray[np.float32]: ...
    def colors(self) -> npt.NDArray[np.uint8]: ...
    def places(self) -> npt.NDArray[np.int8]: ...

@final
class Octree:
    def __new__(
        cls, mesh: Mesh, leaf_faces: int, depth: int, stop: int, threads: int | None = None, progress: object = None
    ) -> Octree: ...
    def cull(
        self, planes: npt.NDArray[np.float64], counts: list[int], repeated: bool
    ) -> tuple[npt.NDArray[np.uint32], list[int]]: ...
    def counts(self) -> tuple[int, int, int, int]: ...
    def nodes(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.uint32]]: ...

@final
class Portals:
    def __new__(
        cls,
        corners: npt.NDArray[np.float64],
        polygons: npt.NDArray[np.float64],
        ends: list[int],
        places: list[tuple[int, int]],
        shut: list[bool],
        faces: list[npt.NDArray[np.uint32]],
    ) -> Portals: ...
    def at(self, point: list[float], slack: float) -> list[int]: ...
    def views(
        self, eye: list[float], planes: npt.NDArray[np.float64], places: list[int], crossed: list[int]
    ) -> list[tuple[int, npt.NDArray[np.float64]]]: ...
    def walk(
        self,
        eye: list[float],
        planes: npt.NDArray[np.float64],
        places: list[int],
        crossed: list[int],
        image: Callable[[int], bool] | None = None,
    ) -> tuple[npt.NDArray[np.uint32], list[int], list[tuple[int, npt.NDArray[np.float64]]], list[int]]: ...
    def behind(self, eye: list[float], side: int) -> npt.NDArray[np.uint32]: ...

@final
class Solid:
    def __new__(cls, triangles: npt.NDArray[np.float64]) -> Solid: ...
    def winding(self, point: list[float]) -> float: ...

def triangles_overlap_boxes(
    triangles: npt.NDArray[np.float64], low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]: ...
def instruction_set() -> str: ...
def instruction_sets() -> list[str]: ...
def use_instruction_set(name: str) -> None: ...
def bitfield_check(words: npt.NDArray[np.uint64], size: int) -> None: ...
def bitfield_pack(flags: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint64]: ...
def bitfield_unpack(words: npt.NDArray[np.uint64], size: int) -> npt.NDArray[np.bool_]: ...
def bitfield_union(words: npt.NDArray[np.uint64], rows: npt.NDArray[np.int64], out: npt.NDArray[np.uint64]) -> None: ...
def bitfield_intersection(
    words: npt.NDArray[np.uint64], rows: npt.NDArray[np.int64], out: npt.NDArray[np.uint64]
) -> None: ...
def bitfield_difference(a: npt.NDArray[np.uint64], b: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]: ...
def bitfield_count(words: npt.NDArray[np.uint64]) -> npt.NDArray[np.int64]: ...
def bitfield_ids(row: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint32]: ...
def bitfield_ids_into(row: npt.NDArray[np.uint64], out: npt.NDArray[np.uint32]) -> int: ...
def bitfield_ids_under(row: npt.NDArray[np.uint64], summary: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint32]: ...
def bitfield_summary(words: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]: ...
def bitfield_from_ids(ids: npt.NDArray[np.uint32], size: int) -> npt.NDArray[np.uint64]: ...
def bitfield_lists(words: npt.NDArray[np.uint64]) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.uint32]]: ...
def bitfield_encode(
    words: npt.NDArray[np.uint64], size: int
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint8], npt.NDArray[np.uint64], int]: ...
def bitfield_decode(
    size: int,
    references: npt.NDArray[np.uint32],
    bytes: npt.NDArray[np.uint8],
    starts: npt.NDArray[np.uint64],
    checksum: int,
) -> npt.NDArray[np.uint64]: ...
def sample(picture: npt.NDArray[np.uint8], at: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]: ...
def compose(
    canvas: tuple[
        npt.NDArray[np.uint8],
        npt.NDArray[np.float32],
        npt.NDArray[np.uint32],
        npt.NDArray[np.bool_] | None,
        npt.NDArray[np.int32],
    ],
    layer: tuple[
        npt.NDArray[np.float32],
        npt.NDArray[np.float32] | None,
        npt.NDArray[np.uint8] | None,
        npt.NDArray[np.uint32] | None,
        npt.NDArray[np.bool_] | None,
        npt.NDArray[np.bool_] | None,
    ],
    at: tuple[int, int],
    label: int,
    scale: float = 1.0,
    names: npt.NDArray[np.uint32] | None = None,
    twice: npt.NDArray[np.bool_] | None = None,
) -> int: ...
def face_colors(ids: npt.NDArray[np.uint32], colors: npt.NDArray[np.uint8], picture: npt.NDArray[np.uint8]) -> None: ...
def nearest_cells(
    boxes: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.uint32]],
    cells: npt.NDArray[np.int64],
    gaze: npt.NDArray[np.float64],
    room: int,
) -> tuple[npt.NDArray[np.uint32], float]: ...
def rays_enter(
    sides: npt.NDArray[np.float64],
    near: float,
    depth: npt.NDArray[np.float32],
    within: npt.NDArray[np.bool_],
) -> int: ...
def morton_order(points: npt.NDArray[np.float64]) -> npt.NDArray[np.uint32]: ...
def visibility_probe(
    mesh: Mesh,
    cameras: CameraArrays,
    rows: npt.NDArray[np.uint64],
    row_of: npt.NDArray[np.uint32],
    seen: npt.NDArray[np.uint64],
    labels: npt.NDArray[np.uint32] | None = None,
    threads: int | None = None,
    progress: Callable[[int], object] | None = None,
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]: ...
def face_adjacency(
    vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.uint32]
) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.uint32]]: ...
def tile(
    vertices: npt.NDArray[np.float64],
    faces: npt.NDArray[np.uint32],
    count: int,
    progress: Callable[[int], object] | None,
) -> tuple[npt.NDArray[np.uint32], int]: ...

@final
class Locator:
    def __new__(cls, points: npt.NDArray[np.float64], faces: npt.NDArray[np.uint32]) -> Locator: ...
    def locate(self, directions: npt.NDArray[np.float64]) -> npt.NDArray[np.uint32]: ...
    def locate_into(self, directions: npt.NDArray[np.float64], out: npt.NDArray[np.uint32]) -> None: ...
    def surrounding(self, face: npt.NDArray[np.int64]) -> npt.NDArray[np.uint32]: ...

def octahedron_sphere(level: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]: ...
def fibonacci_points(n: int) -> npt.NDArray[np.float64]: ...
def hull_faces(points: npt.NDArray[np.float64]) -> npt.NDArray[np.uint32]: ...
def surrounding_six(faces: npt.NDArray[np.uint32], face: npt.NDArray[np.int64]) -> npt.NDArray[np.uint32]: ...
def faces_in_cap(
    points: npt.NDArray[np.float64],
    faces: npt.NDArray[np.uint32],
    direction: tuple[float, float, float],
    angle: float,
) -> npt.NDArray[np.uint32]: ...
def crossing_angle(radius: float, sampling_radius: float, eye_distance: float) -> float: ...
def subdivide_faces(
    points: npt.NDArray[np.float64], faces: npt.NDArray[np.uint32], which: npt.NDArray[np.uint32]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32], npt.NDArray[np.uint32]]: ...
def cover_rows(words: npt.NDArray[np.uint64], spare: int) -> npt.NDArray[np.uint32]: ...
def depth_mesh_joins(
    disparity: npt.NDArray[np.float32],
    missing: npt.NDArray[np.bool_],
    step: tuple[float, float],
    slope: float,
    ids: npt.NDArray[np.uint32] | None = None,
    mesh: Mesh | None = None,
) -> npt.NDArray[np.uint8]: ...
def depth_mesh_warp(
    cameras: CameraArrays,
    images: list[tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.bool_] | None]],
    joins: list[npt.NDArray[np.uint8]],
    out: tuple[
        npt.NDArray[np.uint8],
        npt.NDArray[np.float32],
        npt.NDArray[np.bool_],
        npt.NDArray[np.bool_],
        npt.NDArray[np.uint8],
    ],
    background: npt.NDArray[np.uint8] | None = None,
    keep: bool = False,
    threads: int | None = None,
) -> None: ...
def warp_fill(
    color: npt.NDArray[np.uint8], depth: npt.NDArray[np.float32], hole: npt.NDArray[np.bool_], method: str
) -> None: ...
def warp_forward(
    cameras: CameraArrays,
    images: list[tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.bool_] | None]],
    out: tuple[
        npt.NDArray[np.uint8],
        npt.NDArray[np.float32],
        npt.NDArray[np.bool_],
        npt.NDArray[np.bool_],
        npt.NDArray[np.uint8],
    ],
    splat: str,
    order: str,
    background: npt.NDArray[np.uint8] | None = None,
    keep: bool = False,
    threads: int | None = None,
) -> None: ...
def warp_map(cameras: CameraArrays, disparity: npt.NDArray[np.float64], out: npt.NDArray[np.float64]) -> None: ...

_CellArrays = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.uint32]]
_Vector = tuple[float, float, float]

def placement_cells(
    mesh: Mesh, leaf_depth: int
) -> tuple[
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.uint32],
    npt.NDArray[np.uint32],
    npt.NDArray[np.uint32],
]: ...
def placement_directions(
    cell_arrays: _CellArrays, viewpoint: _Vector, up: _Vector, tangents: tuple[float, float], threads: int | None
) -> tuple[
    npt.NDArray[np.float64],
    npt.NDArray[np.uint64],
    npt.NDArray[np.uint32],
    npt.NDArray[np.uint32],
    npt.NDArray[np.bool_],
    npt.NDArray[np.bool_],
]: ...
def placement_optimise(
    cell_arrays: _CellArrays,
    viewpoint: _Vector,
    forward: _Vector,
    up: _Vector,
    tangents: tuple[float, float],
    target: int,
    nearest: float,
    axis: float,
    constants: list[float],
    search: tuple[str, int, str, int, int, float],
) -> dict[str, Any] | None: ...
def placement_star(
    others: npt.NDArray[np.float64],
    tangents: tuple[float, float],
    up: _Vector,
    yaws: tuple[float, float] | None,
    domain: tuple[_Vector, _Vector] | None,
    tolerance: float,
    most: int,
) -> tuple[float, float, _Vector, _Vector, int]: ...
def placement_lattice(odd: bool, place: tuple[int, int, int], reach: float) -> npt.NDArray[np.float64]: ...
def placement_paper(
    cell_arrays: _CellArrays,
    domain: tuple[_Vector, _Vector],
    up: _Vector,
    tangents: tuple[float, float],
    budget: int,
    target: int,
    resolution: list[int],
    constants: list[float],
    search: tuple[str, int, str, int, int, float],
    star_shape: str,
    subdivide: str,
    most_viewpoints: int,
    threads: int | None = None,
    progress: object = None,
) -> dict[str, Any]: ...

@final
class Cells:
    def __new__(
        cls,
        mesh: Mesh,
        leaf_depth: int,
        levels: list[tuple[int, float, float]] = ...,
        regions: list[list[list[float]]] = ...,
        visible: npt.NDArray[np.uint64] | None = None,
    ) -> Cells: ...
    def order(self) -> npt.NDArray[np.uint32]: ...
    def nodes(self) -> npt.NDArray[np.uint32]: ...
    def place(
        self, options: dict[str, Any], threads: int | None = None, progress: object = None
    ) -> tuple[
        tuple[
            tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]],
            tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]],
        ]
        | None,
        tuple[int, list[float], float, float, int] | None,
    ]: ...
    def prove(
        self,
        options: dict[str, Any],
        viewpoints: npt.NDArray[np.float64],
        images: npt.NDArray[np.float64],
        threads: int | None = None,
        progress: object = None,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]: ...

@final
class Audit:
    def __new__(
        cls,
        low: npt.NDArray[np.float64],
        high: npt.NDArray[np.float64],
        counts: npt.NDArray[np.uint32],
        viewpoints: npt.NDArray[np.float64],
        corners: npt.NDArray[np.float64],
        axes: list[list[float]],
        tangents: tuple[float, float],
        budget: int,
        slack: float,
        spans: npt.NDArray[np.float64],
        regions: list[list[list[float]]],
        seen: npt.NDArray[np.uint32],
    ) -> Audit: ...
    def proof(
        self,
        boxes: npt.NDArray[np.float64],
        images: npt.NDArray[np.int32],
        domain: list[list[float]],
        pitch: tuple[float, float],
        threads: int | None = None,
        progress: object = None,
    ) -> None: ...

@final
class Plan:
    def __new__(
        cls,
        cells: Cells,
        viewpoints: npt.NDArray[np.float64],
        images: npt.NDArray[np.float64],
        shell: int,
        domain: list[list[float]],
        up: tuple[float, float, float],
        tangents: tuple[float, float],
        budget: int,
    ) -> Plan: ...
    def check(
        self,
        audit: Audit,
        starts: npt.NDArray[np.int64],
        eyes: npt.NDArray[np.float64],
        gazes: npt.NDArray[np.float64],
        angles: npt.NDArray[np.float64],
        threads: int | None = None,
        progress: object = None,
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.bool_], npt.NDArray[np.float64]]: ...
    def frame(
        self, eye: tuple[float, float, float], yaw: float, pitch: float, out: npt.NDArray[np.uint32]
    ) -> tuple[int, int]: ...
    def culled(self, index: int) -> npt.NDArray[np.uint32]: ...
    def images(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
    def angles(self, forward: tuple[float, float, float]) -> tuple[float, float]: ...

_Slab = tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint16], tuple[float, float], float]

@final
class Panorama:
    def __new__(cls, cylinder: bool, width: int, height: int, axes: npt.NDArray[np.float64]) -> Panorama: ...
    def directions(self) -> npt.NDArray[np.float64]: ...
    def places(self, directions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def render(
        self,
        mesh: Mesh,
        eye: _Vector,
        near: float,
        far: float,
        color: npt.NDArray[np.uint8],
        range: npt.NDArray[np.float32],
        ids: npt.NDArray[np.uint32],
        colors: npt.NDArray[np.uint8] | None = None,
        threads: int | None = None,
    ) -> None: ...
    def quads(
        self,
        disparity: npt.NDArray[np.float32],
        tile: int,
        tolerance: float,
        step: float,
        threads: int | None = None,
    ) -> tuple[npt.NDArray[np.uint16], tuple[float, float], float]: ...
    def packed(
        self, opaque: npt.NDArray[np.bool_], tile: int, tiles: list[int], quads: npt.NDArray[np.uint16]
    ) -> bytes: ...
    def unpacked(
        self, opaque: npt.NDArray[np.bool_], tile: int, tiles: list[int], bytes: bytes
    ) -> npt.NDArray[np.uint16]: ...
    def kept(
        self,
        slabs: list[npt.NDArray[np.float32]],
        tile: int,
        eyes: npt.NDArray[np.float64],
        alpha: float,
        step: float,
        slack: float,
        ends: list[float] | None = None,
        smallest: bool = False,
        threads: int | None = None,
    ) -> list[npt.NDArray[np.bool_]]: ...
    def view(
        self,
        references: list[tuple[_Vector, list[_Slab]]],
        between: float,
        camera: CameraArrays,
        color: npt.NDArray[np.uint8],
        disparity: npt.NDArray[np.float32],
        threads: int | None = None,
    ) -> None: ...

def panorama_ranges(
    mesh: Mesh, starts: npt.NDArray[np.float64], directions: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]: ...
