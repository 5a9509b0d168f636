"""A Lampwright source model as an emitter of Mitsuba 3.

    import mitsuba as mi
    mi.set_variant("llvm_ad_rgb")
    import lampwright_emitter
    scene = mi.load_dict({"type": "scene", "lamp": lampwright_emitter.lamp(), ...})

Point x of the surface sends the radiance L = M(x) q(x, d) / |cos| in direction d, to both sides, and blocks nothing: its BSDF is "null".
M and q are interpolated linearly between the corners of a triangle; q of a corner is a mixture of up to four tables over angles.
Radiance comes in the unit that README.txt names, cd/m2 or W/(m2 sr); lengths are mm unless to_world scales them.

Points are drawn by how much of their light goes to where it is asked for, so that few samples do. The texture coordinates of surface.ply
are no texture: they say which triangle a point is in, and where, because Mitsuba tells an emitter nothing else when it asks for a density.
"""

from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

HERE = Path(__file__).resolve().parent
# Texture coordinates: triangle t has the unit square at (t modulo side, t / side), its corners at 0.1 and 0.9.
MARGIN, SPAN = 0.1, 0.8
# Cells along either side of the octahedral map of directions by which zones are weighed against each other, and samples along a cell.
CELLS, SAMPLES = 32, 4
# Least weight of a zone, as a part of what even light would send.
LEAST = 0.05
GRAZING = 1e-4


def lamp(to_world=None, folder=HERE):
    """The source for mi.load_dict: surface, emitter, and a BSDF that lets light pass. Put it into a scene in mm, or scale it by to_world."""
    to_world = to_world if to_world is not None else mi.ScalarTransform4f()
    return {
        "type": "ply",
        "filename": str(Path(folder) / "surface.ply"),
        "face_normals": True,
        "to_world": to_world,
        "bsdf": {"type": "null"},
        "emitter": {"type": "lampwright", "folder": str(folder), "to_world": to_world},
    }


class Table:
    """Numbers that are looked up by index, in every variant of Mitsuba."""

    def __init__(self, numbers, of=None):
        self.of = of or mi.Float
        self.width = numbers.shape[1] if numbers.ndim > 1 else 1
        flat = np.ascontiguousarray(numbers).ravel()
        self.values = self.of(flat) if dr.is_jit_v(mi.Float) else flat

    def at(self, index, column=0, active=True):
        index = index * self.width + column
        if dr.is_jit_v(mi.Float):
            return dr.gather(self.of, self.values, index, active)
        return self.values[int(index)].item() if active else self.of(0)

    def search(self, value, first, last):
        """The first place from `first` to `last` (that included) whose number is above `value`; `last` where none is."""
        if not dr.is_jit_v(mi.Float):
            return int(min(first + np.searchsorted(self.values[int(first) : int(last)], value, "right"), last))
        for _ in range(int(dr.width(self.values)).bit_length()):
            middle = (first + last) // 2
            is_above = self.at(middle) > value
            first, last = dr.select(is_above, first, dr.minimum(middle + 1, last)), dr.select(is_above, middle, last)
        return first


