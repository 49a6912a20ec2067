"""Process noise in the frame of a step, packed: rows and columns X, Y, H, K, B."""

from ..._compile import Matrix, Vector, kernel
from ..state import D, H, X, Y


@kernel
def pack_noise(cov: Matrix, packed: Vector) -> None:
    """Upper triangle of the rows and columns X, Y, H, K, B of a covariance, row by row, (15,)."""
    at = 0
    for a in range(D):
        for b in range(a, D):
            packed[at] = cov[a, b]
            at += 1


@kernel
def unpack_noise(packed: Vector, c: float, s: float, cov: Matrix) -> None:
    """Turn a packed Q by a heading (cosine, sine) into the plane: into the upper triangle.

    Q' = R Q Rᵀ,   R of X and Y alone
    """
    at = 0
    for a in range(D):
        for b in range(a, D):
            cov[a, b] = packed[at]
            at += 1
    xx, xy, yy = cov[X, X], cov[X, Y], cov[Y, Y]
    cov[X, X] = c * c * xx - 2.0 * c * s * xy + s * s * yy
    cov[Y, Y] = s * s * xx + 2.0 * c * s * xy + c * c * yy
    cov[X, Y] = c * s * (xx - yy) + (c * c - s * s) * xy
    for b in range(H, D):
        px, py = cov[X, b], cov[Y, b]
        cov[X, b] = c * px - s * py
        cov[Y, b] = s * px + c * py
