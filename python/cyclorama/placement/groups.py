"""Eyes that use an image, in groups that one layered image can serve.

An image of a plan serves eyes far from each other that look different ways; a layered image whose pixels are as fine as
the display's for all of them would be huge, and one of any size that is half way to all of them is coarse for each. So
the frames that use an image are divided, again and again in two, and each group has a layered image taken amid its
eyes. What stands for what does not change, and so neither does what was proved.

A group is a node of a binary tree: 1 is all frames of an image, those of node n are divided between 2 n and 2 n + 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .painting import Placement, Uses, more_uses

__all__ = ["Group", "Groups", "filled", "place"]

Floats = npt.NDArray[np.float64]

# Rounds in which frames find the half nearest to them: later ones move the middles by less than a tenth of their
# distance (measured on a thousand eyes and 16 middles).
_ROUNDS = 10

# Nodes of one image are numbered below this: 20 divisions in a row are more than a pixel needs.
_NODES = 1 << 20


# Frames that are known to use an image before they are grouped.
_KNOWN = 256


@dataclass(frozen=True, eq=False)
class Group:
    """Frames that one layered image serves.

    Attributes
    ----------
    image, node : int
        Of the plan, and of the image's tree.
    eyes, gazes : (K, 3) ndarray of float64
    scale : float
        What is seen of the image is about as far from the eyes: so far apart two eyes are as different as two gazes a
        radian apart.
    """

    image: int
    node: int
    eyes: Floats
    gazes: Floats
    scale: float

    @property
    def places(self) -> Floats:
        """(K, 6) frames as points: their distances are angles, small ones."""
        return place(self.eyes, self.gazes, self.scale)

    @property
    def middle(self) -> Floats:
        """(6,) the mean place."""
        return np.asarray(self.places.mean(axis=0))

    @property
    def spread(self) -> float:
        """The greatest distance from the middle, in radians."""
        return float(np.linalg.norm(self.places - self.middle, axis=1).max()) if len(self.eyes) else 0.0

    def central(self) -> int:
        """The frame nearest to the middle."""
        return int(np.linalg.norm(self.places - self.middle, axis=1).argmin())

    def some(self, count: int) -> npt.NDArray[np.int64]:
        """Frames far from each other, the central one first."""
        places, chosen = self.places, [self.central()]
        away = np.linalg.norm(places - places[chosen[0]], axis=1)
        while len(chosen) < min(count, len(places)):
            chosen.append(int(away.argmax()))
            away = np.minimum(away, np.linalg.norm(places - places[chosen[-1]], axis=1))
        return np.array(chosen)


def filled(group: Group, plan: Placement, region: Floats, count: int) -> Group:
    """A group with more frames, found among those it has, until it has so many or no more are found."""
    if not 0 < len(group.eyes) < count:
        return group
    more = more_uses(plan, group.image, group.eyes, group.gazes, region, count - len(group.eyes))
    eyes, gazes = np.concatenate([group.eyes, more.eyes]), np.concatenate([group.gazes, more.gazes])
    return replace(group, eyes=eyes, gazes=gazes)


def place(eyes: npt.ArrayLike, gazes: npt.ArrayLike, scale: float) -> Floats:
    """Frames as points, (..., 6); see `Group.places`."""
    ahead = np.asarray(gazes, np.float64)
    unit = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    return np.concatenate([np.asarray(eyes, np.float64) / scale, unit], axis=-1)


class Groups:
    """The trees of all images of a plan.

    Parameters
    ----------
    plan : Plan
    found : Uses
        Frames that use images; of images that are used at all more are looked for.
    region : (2, 3) ndarray of float64
        Where eyes are.
    """

    def __init__(self, plan: Placement, found: Uses, region: Floats) -> None:
        self._plan, self._found, self._region = plan, found, region
        self._groups: dict[tuple[int, int], Group] = {}

    def group(self, image: int, node: int = 1) -> Group:
        """The frames of a node; there may be none."""
        key = image, node
        if key not in self._groups:
            if node == 1:
                self._groups[key] = self._all(image)
            else:
                parent = self.group(image, node // 2)
                half = _halves(parent.places) == node % 2
                self._groups[key] = Group(image, node, parent.eyes[half], parent.gazes[half], parent.scale)
        return self._groups[key]

    def can_divide(self, group: Group) -> bool:
        """Whether both halves of a group have two frames at least: one to paint by, one to judge by."""
        if len(group.eyes) < 4 or group.node >= _NODES // 2:
            return False
        return min(len(self.group(group.image, 2 * group.node + half).eyes) for half in (0, 1)) >= 2

    def _all(self, image: int) -> Group:
        own, found = self._found.of(image), self._found
        eyes = found.eyes[own]
        group = Group(image, 1, eyes, found.gazes[own], self._scale(image, eyes))
        return filled(group, self._plan, self._region, _KNOWN)

    def _scale(self, image: int, eyes: Floats) -> float:
        corners, forward = self._plan.images.corners[image], self._plan.images.forward[image]
        viewpoint = self._plan.viewpoints[self._plan.images.viewpoint[image]]
        if not len(eyes):
            return float(np.linalg.norm(corners.mean(axis=0) - viewpoint))
        # Of eyes close to the plane as of others: what they see of the image is beyond it.
        edge = float((self._plan.domain[1] - self._plan.domain[0]).max())
        return float(max(np.median((corners[0] - eyes) @ forward), _NEAREST * edge))


# Share of the domain's longest edge: what is nearer than that is not what an image is for.
_NEAREST = 0.05


def _halves(places: Floats) -> npt.NDArray[np.int64]:
    """0 or 1 for each point: Lloyd's rounds from the point farthest from the mean and the one farthest from that."""
    first = int(np.linalg.norm(places - places.mean(axis=0), axis=1).argmax())
    second = int(np.linalg.norm(places - places[first], axis=1).argmax())
    middles = places[[first, second]]
    half = np.zeros(len(places), np.int64)
    for _ in range(_ROUNDS):
        half = np.linalg.norm(places[:, None] - middles, axis=2).argmin(axis=1)
        for side in (0, 1):
            if (half == side).any():
                middles[side] = places[half == side].mean(axis=0)
    return half
