"""The bake: which faces are seen from where, for every direction around a scene.

`join="samples"` is the papers' way: what an eye between viewpoints sees is taken to be what the three (or six)
viewpoints around it see (2001, section 3.2; 2002, sections 3.2 to 3.4). That misses what only a view between them sees
(2001, figure 4). `join="cells"` gives each face of the view sphere a row of its own, which begins with its corners and
grows by what probes inside it see.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .. import patches, sphere
from ..bitfield import Bitfields
from ..camera import Camera
from ..executors import Executor, Team
from ..fingerprint import fingerprint
from ..framing import Framing, unit_directions
from ..progress import Progress, reporter
from ..render import Fill
from ..scene import Scene
from .learning import Cells, Looker
from .probing import STRATEGIES, Prober
from .viewsphere import ViewSphere
from .visibility import Settings, Shell, Visibility, fold

__all__ = ["bake"]

Words = npt.NDArray[np.uint64]
Floats = npt.NDArray[np.float64]
Views = int | Sequence[Camera] | npt.ArrayLike


def bake(
    scene: Scene,
    views: Views = 258,
    patches: int | npt.ArrayLike | None = None,
    resolution: tuple[int, int] = (510, 480),
    fov_y: float = 45.0,
    fill: Fill = "rays",
    join: str = "cells",
    progress: Progress = None,
    *,
    max_missed: float | None = None,
    distances: Sequence[float] | None = None,
    join_count: int = 3,
    probes: int = 32,
    strategy: str = "edges",
    seed: int = 0,
    part: tuple[int, int] = (0, 1),
    threads: int | None = None,
    executor: Executor | None = None,
) -> Visibility:
    """Finds out what of a scene can be seen from any direction around it.

    Parameters
    ----------
    scene : Scene
        F faces. Transparent ones hide nothing and are in every answer (2001, section 3.4).
    views : int, (N, 3) array_like of float, or sequence of Camera
        A size of the octahedral sphere (6, 18, 66, 258, 1026, 4098; 2002, section 3.2.1), any other number from 4 for a
        Fibonacci sphere; directions from the scene's centre; or the author's own shots, taken as they are. Directions
        and shots have to surround the scene.
    patches : int, (F,) array_like of int, or None
        Number of patches to tile the scene into, or the patch of each face; rows then have a bit per patch, which is
        visible if any of its faces is.
    resolution : (int, int)
        Width and height of the images in pixels.
    fov_y : float
        Vertical field of view in degrees. The cameras stand where the scene's bounding sphere just fits into it.
    fill : {"rays", "neighbours", None}
        How visible faces that own no pixel are found; see `Scene.visible`.
    join : {"cells", "samples"}
        Whether each face of the view sphere gets a row of its own, with what probes inside it see, or is answered by
        the union of the samples around it, as in the papers.
    progress : bool, callable or None
        See `cyclorama.progress`; units are views.
    max_missed : float, optional
        Find views, patches and resolution that miss no more than this share of the pixels; see
        `cyclorama.bakes.adaptive`. `views` is then the sphere to begin with, and `statement` says what was reached, and
        how surely.
    distances : sequence of float, optional
        Distances to bake, in sampling radii, each outside the bounding sphere; infinity for parallel rays. By default
        the sampling radius alone.
    join_count : {3, 6}
        Samples that `join="samples"` joins.
    probes : int
        Most probes for each face of the view sphere; 0 for none. A face is done earlier when its last four found
        nothing new.
    strategy : {"edges", "spread", "random", "guided"}
        Where probes look from; see `cyclorama.bakes.probing`.
    seed : int
        Of the probes' places.
    part : (int, int)
        Which of how many parts of the view sphere's faces get probes: (0, 3), (1, 3) and (2, 3) on three machines,
        joined by `merge`. The others answer what their corners see.
    threads : int, optional
        All cores by default; with an executor, one for each task. The answer does not depend on it.
    executor : Executor, optional
        Takes the views: any in the style of `concurrent.futures`, or a Dask client; see `cyclorama.executors`. The
        answer does not depend on it.

    Returns
    -------
    Visibility

    Raises
    ------
    ValueError
        If an argument is not of its kind or range, views do not surround the scene, two are in the same direction, or
        one is at its centre. The message names the argument, the index and the value.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> vis = bake(cyc.scenes.sphere(faces=320), views=18, resolution=(64, 64), progress=False)
    >>> 0.2 < vis.culling_rate() < 0.5
    True
    """
    check_options(join=join, join_count=join_count, probes=probes, strategy=strategy, seed=seed, part=part)
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene, got {type(scene).__name__}: cyclorama.load makes one")
    framing = Framing.of(scene, resolution, fov_y)
    shells_at = _distances(framing, distances)
    team = None if executor is None else Team(executor, scene)
    if max_missed is not None:
        from . import adaptive

        if join != "cells" or shells_at != [1.0] or part != (0, 1) or _shots(views) is not None:
            raise ValueError("max_missed= needs join='cells', no distances=, part= or cameras: it places views itself")
        return adaptive.bake_within(
            scene, max_missed, views, patches, framing, fill, probes, strategy, seed, threads, progress, team
        )
    points, faces, shots = view_points(scene, views)
    labels = patch_labels(scene, patches)
    settings = Settings(framing.resolution, float(fov_y), fill, join, join_count, seed)
    probed = probes if join == "cells" else 0
    total = len(shells_at) * (len(points) + len(faces) * probed)
    spent = np.zeros(len(faces), dtype=np.int64)
    scores: list[tuple[int, Floats]] = []
    shells = []
    looker = Looker(scene, framing, 1.0, fill, threads, team=team)
    with reporter(progress, total, "views") as report:
        looker.report = report
        for distance in shells_at:
            looker.distance = distance
            samples = looker.see(points) if shots is None else looker.see_cameras(shots)
            cells = None
            if join == "cells":
                begun = samples if shots is None else samples | looker.see(points)
                cells = Cells.of_corners(begun, faces)
                prober = Prober(points, faces, seed, strategy)
                cells.probe(looker, prober, np.arange(part[0], len(faces), part[1]), probes)
                spent += cells.probes
                scores += cells.scores
            shells.append(shell_of(distance, samples, None if cells is None else cells.rows, len(scene), labels))
        report(total)
    return Visibility(
        ViewSphere(points, faces, scene.center, framing.sampling_radius),
        shells,
        model_radius=scene.radius,
        size=len(scene),
        labels=labels,
        settings=settings,
        mesh=fingerprint(scene),
        probes=spent,
        found=mean_scores(scores),
    )


def check_options(*, join: str, join_count: int, probes: int, strategy: str, seed: int, part: tuple[int, int]) -> None:
    """Refuses options that are none, before any work."""
    if join not in ("cells", "samples"):
        raise ValueError(f"join must be 'cells' or 'samples', got {join!r}")
    if join_count not in (3, 6):
        raise ValueError(f"join_count must be 3 or 6, got {join_count!r}")
    if isinstance(probes, bool) or not isinstance(probes, int | np.integer) or probes < 0:
        raise ValueError(f"probes must be a count of at least 0, got {probes!r}")
    if strategy not in STRATEGIES:
        raise ValueError(f"strategy must be one of {', '.join(STRATEGIES)}, got {strategy!r}")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed must be an integer of at least 0, got {seed!r}")
    whole = isinstance(part, Sequence) and len(part) == 2 and all(isinstance(k, int | np.integer) for k in part)
    if not whole or not 0 <= part[0] < part[1]:
        raise ValueError(f"part must be (index, count) with 0 <= index < count, got {part!r}")


def view_points(scene: Scene, views: Views) -> tuple[Floats, npt.NDArray[np.uint32], list[Camera] | None]:
    """Directions of viewpoints, the sphere faces between them, and the author's cameras if `views` is such."""
    if isinstance(views, bool) or isinstance(views, float):
        raise ValueError(f"views must be a count, directions or cameras, got {views!r}")
    if isinstance(views, int | np.integer):
        count = int(views)
        if count < 4:
            raise ValueError(f"views must be at least 4, got {count}")
        level = (count - 2).bit_length() // 2 - 1
        if count == 4 ** (level + 1) + 2:
            return (*sphere.octahedron(level), None)
        points = sphere.fibonacci(count)
        return points, sphere.hull(points), None
    shots = _shots(views)
    if shots is not None:
        offsets = np.array([camera.eye - scene.center for camera in shots])
        for index in np.flatnonzero(~offsets.any(axis=1)):
            raise ValueError(f"views[{index}] is a camera at the scene's centre: it has no direction from there")
        points = unit_directions(offsets)
        return points, sphere.hull(points), shots
    points = unit_directions(views)  # type: ignore[arg-type]
    return points, sphere.hull(points), None


