"""One unzipped result, read as a stranger reads it: emitter.glb through pygltflib, goniograms.json as openapi/ documents it."""

import json
from pathlib import Path

import numpy as np
from pygltflib import GLTF2

SCHEMAS = Path(__file__).resolve().parents[2] / "openapi"
WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
KIND = {5126: "<f4", 5125: "<u4"}


def read_json(path):
    def refuse(word):
        raise ValueError(f"{path}: {word} is not JSON")

    return json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=refuse)


class Grid:
    """A (C, gamma) grid; values are [c][gamma] with any further axes behind."""

    def __init__(self, grid):
        self.c = np.array(grid["c_deg"])
        self.gamma = np.array(grid["gamma_deg"])
        self.solid_angle = np.array(grid["solid_angle_sr"])
        self.weight = np.array(grid["interpolation_weight_sr"])

    def flux(self, values):
        """Sum of intensity times the solid angles of the cells."""
        return np.einsum("cg...,g->...", values, self.solid_angle)

    def norm(self, values):
        """Integral over the sphere of the bilinear interpolation."""
        return np.einsum("cg...,g->...", values, self.weight)

    def at(self, values, c, gamma):
        """Bilinear interpolation at degrees."""
        j = np.asarray(c) / 360.0 * len(self.c)
        nodes = np.asarray(self.gamma, float)
        k0 = np.clip(np.searchsorted(nodes, gamma, "right") - 1, 0, len(nodes) - 2)
        j0 = np.floor(j).astype(int)
        shape = (-1,) + (1,) * (values.ndim - 2)
        s, t = (j - j0).reshape(shape), ((np.asarray(gamma) - nodes[k0]) / (nodes[k0 + 1] - nodes[k0])).reshape(shape)
        j0, j1 = j0 % len(self.c), (j0 + 1) % len(self.c)
        return (1 - s) * ((1 - t) * values[j0, k0] + t * values[j0, k0 + 1]) + s * (
            (1 - t) * values[j1, k0] + t * values[j1, k0 + 1]
        )


class Volume:
    """The nodes of a volume as emitter.glb has them: where they must be, and the volume that each stands for."""

    def __init__(self, surface):
        facts = surface.extras["volume"]
        points = surface.gltf.meshes[0].primitives[facts["primitive"]]
        self.is_points = points.mode == 0 and points.indices is None
        self.attributes = {name: surface.accessor(i) for name, i in vars(points.attributes).items() if i is not None}
        x, y, z = facts["cells"]
        lit, at = np.zeros(x * y * z, bool), 0
        for number, run in enumerate(facts["lit_runs"]):
            lit[at : at + run] = number % 2 == 1
            at += run
        self.is_whole = at == lit.size
        around = np.zeros((z + 1, y + 1, x + 1))
        for corner in np.ndindex(2, 2, 2):
            a, b, c = corner
            around[a : a + z, b : b + y, c : c + x] += lit.reshape(z, y, x)
        nodes = np.argwhere(around > 0)
        pitch = np.array(facts["pitch_mm"])
        self.expected_mm = np.array(facts["min_mm"]) + nodes[:, ::-1] * pitch
        self.expected_mm3 = around[around > 0] * pitch.prod() / 8
        matrix = np.array(surface.extras["gltf_to_source_mm"]).reshape(4, 4).T
        self.points_mm = self.attributes["POSITION"].astype(float) @ matrix[:3, :3].T + matrix[:3, 3]


class Surface:
    """The hull as emitter.glb has it, back in the source frame."""

    def __init__(self, path):
        self.gltf = GLTF2().load(str(path))
        self.blob = self.gltf.binary_blob()
        mesh = self.gltf.meshes[0]
        self.attributes = vars(mesh.primitives[0].attributes)
        self.extras = mesh.extras["emitter"]
        self.triangles = self.accessor(mesh.primitives[0].indices).reshape(-1, 3)
        self.positions = position = self.attribute("POSITION").astype(float)
        matrix = np.array(self.extras["gltf_to_source_mm"]).reshape(4, 4).T
        self.vertices_mm = position @ matrix[:3, :3].T + matrix[:3, 3]
        a, b, c = (self.vertices_mm[self.triangles[:, k]] for k in range(3))
        cross = np.cross(b - a, c - a)
        self.area_mm2 = np.linalg.norm(cross, axis=1) / 2
        self.normal = cross / (2 * self.area_mm2[:, None])
        self.vertex_area_mm2 = np.zeros(len(position))
        np.add.at(self.vertex_area_mm2, self.triangles, np.repeat(self.area_mm2[:, None] / 3, 3, axis=1))

    def accessor(self, index):
        accessor = self.gltf.accessors[index]
        view = self.gltf.bufferViews[accessor.bufferView]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        width = WIDTH[accessor.type]
        numbers = np.frombuffer(self.blob, KIND[accessor.componentType], accessor.count * width, start)
        return numbers.reshape(-1, width) if width > 1 else numbers

    def attribute(self, name):
        """An attribute by its name; None where the file has none."""
        index = self.attributes.get(name)
        return None if index is None else self.accessor(index)

    def spectra(self):
        """Spectral flux, [vertex][band], W/nm; None where unknown."""
        facts = self.extras["vertex_spectra"]
        if facts is None:
            return None
        if facts["attributes"]:
            return np.stack([self.attribute(name) for name in facts["attributes"]], axis=1).astype(float)
        return np.array(facts["values"], float) * facts["scale"]


class Result:
    def __init__(self, folder):
        self.folder = Path(folder)
        self.goniograms = read_json(self.folder / "goniograms.json")
        self.report = read_json(self.folder / "report.json")
        self.surface = Surface(self.folder / "emitter.glb")
        self.grid = Grid(self.goniograms["grid"])

    def parts(self):
        """(name, goniogram) of each zone and of the whole."""
        zones = [(f"zone {zone['id']}", zone) for zone in self.goniograms["zones"]]
        return zones + [("total", self.goniograms["total"])]
