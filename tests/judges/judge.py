"""Judges one unzipped result with foreign programs and with an evaluation of its own. Usage: judge.py DIR [DIR..]

Every check prints what it looked at; exit 1 if any fails or if nothing was checked."""

import sys
import warnings

import jsonschema_rs
import numpy as np
from photompy import total_optical_power

import radiance
from eulumdat_files import judge_ldt
from luminaire_files import judge_gldf, judge_tm33
from result import SCHEMAS, Grid, Result, Volume, read_json

FLUX_TOLERANCE = 0.005  # of foreign programs' lumens
# Both interpolate, then sum at this step of gamma. A ridge at one node among nodes 4.5 degrees apart is summed to 0.3 %; at steps of
# 1 or 2 degrees to 1 % only.
GAMMA_STEP_DEG = 0.5
SUM_TOLERANCE = 1e-6
ROUNDING = 1e-5  # six digits in arrays
INTENSITY_TOLERANCE = 0.05  # of the peak: hard zones mix inside triangles that lie astride a border


class Verdict:
    def __init__(self):
        self.checked, self.failed = 0, 0

    def that(self, good, words):
        self.checked += 1
        if not good:
            self.failed += 1
            print(f"  FAILED: {words}")

    def close(self, found, expected, tolerance, words):
        off = abs(found - expected) / max(abs(expected), 1e-300)
        self.that(off <= tolerance, f"{words}: {found:.9g} against {expected:.9g} ({off:.2e} off, {tolerance} allowed)")
        return off


def judge_schemas(result, verdict):
    documents = [
        ("goniograms", result.goniograms),
        ("report", result.report),
        ("emitter-extras", result.surface.extras),
    ]
    for name, document in documents:
        schema = read_json(SCHEMAS / f"{name}.schema.json")
        jsonschema_rs.meta.validate(schema)
        errors = list(jsonschema_rs.Draft202012Validator(schema).iter_errors(document))
        for error in errors[:5]:
            print(f"  {name} {error.instance_path}: {error.message[:200]}")
        verdict.that(not errors, f"{name}: {len(errors)} violations of its schema")
    print(f"schemas: {len(documents)} documents valid")


def judge_ies(result, verdict):
    """Lumens by Radiance (interpolates) and photompy (weights bands); JSON and IES node by node."""
    files, worst = 0, {"radiance": 0.0, "photompy": 0.0}
    # Of many zones that follow the surface, the 16 of the largest flux have files, and the whole has.
    filed = [name for name, part in result.parts() if "files" in part]
    verdict.that(len(filed) == len(result.parts()) or len(filed) == 17, f"{len(filed)} of {len(result.parts())} parts have files")
    for name, part in result.parts():
        path = part.get("files", {}).get("ies")
        if path is None:
            verdict.that("files" not in part or part["flux_lm"] is None, f"{name}: luminous flux is known, but there is no IES file")
            continue
        files += 1
        values = np.array(part["luminous_intensity_cd"])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = float(total_optical_power(str(result.folder / path), round(180 / GAMMA_STEP_DEG) + 1))
        worst["photompy"] = max(worst["photompy"], verdict.close(found, part["flux_lm"], FLUX_TOLERANCE, f"photompy {path}"))
        interpolated = result.grid.norm(values)
        found = radiance.lumens(result.folder / path, GAMMA_STEP_DEG)
        worst["radiance"] = max(worst["radiance"], verdict.close(found, interpolated, FLUX_TOLERANCE, f"Radiance {path}"))
        angles, planes, candela = ies_table(result.folder / path)
        verdict.that(np.allclose(angles, result.grid.gamma), f"{path}: its gamma nodes are the JSON's")
        verdict.that(np.allclose(planes, [*result.grid.c, 360.0]), f"{path}: its C planes are the JSON's and 360")
        verdict.that(np.array_equal(candela[-1], candela[0]), f"{path}: plane 360 is plane 0")
        off = np.abs(candela[:-1] - values).max() / values.max()
        verdict.that(off <= ROUNDING, f"{path}: {off:.2e} of the peak between IES and JSON")
    verdict.that(files == len(list(result.folder.glob("ies/*.ies"))), "every IES file is named in goniograms.json")
    off = ", ".join(f"{who} at most {value:.1e} off" for who, value in worst.items())
    print(f"ies: {files} files, {off}")


