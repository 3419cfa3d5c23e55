"""How well a bake answers: random views that it has not seen, drawn with and without culling."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import bitfield
from ..camera import Camera
from ..framing import Framing
from ..lab import elapsed
from ..progress import Progress, reporter
from ..render import BACKGROUND
from ..scene import Scene
from .confidence import bootstrap_interval, upper_mean
from .visibility import Visibility

__all__ = ["Evaluation", "evaluate", "random_directions"]

Floats = npt.NDArray[np.float64]

#: Bins of the histogram of intensity differences: a pixel's intensity lies in [0, 1] (2001, figure 7).
BINS = np.linspace(0.0, 1.0, 52)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Figures of V held-out views.

    Attributes
    ----------
    eyes : (V, 3) ndarray of float64
        Where the views were taken from, in the scene's units.
    distances : (V,) ndarray of float64
        Of the eyes from the centre, in sampling radii.
    missed : (V,) ndarray of float64
        Share of covered pixels whose nearest face is not in the answer.
    missed_pixels, covered_pixels : (V,) ndarray of int64
        The same as counts.
    changed_pixels : (V,) ndarray of int64
        Pixels whose intensity differs between the pictures with and without culling: flat shaded, lit from the eye,
        the background black.
    histogram : (51,) ndarray of int64
        Number of changed pixels, over all views, by difference of intensity; `bins` (52,) are the edges.
    culled : (V,) ndarray of float64
        Share of the scene's faces that are not in the answer.
    backfacing, occluded : (V,) ndarray of float64
        Parts of `culled`: faces turned away from the eye, and the rest. Which side is the front is taken from what is
        seen most.
    false : (V,) ndarray of float64
        Share of the answer that `Scene.visible` does not confirm for this very eye; NaN where that was not asked.
    answer_seconds, whole_seconds, culled_seconds : (V,) ndarray of float64
        Time to find the answer, to draw the whole id-buffer, to draw that of the answer.
    nbytes : int
        Bytes of the bake in memory.
    confidence : float
        Of `interval` and `bound`.
    """

    eyes: Floats
    distances: Floats
    missed: Floats
    missed_pixels: npt.NDArray[np.int64]
    covered_pixels: npt.NDArray[np.int64]
    changed_pixels: npt.NDArray[np.int64]
    histogram: npt.NDArray[np.int64]
    culled: Floats
    backfacing: Floats
    occluded: Floats
    false: Floats
    answer_seconds: Floats
    whole_seconds: Floats
    culled_seconds: Floats
    nbytes: int
    confidence: float = 0.95
    bins: Floats = field(default_factory=lambda: BINS)

    @property
    def mean_missed(self) -> float:
        """Mean of `missed`."""
        return float(self.missed.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Central interval of the mean of `missed` by bootstrap-t: approximate; see `cyclorama.bakes.confidence`."""
        return bootstrap_interval(self.missed, self.confidence)

    @property
    def bound(self) -> float:
        """Upper bound of the mean of `missed` that holds for every distribution, and is never below about 3 / V."""
        return upper_mean(self.missed, self.confidence)

    @property
    def worst(self) -> int:
        """Index of the view that misses most."""
        return int(self.missed.argmax())

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers by name, means over the views."""
        low, high = self.interval
        return {
            "views": len(self.missed),
            "missed": self.mean_missed,
            "missed_low": low,
            "missed_high": high,
            "missed_bound": self.bound,
            "missed_p99": float(np.quantile(self.missed, 0.99)),
            "missed_max": float(self.missed.max()),
            "perfect_views": float((self.missed_pixels == 0).mean()),
            "changed_pixels": float(self.changed_pixels.mean()),
            "culled": float(self.culled.mean()),
            "backfacing": float(self.backfacing.mean()),
            "occluded": float(self.occluded.mean()),
            "false": float(self.false.mean()),
            "answer_ms": 1e3 * float(np.median(self.answer_seconds)),
            "whole_ms": 1e3 * float(np.median(self.whole_seconds)),
            "culled_ms": 1e3 * float(np.median(self.culled_seconds)),
            "bytes": self.nbytes,
        }

    def summary(self) -> str:
        """The figures as a few lines of text."""
        d = self.to_dict()
        percent = f"{100 * self.confidence:g} %"
        return "\n".join(
            [
                f"{d['views']} held-out views at {_spread(self.distances)} sampling radii",
                f"missed   {d['missed']:.2e} of the covered pixels on average, {percent} interval "
                f"{d['missed_low']:.1e} to {d['missed_high']:.1e} (bootstrap-t),",
                f"         at most {d['missed_bound']:.1e} whatever the distribution; "
                f"{d['missed_p99']:.1e} at the 99th percentile, {d['missed_max']:.1e} at worst",
                f"         (view {self.worst}); {d['perfect_views']:.0%} of the views miss nothing",
                f"culled   {d['culled']:.1%} of the faces: {d['backfacing']:.1%} face away, {d['occluded']:.1%} are "
                f"hidden; {_share(d['false'])} of the answer is not seen from that very eye",
                f"time     {d['answer_ms']:.2f} ms to answer, {d['whole_ms']:.2f} ms to draw the whole, "
                f"{d['culled_ms']:.2f} ms to draw the answer",
                f"memory   {d['bytes']:,} bytes",
            ]
        )

    def plot(self, path: str | None = None) -> Any:
        """Missed shares of the views, sorted, and the histogram of intensity differences (2001, figure 7).

        Parameters
        ----------
        path : str, optional
            Where to write the figure.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10, 4), layout="constrained")
        left, right = figure.subplots(1, 2)
        ranked = np.sort(self.missed)[::-1]
        left.semilogy(np.arange(1, len(ranked) + 1), np.where(ranked > 0, ranked, np.nan), ".-")
        left.axhline(max(self.mean_missed, 1e-9), color="black", linestyle="--", label=f"mean {self.mean_missed:.1e}")
        left.set(xlabel="view, worst first", ylabel="share of covered pixels missed")
        left.legend()
        widths = np.diff(self.bins)
        right.bar(self.bins[:-1], self.histogram, width=widths, align="edge", log=bool(self.histogram.any()))
        right.set(xlabel="difference of intensity", ylabel="pixels")
        if path is not None:
            figure.savefig(path, dpi=150)
        return figure

    def __repr__(self) -> str:
        return (
            f"<Evaluation: {len(self.missed)} views, missed {self.mean_missed:.1e} (interval {self.interval[0]:.1e} to "
            f"{self.interval[1]:.1e}), culled {self.culled.mean():.1%}>"
        )

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.summary())}</pre>"


def evaluate(
    vis: Visibility,
    scene: Scene,
    views: int = 100,
    seed: int = 0,
    distance: float | Sequence[float] = 1.0,
    *,
    resolution: tuple[int, int] | None = None,
    confidence: float = 0.95,
    confirm: bool = True,
    threads: int | None = None,
    progress: Progress = None,
) -> Evaluation:
    """Draws random views with and without culling, and compares them.

    Parameters
    ----------
    vis : Visibility
        The bake.
    scene : Scene
        What it was baked from.
    views : int
        Number of views, V, for all distances together, taken in turn.
    seed : int
        Of their directions, which are uniform.
    distance : float or sequence of float
        Of the eyes from the centre, in sampling radii. The field of view always just holds the scene's bounding
        sphere; inside it eyes look at the centre with the bake's.
    resolution : (int, int), optional
        Of the views; by default the bake's. The 2001 paper's is (255, 255).
    confidence : float
        Of the interval and the bound, in (0, 1).
    confirm : bool
        Whether to ask `Scene.visible` which faces of each answer are seen from its eye: gives `false`, and takes most
        of the time.
    threads : int, optional
        All cores by default.
    progress : bool, callable or None
        See `cyclorama.progress`; units are views.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError
        If the bake is of another scene, or an argument is out of its range.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(faces=320)
    >>> vis = cyc.bake(scene, views=18, resolution=(64, 64), progress=False)
    >>> evaluate(vis, scene, views=10, progress=False).mean_missed < 0.01
    True
    """
    vis.check(scene)
    if isinstance(views, bool) or not isinstance(views, int | np.integer) or views < 1:
        raise ValueError(f"views must be a count of at least 1, got {views!r}")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must lie in (0, 1), got {confidence}")
    framing = vis.framing if resolution is None else vis.framing.with_resolution(resolution)
    far = np.resize(np.atleast_1d(np.asarray(distance, dtype=np.float64)), views)
    if not ((far > 0) & np.isfinite(far)).all():
        raise ValueError(f"distance must be positive and finite, got {distance!r}")
    directions = random_directions(views, seed)
    eyes = scene.center + far[:, None] * vis.sphere.radius * directions
    columns = {name: np.zeros(views) for name in _FLOATS}
    counts = np.zeros((3, views), dtype=np.int64)
    histogram = np.zeros(len(BINS) - 1, dtype=np.int64)
    normals, points = _planes(scene)
    albedo = _albedo(scene)
    facing = np.zeros((views, 2))
    away = []
    with reporter(progress, views, "held-out views") as report:
        for k in range(views):
            camera = _camera(framing, eyes[k], directions[k], float(far[k]))
            draw = partial(scene.render, camera, threads=threads)
            answer, columns["answer_seconds"][k] = elapsed(partial(vis.visible_faces, eyes[k]))
            whole, columns["whole_seconds"][k] = elapsed(draw)
            part, columns["culled_seconds"][k] = elapsed(partial(draw, faces=answer))
            kept = np.zeros(len(scene), dtype=bool)
            kept[answer] = True
            covered = whole.ids[whole.ids != BACKGROUND]
            counts[0, k], counts[1, k] = len(covered), np.count_nonzero(~kept[covered])
            toward = eyes[k] - points
            cosine = np.einsum("ij,ij->i", normals, toward / np.linalg.norm(toward, axis=1, keepdims=True))
            front = cosine > 0
            changed = part.ids != whole.ids
            if changed.any():
                shade = np.append(albedo * np.abs(cosine), 0.0)  # the last is the background's
                before, after = (np.minimum(view.ids[changed], len(scene)) for view in (whole, part))
                difference = np.abs(shade[before] - shade[after])
                counts[2, k] = np.count_nonzero(difference)
                histogram += np.histogram(difference[difference > 0], BINS)[0]
            facing[k] = np.count_nonzero(front[covered]), len(covered)
            away.append((np.count_nonzero(~kept & ~front), np.count_nonzero(~kept & front)))
            columns["false"][k] = _false_share(scene, camera, kept, threads) if confirm else math.nan
            report(k + 1)
    outward = facing[:, 0].sum() * 2 >= facing[:, 1].sum()
    parts = np.array(away, dtype=np.float64) / len(scene)
    return Evaluation(
        eyes=eyes,
        distances=far,
        missed=counts[1] / np.maximum(counts[0], 1),
        missed_pixels=counts[1],
        covered_pixels=counts[0],
        changed_pixels=counts[2],
        histogram=histogram,
        culled=parts.sum(axis=1),
        backfacing=parts[:, 0 if outward else 1],
        occluded=parts[:, 1 if outward else 0],
        nbytes=vis.nbytes,
        confidence=confidence,
        **columns,
    )


_FLOATS = ("false", "answer_seconds", "whole_seconds", "culled_seconds")


def random_directions(count: int, seed: int | Sequence[int]) -> Floats:
    """(count, 3) unit vectors, uniform over all directions.

    Examples
    --------
    >>> np.allclose(np.linalg.norm(random_directions(5, 0), axis=1), 1)
    True
    """
    rng = np.random.default_rng(seed)
    z = rng.uniform(-1, 1, count)
    angle = rng.uniform(0, 2 * math.pi, count)
    ring = np.sqrt(1 - z * z)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])


def _camera(framing: Framing, eye: Floats, direction: Floats, distance: float) -> Camera:
    if distance * framing.sampling_radius > framing.radius:
        return framing.cameras(direction[None], distance)[0]
    return Camera.look_at(eye, framing.center, (0, 1, 0), framing.fov_y, *framing.resolution)


def _planes(scene: Scene) -> tuple[Floats, Floats]:
    """Unit normal (zero for a face without area) and a point of each face."""
    a, b, c = np.moveaxis(scene.vertices.astype(np.float64)[scene.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0, length, 1), (a + b + c) / 3


def _albedo(scene: Scene) -> Floats:
    """(F,) brightness of each face in [0, 1]; 1 without colours."""
    if scene.colors is None:
        return np.ones(len(scene))
    brightness = scene.colors.mean(axis=1) / 255
    return np.asarray(brightness[scene.faces].mean(axis=1) if len(brightness) == len(scene.vertices) else brightness)


def _false_share(scene: Scene, camera: Camera, kept: npt.NDArray[np.bool_], threads: int | None) -> float:
    seen = bitfield.unpack(scene.visible(camera, threads=threads, progress=False).words, len(scene))[0]
    return int(np.count_nonzero(kept & ~seen)) / max(int(np.count_nonzero(kept)), 1)


def _spread(values: Floats) -> str:
    return ", ".join(f"{value:g}" for value in np.unique(values))


def _share(value: float) -> str:
    return "an unasked share" if math.isnan(value) else f"{value:.1%}"
