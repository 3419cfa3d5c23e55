"""Cameras from and to the files of other programs: COLMAP, nerfstudio's ``transforms.json``, glTF.

All three put the centre of the first pixel at (0.5, 0.5), as we do. Lenses that bend lines are refused, never ignored:
undistort the images first. The world's axes stay as they are in the file.
"""

from .colmap import read_colmap, write_colmap
from .gltf import read_gltf, write_gltf
from .nerfstudio import read_transforms, write_transforms

__all__ = ["read_colmap", "read_gltf", "read_transforms", "write_colmap", "write_gltf", "write_transforms"]
