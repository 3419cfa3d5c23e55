"""The compiled kernels. Users call the modules beside this one."""

import numpy as np
import numpy.typing as npt

class Mesh:
    def __new__(cls, vertices: npt.NDArray[np.float64], faces: npt.NDArray[np.uint32]) -> Mesh: ...
    @property
    def degenerate_faces(self) -> list[int]: ...