def patch_labels(scene: Scene, patches_: int | npt.ArrayLike | None) -> npt.NDArray[np.uint32] | None:
    """Patch of each face, numbered without gaps."""
    if patches_ is None:
        return None
    array = np.asarray(patches_)
    if array.ndim == 0:
        if array.dtype.kind not in "iu" or array < 1:
            raise ValueError(f"patches must be a count of at least 1, or a label for each face, got {patches_!r}")
        return patches.tile(scene.vertices, scene.faces, int(array))
    if array.shape != (len(scene),) or array.dtype.kind not in "iu":
        raise ValueError(f"patches must be ({len(scene)},) integers, got {array.shape} {array.dtype}")
    if array.min() < 0:
        index = int(array.argmin())
        raise ValueError(f"patches[{index}] is {array[index]}: labels are at least 0")
    if array.max() >= len(scene):
        index = int(array.argmax())
        raise ValueError(f"patches[{index}] is {array[index]}: {len(scene)} faces have no more patches than that")
    return array.astype(np.uint32)


def shell_of(
    distance: float, samples: Words, cells: Words | None, size: int, labels: npt.NDArray[np.uint32] | None
) -> Shell:
    """Rows over faces, or folded to patches."""
    if labels is None:
        return Shell(distance, Bitfields(samples, size), None if cells is None else Bitfields(cells, size))
    return Shell(distance, fold(samples, labels), None if cells is None else fold(cells, labels))