class Lampwright(mi.Emitter):
    def __init__(self, props):
        mi.Emitter.__init__(self, props)
        if mi.is_spectral or mi.is_polarized:
            raise RuntimeError("lampwright: choose a variant in RGB or mono, such as llvm_ad_rgb: the tables are RGB or one number")
        self.m_flags = int(mi.EmitterFlags.Surface) | int(mi.EmitterFlags.SpatiallyVarying)
        self.m_needs_sample_2 = self.m_needs_sample_3 = True
        folder = Path(props["folder"]) if props.has_property("folder") else HERE
        to_world = props["to_world"] if props.has_property("to_world") else mi.ScalarTransform4f()
        with np.load(folder / "lampwright_model.npz") as stored:
            self.load(stored, np.array(to_world.matrix, np.float64).reshape(4, 4))

    def load(self, stored, matrix):
        positions = stored["positions_mm"].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        triangles = stored["triangles"].astype(np.int64)
        corners = positions[triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(cross, axis=1) / 2
        exitance, zones, weights = stored["exitance"], stored["zones"].astype(np.int64), stored["weights"]
        brightness = exitance.astype(np.float64) @ stored["luminance"]
        self.side = int(np.ceil(np.sqrt(len(triangles))))
        self.kinds = int((weights > 0).sum(axis=1).max())
        self.corner = Table(triangles, mi.UInt32)
        self.position = Table(positions.astype(np.float32))
        self.exitance = Table(exitance)
        self.zone = Table(zones, mi.UInt32)
        self.weight = Table(weights)
        self.box = [positions.min(axis=0), positions.max(axis=0)]
        # The photometric frame turns with the surface.
        axes = stored["axes"] @ matrix[:3, :3].T
        self.axes = [mi.Vector3f(axis.tolist()) for axis in axes / np.linalg.norm(axes, axis=1, keepdims=True)]
        self.load_angles(stored["distributions"], stored["gamma"])
        self.zones = len(stored["distributions"])
        self.load_parts(corners, triangles, area, brightness, zones, weights)
        self.load_directions(stored["distributions"], stored["gamma"])

    def load_angles(self, distributions, gamma):
        self.planes, self.nodes = distributions.shape[1:]
        self.gamma = Table(gamma)
        self.distribution = Table(distributions.astype(np.float32).reshape(-1))

    def load_parts(self, corners, triangles, area, brightness, zones, weights):
        """A part is a corner of a triangle in one of its zones. Within it points lie with the density 3 p / area, p the corner's share."""
        mean = (brightness[triangles].sum(axis=1, keepdims=True) + brightness[triangles]) / 4
        zone = zones[triangles]
        flux = (area[:, None, None] / 3) * mean[:, :, None] * weights[triangles]
        count = self.zones
        order = np.argsort(zone.ravel(), kind="stable")
        order = order[flux.ravel()[order] > 0]
        sorted_zone, sorted_flux = zone.ravel()[order], flux.ravel()[order]
        self.zone_flux = np.bincount(sorted_zone, sorted_flux, count)
        self.brightest = int(np.argmax(self.zone_flux))
        ends = np.searchsorted(sorted_zone, np.arange(count), "right")
        sums = np.cumsum(sorted_flux)
        begins = np.concatenate(([0], ends[:-1]))
        before = np.concatenate(([0.0], sums))[begins]
        within = (sums - before[sorted_zone]) / self.zone_flux[sorted_zone]
        self.part_share = Table(within.astype(np.float32))
        self.part = Table((order // weights.shape[1]).astype(np.uint32), mi.UInt32)
        self.part_begin, self.part_end = Table(begins.astype(np.uint32), mi.UInt32), Table(ends.astype(np.uint32), mi.UInt32)
        self.mean = Table(mean.astype(np.float32))
        self.zone_scale = Table(np.divide(1, self.zone_flux, where=self.zone_flux > 0, out=np.zeros(count)).astype(np.float32))
        # The middle of the flux of each zone, and how far it reaches.
        triangle = order // (3 * weights.shape[1])
        centres = corners[triangle].mean(axis=1)
        scale = np.maximum(self.zone_flux, 1e-300)[:, None]
        middles = np.stack([np.bincount(sorted_zone, sorted_flux * centres[:, k], count) for k in range(3)], axis=1) / scale
        squares = ((centres - middles[sorted_zone]) ** 2).sum(axis=1)
        self.middle = Table(middles.astype(np.float32))
        self.reach2 = Table((np.bincount(sorted_zone, sorted_flux * squares, count) / scale[:, 0]).astype(np.float32))

    def load_directions(self, distributions, gamma):
        """Flux of each zone times what it sends into each cell of an octahedral map, per sr."""
        along = (np.arange(CELLS * SAMPLES) + 0.5) / (CELLS * SAMPLES) * 2 - 1
        u, v = np.meshgrid(along, along)
        z = 1 - np.abs(u) - np.abs(v)
        fold = np.maximum(-z, 0)
        x, y = u - np.sign(u) * fold, v - np.sign(v) * fold
        at_gamma = np.interp(np.arctan2(np.hypot(x, y), -z), gamma, np.arange(self.nodes))
        at_plane = np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi) * self.planes
        k, j = np.minimum(at_gamma.astype(int), self.nodes - 2), at_plane.astype(int) % self.planes
        t, s, n = at_gamma - k, at_plane - np.floor(at_plane), (j + 1) % self.planes
        cells = np.empty((self.zones, CELLS, CELLS))
        for zone, q in enumerate(distributions.astype(np.float64)):
            fine = (1 - s) * ((1 - t) * q[j, k] + t * q[j, k + 1]) + s * ((1 - t) * q[n, k] + t * q[n, k + 1])
            even = LEAST / (4 * np.pi)
            cells[zone] = self.zone_flux[zone] * (even + fine.reshape(CELLS, SAMPLES, CELLS, SAMPLES).mean(axis=(1, 3)))
        self.toward = Table(cells.astype(np.float32).ravel())

    # Where a point is.

    def place(self, uv):
        """Triangle and shares of its corners, from texture coordinates."""
        column, row = dr.floor(uv.x), dr.floor(uv.y)
        triangle = mi.UInt32(column) + mi.UInt32(row) * self.side
        b, c = (uv.x - column - MARGIN) / SPAN, (uv.y - row - MARGIN) / SPAN
        return triangle, [1 - b - c, b, c]

    def point(self, triangle, shares, active):
        """Position, normal and texture coordinates."""
        corners = []
        for k in range(3):
            vertex = self.corner.at(triangle, k, active)
            corners.append(mi.Point3f(*[self.position.at(vertex, axis, active) for axis in range(3)]))
        a, b, c = corners
        row = triangle // self.side
        uv = mi.Point2f(mi.Float(triangle - row * self.side) + MARGIN + SPAN * shares[1], mi.Float(row) + MARGIN + SPAN * shares[2])
        return a * shares[0] + b * shares[1] + c * shares[2], mi.Normal3f(dr.normalize(dr.cross(b - a, c - a))), uv

    # How much leaves it, and where to.

    def angles(self, d):
        """C and gamma of a direction, radians."""
        x, y, z = (dr.dot(d, axis) for axis in self.axes)
        gamma = dr.atan2(dr.sqrt(x * x + y * y), -z)
        c = dr.atan2(y, x)
        return dr.select(c < 0, c + dr.two_pi, c), gamma

    def surroundings(self, d, active):
        """The four nodes round a direction and their shares."""
        c, gamma = self.angles(d)
        at = c * (self.planes / dr.two_pi)
        plane = dr.minimum(mi.UInt32(at), self.planes - 1)
        s = at - mi.Float(plane)
        following = dr.select(plane + 1 == self.planes, 0, plane + 1)
        above = self.gamma.search(gamma, mi.UInt32(1), mi.UInt32(self.nodes - 1))
        low = self.gamma.at(above - 1, 0, active)
        t = dr.clip((gamma - low) / (self.gamma.at(above, 0, active) - low), 0, 1)
        here, there = plane * self.nodes + above, following * self.nodes + above
        return [(here - 1, (1 - s) * (1 - t)), (here, (1 - s) * t), (there - 1, s * (1 - t)), (there, s * t)]

    def light(self, uv, d, cosine, active):
        """Radiance of a point in a direction."""
        triangle, shares = self.place(uv)
        nodes = self.surroundings(d, active)
        size = self.planes * self.nodes
        q, colour = mi.Float(0), [mi.Float(0)] * 3
        for k in range(3):
            vertex = self.corner.at(triangle, k, active)
            colour = [sum_ + shares[k] * self.exitance.at(vertex, axis, active) for axis, sum_ in enumerate(colour)]
            for kind in range(self.kinds):
                first = self.zone.at(vertex, kind, active) * size
                weight = shares[k] * self.weight.at(vertex, kind, active)
                q += weight * sum(share * self.distribution.at(first + node, 0, active) for node, share in nodes)
        factor = dr.select(active & (dr.abs(cosine) > GRAZING), dr.maximum(q, 0) / dr.abs(cosine), 0)
        if mi.is_monochromatic:
            r, g, b = colour
            return mi.Spectrum((0.212639 * r + 0.715169 * g + 0.072192 * b) * factor)
        return mi.Color3f(*colour) * factor

    # Which points are drawn.

    def zone_weight(self, zone, p, active=True):
        """How much light of a zone goes to `p`, about."""
        away = p - mi.Point3f(*[self.middle.at(zone, axis, active) for axis in range(3)])
        reach2 = self.reach2.at(zone, 0, active)
        distance2 = dr.maximum(dr.squared_norm(away), 1e-20)
        x, y, z = (dr.dot(away, axis) for axis in self.axes)
        sum_ = dr.maximum(dr.abs(x) + dr.abs(y) + dr.abs(z), 1e-20)
        x, y, fold = x / sum_, y / sum_, dr.maximum(-z / sum_, 0)
        u, v = x + dr.copysign(fold, x), y + dr.copysign(fold, y)
        column = dr.clip(mi.Int32((u + 1) * (CELLS / 2)), 0, CELLS - 1)
        row = dr.clip(mi.Int32((v + 1) * (CELLS / 2)), 0, CELLS - 1)
        cell = (zone * CELLS + mi.UInt32(row)) * CELLS + mi.UInt32(column)
        return self.toward.at(cell, 0, active) / (distance2 + reach2)

    def pick_zone(self, p, x):
        """A zone, what is left of the random number `x`, and the sum of the weights of all zones."""
        if self.zones == 1:
            return mi.UInt32(0), x, mi.Float(1)

        def step(zone, picked, x, total):
            weight = self.zone_weight(zone, p)
            total += weight
            # Before the first zone that sends anything there the sum is 0.
            share = dr.select(total > 0, weight / dr.maximum(total, 1e-30), 0)
            is_picked = x < share
            x = dr.select(is_picked, x / dr.maximum(share, 1e-30), (x - share) / dr.maximum(1 - share, 1e-7))
            return zone + 1, dr.select(is_picked, zone, picked), dr.clip(x, 0, 0.99999994), total

        start = (mi.UInt32(0), mi.UInt32(self.brightest), mi.Float(x), mi.Float(0))
        _, picked, x, total = dr.while_loop(start, lambda zone, *_: zone < self.zones, step)
        return picked, x, total

    def zone_share(self, zone, p, total, active):
        return mi.Float(1) if self.zones == 1 else self.zone_weight(zone, p, active) / dr.maximum(total, 1e-30)

    def draw(self, p, sample, active):
        """A triangle and the shares of its corners, for light that goes to `p`; and the sum of the weights of all zones."""
        y = mi.Float(sample.y)
        zone, x, total = self.pick_zone(p, mi.Float(sample.x))
        begin, end = self.part_begin.at(zone, 0, active), self.part_end.at(zone, 0, active)
        place = self.part_share.search(x, begin, dr.maximum(end, 1) - 1)
        low = dr.select(place > begin, self.part_share.at(dr.maximum(place, 1) - 1, 0, active), 0)
        x = dr.clip((x - low) / dr.maximum(self.part_share.at(place, 0, active) - low, 1e-20), 0, 1)
        part = self.part.at(place, 0, active)
        triangle = part // 3
        corner = part - 3 * triangle
        # Dirichlet (2, 1, 1): the corner's share has the distribution function 3 h^2 - 2 h^3, the others part the rest evenly.
        high = dr.clip(0.5 - dr.sin(dr.asin(1 - 2 * y) / 3), 0, 1)
        rest = 1 - high
        others = [rest * x, rest * (1 - x)]
        shares = [
            dr.select(corner == 0, high, others[0]),
            dr.select(corner == 1, high, dr.select(corner == 0, others[0], others[1])),
            dr.select(corner == 2, high, others[1]),
        ]
        return triangle, shares, total

    def density(self, p, uv, total, active):
        """Points drawn for `p` per area."""
        triangle, shares = self.place(uv)
        sum_ = mi.Float(0)
        for k in range(3):
            vertex = self.corner.at(triangle, k, active)
            own = mi.Float(0)
            for kind in range(self.kinds):
                zone = self.zone.at(vertex, kind, active)
                share = self.zone_share(zone, p, total, active) * self.zone_scale.at(zone, 0, active)
                own += self.weight.at(vertex, kind, active) * share
            sum_ += shares[k] * self.mean.at(triangle, k, active) * own
        return dr.maximum(sum_, 0)

    # What Mitsuba asks for.

    def eval(self, si, active=True):
        return self.light(si.uv, si.to_world(si.wi), dr.dot(si.n, si.to_world(si.wi)), active)

    def sample_direction(self, it, sample, active=True):
        triangle, shares, total = self.draw(it.p, sample, active)
        ds = dr.zeros(mi.DirectionSample3f) if dr.is_jit_v(mi.Float) else mi.DirectionSample3f()
        ds.p, ds.n, ds.uv = self.point(triangle, shares, active)
        ds.time, ds.delta = it.time, False
        away = ds.p - it.p
        ds.dist = dr.norm(away)
        ds.d = away / dr.maximum(ds.dist, 1e-20)
        ds.emitter = mi.EmitterPtr(self) if dr.is_jit_v(mi.Float) else self
        ds.pdf = self.pdf(it, ds, total, active)
        light = self.light(ds.uv, -ds.d, dr.dot(ds.n, ds.d), active)
        return ds, dr.select(active & (ds.pdf > 0), light / dr.maximum(ds.pdf, 1e-30), 0)

    def pdf_direction(self, it, ds, active=True):
        _, _, total = self.pick_zone(it.p, mi.Float(0))
        return self.pdf(it, ds, total, active)

    def pdf(self, it, ds, total, active):
        cosine = dr.abs(dr.dot(ds.n, ds.d))
        pdf = self.density(it.p, ds.uv, total, active) * ds.dist * ds.dist / dr.maximum(cosine, GRAZING)
        return dr.select(active & (cosine > GRAZING), pdf, 0)

    def eval_direction(self, it, ds, active=True):
        return self.light(ds.uv, -ds.d, dr.dot(ds.n, ds.d), active)

    def bbox(self):
        return mi.ScalarBoundingBox3f(self.box[0].tolist(), self.box[1].tolist())

    def traverse(self, callback):
        pass

    def to_string(self):
        return f"Lampwright[{self.zones} zones, {self.planes} x {self.nodes} directions]"


mi.register_emitter("lampwright", Lampwright)
