"""The height of a surface from its normals: the least-squares solution of Poisson's equation.

Of all heights that whose slopes come nearest to those given, in the mean square (Horn & Brooks 1986; by the Fourier
transform Frankot & Chellappa 1988, "A method for enforcing integrability in shape from shading algorithms", equation
21). Frames that do not repeat are continued by their mirror images, which leaves the edges free.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# A normal tells no slope beyond this: the texel would be a wall.
_STEEPEST = np.tan(np.radians(80.0))


def slopes(normals: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """dz/dx and dz/dy (H, W) of normals (H, W, 3), x right and y up."""
    z = np.maximum(normals[..., 2].astype(np.float64), 1e-6)
    p, q = -normals[..., 0] / z, -normals[..., 1] / z
    # Along the slope itself, which keeps its direction.
    steep = np.maximum(np.hypot(p, q) / _STEEPEST, 1.0)
    return p / steep, q / steep


def height_of(normals: NDArray[np.floating], *, repeats: bool = False) -> NDArray[np.float32]:
    """Height (H, W) in texels above its mean, of a texel as wide as it is high.

    Parameters
    ----------
    normals : (H, W, 3), row 0 on top, x right, y up
    repeats : the frame continues at the opposite edge; a mean slope, which could not, is left out
    """
    p, q = slopes(normals)
    # Rows run downwards.
    q = -q
    rows, columns = p.shape
    if repeats:
        p, q = p - p.mean(), q - q.mean()
    else:
        p = np.block([[p, -p[:, ::-1]], [p[::-1], -p[::-1, ::-1]]])
        q = np.block([[q, q[:, ::-1]], [-q[::-1], -q[::-1, ::-1]]])
    u = 2 * np.pi * np.fft.fftfreq(p.shape[1])[None, :]
    v = 2 * np.pi * np.fft.fftfreq(p.shape[0])[:, None]
    squared = u**2 + v**2
    squared[0, 0] = 1.0
    spectrum = (-1j * u * np.fft.fft2(p) - 1j * v * np.fft.fft2(q)) / squared
    spectrum[0, 0] = 0.0
    height = np.fft.ifft2(spectrum).real[:rows, :columns]
    return (height - height.mean()).astype(np.float32)


def unfollowed(normals: NDArray[np.floating], height: NDArray[np.floating]) -> float:
    """RMS of the slopes that no height follows, as a share of their own RMS: errors of the normals, or walls."""
    p, q = slopes(normals)
    # Central differences, of texels that have neighbours; rows run downwards.
    dx = (height[1:-1, 2:] - height[1:-1, :-2]) / 2
    dy = (height[:-2, 1:-1] - height[2:, 1:-1]) / 2
    p, q = p[1:-1, 1:-1], q[1:-1, 1:-1]
    size = float(np.sqrt((p**2 + q**2).mean()))
    return float(np.sqrt(((dx - p) ** 2 + (dy - q) ** 2).mean())) / max(size, 1e-12)