def mean_scores(scores: list[tuple[int, Floats]]) -> Floats:
    """(P, 2) mean share that probe number k of the sphere faces found missing, and of how many faces, by number."""
    total: dict[int, tuple[float, int]] = {}
    for number, missed in scores:
        sum_, count = total.get(number, (0.0, 0))
        total[number] = (sum_ + float(missed.sum()), count + len(missed))
    return np.array([(s / max(n, 1), n) for _, (s, n) in sorted(total.items())]).reshape(-1, 2)


def _distances(framing: Framing, distances: Sequence[float] | None) -> list[float]:
    if distances is None:
        return [1.0]
    array = np.asarray(distances, dtype=np.float64)
    if array.ndim != 1 or len(array) == 0:
        raise ValueError(f"distances must be a sequence of numbers, got {distances!r}")
    for value in array.tolist():
        framing.check_distance(value)
    values = sorted(set(array.tolist()))
    return values


def _shots(views: Views) -> list[Camera] | None:
    """The author's cameras, if that is what `views` is."""
    if isinstance(views, np.ndarray) and views.dtype == object:
        views = views.tolist()
    if not isinstance(views, Sequence) or isinstance(views, str | bytes):
        return None
    shots = [camera for camera in views if isinstance(camera, Camera)]
    if shots and len(shots) < len(views):
        index = next(k for k, camera in enumerate(views) if not isinstance(camera, Camera))
        raise ValueError(f"views[{index}] is no camera, others are: {views[index]!r}")
    return shots or None