def ies_table(path):
    """The numbers of a file of ours, read by position: angles, planes, candela [plane][angle]."""
    lines = path.read_bytes().decode("ascii").split("\r\n")
    verdict_lines = [line for line in lines if "TILT" in line]
    if verdict_lines != ["TILT=NONE"]:
        raise ValueError(f"{path}: {verdict_lines}")
    numbers = " ".join(lines[lines.index("TILT=NONE") + 1 :]).split()
    vertical, horizontal = int(numbers[3]), int(numbers[4])
    values = np.array(numbers[13:], float)
    angles, planes = values[:vertical], values[vertical : vertical + horizontal]
    return angles, planes, values[vertical + horizontal :].reshape(horizontal, vertical)


def judge_sums(result, verdict):
    """Vertices = triangles = what the balance says; zones = total; cells = flux; bands = radiant flux inside them."""
    balance, surface = result.report["balance"], result.surface
    for unit, key, attribute in (("W", "radiant_W", "_FLUX_W"), ("lm", "luminous_lm", "_FLUX_LM")):
        expected = balance["incoming"]["flux"][key]
        if expected is None:
            verdict.that(surface.attribute(attribute) is None, f"{attribute} exists although its total is unknown")
            continue
        expected -= balance["rejected"]["flux"][key]
        lists = {name: {entry["unit"]: entry["values"] for entry in surface.extras[name]} for name in ("vertex_flux", "triangle_flux")}
        verdict.close(sum(lists["vertex_flux"][unit]), expected, SUM_TOLERANCE, f"sum of vertex flux, {unit}")
        verdict.close(sum(lists["triangle_flux"][unit]), expected, SUM_TOLERANCE, f"sum of triangle flux, {unit}")
        verdict.close(surface.attribute(attribute).sum(dtype=float), expected, SUM_TOLERANCE, f"sum of {attribute}")
        flux = "flux_" + unit
        verdict.close(sum(zone[flux] for zone in result.goniograms["zones"]), expected, SUM_TOLERANCE, f"sum of zones, {unit}")
        verdict.close(result.goniograms["total"][flux], expected, SUM_TOLERANCE, f"total goniogram, {unit}")
        matrix = "luminous_intensity_cd" if unit == "lm" else "radiant_intensity_W_per_sr"
        for name, part in result.parts():
            verdict.close(float(result.grid.flux(np.array(part[matrix]))), part[flux], ROUNDING, f"{name}: cells against {flux}")
    sphere = 4 * np.pi / len(result.grid.c)
    verdict.close(result.grid.solid_angle.sum(), sphere, SUM_TOLERANCE, "solid angles")
    verdict.close(result.grid.weight.sum(), sphere, SUM_TOLERANCE, "interpolation weights")
    spectra = surface.spectra()
    if spectra is not None:
        widths = np.diff(surface.extras["spectrum"]["band_edges_nm"])
        inside = result.goniograms["total"]["flux_W"] * (1 - result.report["spectrum"]["outside_share"])
        verdict.close((spectra.sum(axis=0) @ widths), inside, ROUNDING, "vertex spectra against radiant flux inside the bands")
        inline = surface.extras["vertex_spectra"]
        if inline["values"] is not None:
            off = np.abs(np.array(inline["values"]) * inline["scale"] - spectra).max() / inline["scale"]
            verdict.that(off <= 0.51, f"inline spectra are {off:.2f} of their unit from the attributes")
        for name, part in result.parts():
            dense = part.get("spectral_intensity")
            if dense is None:  # one spectrum in all directions
                continue
            values = np.array(dense["values"]).reshape(dense["shape"])
            off = np.abs(Grid(dense["grid"]).flux(values) - part["spectral_flux_W_per_nm"]).max()
            peak = max(part["spectral_flux_W_per_nm"])
            verdict.that(off <= ROUNDING * peak, f"{name}: spectral cells are {off:.2e} W/nm from its spectral flux")
    print(f"sums: {len(surface.vertices_mm)} vertices, {len(surface.triangles)} triangles, {len(result.goniograms['zones'])} zones")


