"""Known sources as renderers are asked about them: closed forms of irradiance and radiance, and the places that are looked at."""

import math

import numpy as np

CELLS, PIXELS = 8, 16  # along either side of an irradiance picture, of a picture of the source
FINE = 2  # lines or points along either side of a cell, whose mean is its value


class Chips:
    """Lambertian squares of 1 mm in z = 0; (x, y, W)."""

    def __init__(self, chips, heights, width):
        self.chips, self.heights, self.width = chips, heights, width
        self.model_error = self.picture_error = self.dark_error = 0.02  # of 200 000 rays

    def irradiance(self, x, y, z):
        """W/mm2 on a plane that looks down, by the configuration factor of a rectangle over a corner (Howell, B-3), four times a chip."""

        def corner(a, b):
            a, b = a / z, b / z
            p, q = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
            return (a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi)

        total = 0.0
        for cx, cy, watt in self.chips:
            left, right, low, high = cx - 0.5 - x, cx + 0.5 - x, cy - 0.5 - y, cy + 0.5 - y
            total = total + watt * (corner(right, high) - corner(left, high) - corner(right, low) + corner(left, low))
        return total

    def radiance(self, points, direction):
        """W/(mm2 sr) along lines; NaN near edges, where the model is as wide as its cells."""
        at = points - direction * (points[..., 2:] / direction[2])
        total = np.zeros(points.shape[:-1])
        for cx, cy, watt in self.chips:
            off = np.maximum(abs(at[..., 0] - cx), abs(at[..., 1] - cy))
            total = np.where(off < 0.5, watt / np.pi, total)
            total = np.where(abs(off - 0.5) < 0.1, np.nan, total)
        return total


class Dome:
    """Even radiance in a cone of 30 degrees round the normals of the upper half of a sphere of 1.5 mm: a ball of 0.75 mm, as its lines show."""

    heights, width = (3.0, 7.5), 4.0
    model_error, picture_error, dark_error = 0.06, 0.09, 0.1  # of 200 000 rays on the lens: a cone in 256 zones of steps of 4.5 degrees
    ball = 0.75
    bright = 1 / (2 * np.pi * 1.5**2 * np.pi * 0.25)

    def irradiance(self, x, y, z):
        distance2 = x * x + y * y + z * z
        return np.pi * self.bright * self.ball**2 / distance2 * z / np.sqrt(distance2)

    def radiance(self, points, direction):
        off = np.linalg.norm(np.cross(points, direction), axis=-1) / self.ball
        return np.where(off < 0.8, self.bright, np.where(off > 1.3, 0.0, np.nan))


SOURCES = {
    "flat-chip": Chips([(0, 0, 1.0)], (0.5, 2.0), 2.0),
    "four-chips": Chips([(-0.6, -0.6, 0.9), (0.6, -0.6, 0.3), (-0.6, 0.6, 0.5), (0.6, 0.6, 0.7)], (0.5, 2.0), 4.0),
    "dome": Dome(),
}
# From where the pictures are taken.
EYE = 20 * np.array([0.5, 0.3, math.sqrt(1 - 0.34)])


def coarse(fine):
    count = len(fine) // FINE
    return fine.reshape(count, FINE, count, FINE).mean(axis=(1, 3))


def plane_points(z, width, count):
    """Middles of cells as a person below sees them: +Y is up, +X is left."""
    along = width * (0.5 - (np.arange(count) + 0.5) / count)
    y, x = np.meshgrid(along, along, indexing="ij")
    return x, y, np.full_like(x, z)


def camera_points(width, count):
    """A point of the line through the middle of each cell of a picture from EYE with +Z up, and the direction of its light."""
    toward = EYE / np.linalg.norm(EYE)
    right = np.cross([0, 0, 1], toward)
    right /= np.linalg.norm(right)
    up = np.cross(toward, right)
    along = width * ((np.arange(count) + 0.5) / count - 0.5)
    down, across = np.meshgrid(-along, along, indexing="ij")
    return across[..., None] * right + down[..., None] * up, toward