CORNERS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6.0  # degree 2 on a triangle


class Model:
    """L = M q / |cos theta| from the artifacts alone, as openapi/README.md says, for one quantity."""

    def __init__(self, result, quantity, unit):
        self.surface = surface = result.surface
        self.grid = result.grid
        flux = next(entry["values"] for entry in surface.extras["vertex_flux"] if entry["unit"] == unit)
        self.exitance = np.array(flux) / surface.vertex_area_mm2
        self.zones, self.zone_weights_of_vertex = surface.attribute("_ZONES").astype(int), surface.attribute("_ZONE_WEIGHTS").astype(float)
        self.patterns = np.stack([np.array(zone[quantity]) for zone in result.goniograms["zones"]], axis=-1)
        norm = self.grid.norm(self.patterns)
        self.patterns = self.patterns / np.where(norm > 0, norm, 1)
        points = [(surface.triangles, weights) for weights in CORNERS]
        self.m = np.stack([(self.exitance[t] * w).sum(axis=1) for t, w in points])
        self.weights = np.stack([self.zone_weights(t, w) for t, w in points])

    def zone_weights(self, triangles, corner_weights):
        weights = np.zeros((len(triangles), self.patterns.shape[-1]))
        for corner in range(3):
            for place in range(4):
                vertex = triangles[:, corner]
                at = (np.arange(len(triangles)), self.zones[vertex, place])
                np.add.at(weights, at, corner_weights[corner] * self.zone_weights_of_vertex[vertex, place])
        return weights

    def intensity(self, c, gamma):
        """Integral of L |cos theta| over the surface, one value for each direction."""
        strength = np.einsum("pt,ptz,t->z", self.m, self.weights, self.surface.area_mm2 / 3)
        return self.grid.at(self.patterns, c, gamma) @ strength


def judge_model(result, verdict):
    """The flux of L over surface and sphere, and its intensity against the total goniogram."""
    axes = result.goniograms["frame"]["axes_in_source"]
    x, y, z = (np.array(axes[key], float) for key in "xyz")
    verdict.that(np.allclose(np.cross(x, y), z), "the frame is right-handed")
    for quantity, unit in (("radiant_intensity_W_per_sr", "W"), ("luminous_intensity_cd", "lm")):
        total = result.goniograms["total"]
        if total["flux_" + unit] is None:
            continue
        model = Model(result, quantity, unit)
        values = np.array(total[quantity])
        scale = total["flux_" + unit] / result.grid.norm(values)
        # Gauss points in cos gamma would step over the grid's kinks: midpoints, four to a cell.
        nodes = np.asarray(result.grid.gamma, float)
        steps = np.repeat(np.diff(nodes) / 4, 4)
        gammas = np.concatenate(([0.0], np.cumsum(steps)[:-1])) + steps / 2
        c_step = 360 / max(len(result.grid.c), 12)
        rings = np.cos(np.radians(gammas - steps / 2)) - np.cos(np.radians(gammas + steps / 2))
        gamma, c = (angle.ravel() for angle in np.meshgrid(gammas, np.arange(c_step / 2, 360, c_step), indexing="ij"))
        found = model.intensity(c, gamma)
        expected = scale * result.grid.at(values, c, gamma)
        flux = found @ np.repeat(rings, len(found) // len(rings)) * np.radians(c_step)
        verdict.close(flux, total["flux_" + unit], 2e-3, f"flux of L over surface and sphere, {unit}")
        if result.surface.extras["volume"] is not None:
            continue  # the total is that of the volume, which the surface follows less closely
        off = np.abs(found - expected).max() / expected.max()
        verdict.that(off <= INTENSITY_TOLERANCE, f"intensity of L is {off:.3f} of the peak from the total goniogram, {unit}")
        print(f"model: {len(found)} directions, flux {flux:.6g} {unit}, intensity within {off:.1e} of the peak")


def judge_volume(result, verdict):
    """Nodes are the corners of lit cells, stand for their volume, and hold all of the flux."""
    if result.surface.extras["volume"] is None:
        return
    volume = Volume(result.surface)
    verdict.that(volume.is_points and volume.is_whole, "the volume is a primitive of points, and its runs are all cells")
    same = len(volume.points_mm) == len(volume.expected_mm)
    verdict.that(same, f"{len(volume.points_mm)} nodes for {len(volume.expected_mm)} corners of lit cells")
    if same:
        off = np.abs(volume.points_mm - volume.expected_mm).max()
        verdict.that(off <= 1e-6 * np.abs(volume.expected_mm).max(), f"nodes lie up to {off:.1e} mm off their corners")
        verdict.close(volume.attributes["_VOLUME_MM3"].astype(float).sum(), volume.expected_mm3.sum(), 1e-5, "volume of the nodes")
    for unit in ("W", "LM"):
        flux = volume.attributes.get("_FLUX_" + unit)
        if flux is not None:
            total = result.goniograms["total"]["flux_" + unit.replace("LM", "lm")]
            verdict.close(flux.astype(float).sum(), total, SUM_TOLERANCE, f"flux of the volume, {unit}")
    print(f"volume: {len(volume.points_mm)} nodes")


def judge_light(result, verdict):
    """EXT_lights_ies of Khronos: ies/total.ies within, its node turned so that -Z is gamma 0, +X is C270 and +Y is C0."""
    gltf, path = result.surface.gltf, result.folder / "ies" / "total.ies"
    lights = (gltf.extensions or {}).get("EXT_lights_ies", {}).get("lights", [])
    verdict.that(len(lights) == int(path.exists()), f"{len(lights)} lights, and total.ies is {'there' if path.exists() else 'not there'}")
    for light in lights:
        view = gltf.bufferViews[light["bufferView"]]
        within = result.surface.blob[view.byteOffset or 0 :][: view.byteLength]
        verdict.that(within == path.read_bytes() and light["mimeType"] == "application/x-ies-lm-63", "the file within is total.ies")
        (node,) = [node for node in gltf.nodes if "EXT_lights_ies" in (node.extensions or {})]
        x, y, z, w = node.rotation
        v = np.array([x, y, z])
        axes = result.goniograms["frame"]["axes_in_source"]
        for own, source, sign in (([0, 0, -1], "z", -1), ([1, 0, 0], "y", -1), ([0, 1, 0], "x", 1)):
            turned = np.array(own) + 2 * np.cross(v, np.cross(v, own) + w * np.array(own))
            a, b, c = sign * np.array(axes[source])
            verdict.that(np.abs(turned - [a, c, -b]).max() < 1e-8, f"{own} of the light goes along {turned}, not along {sign} {source}")
        place = np.array(node.translation)
        low, high = result.surface.positions.min(axis=0), result.surface.positions.max(axis=0)
        verdict.that(bool(np.all(place >= low - 1e-9) and np.all(place <= high + 1e-9)), "the light stands within the surface")
    print(f"light: {len(lights)} with an IES file within")


def main(folders):
    verdict = Verdict()
    for folder in folders:
        print(folder)
        result = Result(folder)
        for judge in (judge_schemas, judge_sums, judge_ies, judge_ldt, judge_tm33, judge_gldf, judge_light, judge_model, judge_volume):
            judge(result, verdict)
    print(f"{verdict.checked} checks, {verdict.failed} failed")
    return 1 if verdict.failed or verdict.checked == 0 else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
