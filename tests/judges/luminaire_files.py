"""TM-33, GLDF and L3D as judges read them: eulumdat-rs, gldf-rs and l3d-rs, foreign programs; what those do not read, by the standards' names."""

import io
import json
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import eulumdat
import gldf_rs_python
import l3d
import numpy as np
from pyldt import LdtReader

from eulumdat_files import CANDELA_TOLERANCE, FLUX_TOLERANCE
from result import Grid


def judge_tm33(result, verdict):
    """The file of the whole source, direction by direction, and its spectra, against goniograms.json."""
    path, total = result.folder / "total.tm33.xml", result.goniograms["total"]
    lumens = total["flux_lm"]
    known = bool(lumens) or total.get("spectral_flux_W_per_nm") is not None
    verdict.that(path.exists() == known, f"total.tm33.xml is {'there' if path.exists() else 'not there'}")
    if not path.exists():
        return
    emitter = ElementTree.parse(path).getroot().find("Emitter")
    if lumens:
        (read,) = json.loads(eulumdat.AtlaDocument.from_file(str(path)).to_json())["emitters"]
        read = read["intensityDistribution"]
        c, gamma = read["horizontalAngles"], read["verticalAngles"]
        verdict.that((read["photometryType"], read["metric"]) == ("C", "Luminous"), f"eulumdat-rs reads {read['photometryType']}, {read['metric']}")
        judge_directions(result.grid, c, gamma, read["intensities"], np.array(total["luminous_intensity_cd"]), lumens, verdict, "luminous, by eulumdat-rs")
        verdict.close(float(emitter.find("LuminousData/LuminousFlux").text), lumens, 1e-6, "luminous flux in TM-33")
    spectrum = total.get("spectral_flux_W_per_nm")
    if spectrum is None:
        return
    watts = np.array(total["radiant_intensity_W_per_sr"])
    judge_directions(result.grid, *table(emitter.find("RadiantData/RadiantIntensity")), watts, total["flux_W"], verdict, "radiant")
    power = [float(entry.text) for entry in emitter.iterfind("SpectralData/EmitterSpectral/PwrData")]
    verdict.that(np.allclose(power, spectrum, rtol=1e-5), "the spectrum in TM-33 is that of the JSON")
    dense, angular = total.get("spectral_intensity"), emitter.find("SpectralData/AngularSpectral")
    small = dense is not None and len(dense["values"]) <= 200_000
    verdict.that(small == (angular is not None), f"spectral intensities are {'not ' * (angular is None)}in TM-33")
    if angular is not None:
        values = np.array(dense["values"]).reshape(dense["shape"])
        c, gamma, found = table(angular)
        found = np.array(found).reshape(len(c), len(gamma), -1)
        for band in range(values.shape[-1]):
            flux = spectrum[band]
            judge_directions(Grid(dense["grid"]), c, gamma, found[..., band], values[..., band], flux, verdict, f"band {band}")
    print(f"tm33: {len(power)} bands, spectral intensities {'in all directions' if angular is not None else 'of the whole'}")


def table(element):
    """C, gamma and the numbers of an element, in the file's order."""
    entries = element.findall("IntData")
    c, gamma = (list(dict.fromkeys(float(entry.get(key)) for entry in entries)) for key in "hv")
    told = [int(element.find(name).text) for name in ("NumberMeasured", "NumberHorz", "NumberVert")]
    if told != [len(c) * len(gamma), len(c), len(gamma)]:
        raise ValueError(f"TM-33 tells {told} of {len(c)} planes and {len(gamma)} nodes")
    return c, gamma, [float(entry.text) for entry in entries]


def judge_directions(grid, c, gamma, found, values, flux, verdict, words):
    whole = [*grid.c, 360.0] if len(grid.c) > 1 else list(grid.c)
    verdict.that(np.allclose(c, whole) and np.allclose(gamma, grid.gamma, atol=1e-5), f"{words}: {len(c)} planes, {len(gamma)} nodes of gamma")
    found = np.array(found).reshape(len(c), len(gamma))
    verdict.that(np.array_equal(found[-1], found[0]), f"{words}: plane 360 is plane 0")
    off = np.abs(found[: len(grid.c)] - values).max() / max(values.max(), 1e-300)
    verdict.that(off <= 1e-5, f"{words}: {off:.1e} of the peak between TM-33 and JSON")
    verdict.close(float(grid.flux(found[: len(grid.c)])), flux, FLUX_TOLERANCE, f"{words}: flux of its cells in TM-33")


def judge_gldf(result, verdict):
    """Each emitter of the product, its photometry and its place on the body; all lumens and all triangles are there."""
    path, lumens = result.folder / "source.gldf", result.goniograms["total"]["flux_lm"]
    verdict.that(path.exists() == bool(lumens), f"source.gldf is {'there' if path.exists() else 'not there'}")
    if not path.exists():
        return
    data = path.read_bytes()
    archive = zipfile.ZipFile(io.BytesIO(data))
    product = json.loads(gldf_rs_python.gldf_from_bytes(data))
    general = product["GeneralDefinitions"]
    files = {file["@id"]: file for file in general["Files"]["File"]}
    photometries = {entry["@id"]: entry["PhotometryFileReference"]["@fileId"] for entry in general["Photometries"]["Photometry"]}
    emitters = {entry["@id"]: entry["ChangeableLightEmitter"][0]["PhotometryReference"]["@photometryId"] for entry in general["Emitters"]["Emitter"]}
    (variant,) = product["ProductDefinitions"]["Variants"]["Variant"]
    reference = variant["Geometry"]["ModelGeometryReference"]
    objects = {entry["EmitterObjectExternalName"]: entry["@emitterId"] for entry in reference["EmitterReference"]}
    verdict.that(len(objects) == min(len([zone for zone in result.goniograms["zones"] if zone["flux_lm"]]), 64), f"{len(objects)} light-emitting objects")
    found = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for emitter in objects.values():
            file = files[photometries[emitters[emitter]]]
            verdict.that(file["@contentType"] == "ldc/eulumdat", f"{emitter}: {file['@contentType']}")
            ldt = Path(archive.extract(f"ldc/{file['$text']}", folder))
            head = LdtReader.read(ldt).header
            warned = [str(warning) for warning in eulumdat.Eulumdat.parse(ldt.read_bytes().decode("latin-1")).validate()]
            verdict.that(not warned, f"{ldt.name}: eulumdat-rs warns: {warned[:3]}")
            found += head.lamp_flux[0]
        body = files[general["Geometries"]["ModelGeometry"][0]["GeometryFileReference"][0]["@fileId"]]
        judge_body(result, Path(archive.extract(f"geo/{body['$text']}", folder)), objects, verdict)
    off = verdict.close(found, lumens, FLUX_TOLERANCE, "lumens of all light-emitting objects")
    print(f"gldf: {len(objects)} light-emitting objects, lumens {off:.1e} off")


def judge_body(result, path, objects, verdict):
    """The hull in the frame of the goniograms; each object within its box, and every face of at most one object."""
    read = json.loads(l3d.load_l3d(str(path)))
    (part,) = json.loads(l3d.get_model_parts(path.read_bytes()))
    verdict.that(part["path"] == "hull/hull.obj" and np.allclose(np.diag(np.array(part["mat"]).reshape(4, 4)), [1e-3, 1e-3, 1e-3, 1]), f"l3d-rs places {part}")
    root = ElementTree.fromstring(read["file"]["structure"])
    axes = result.goniograms["frame"]["axes_in_source"]
    turn = np.array([axes[key] for key in "xyz"], float)
    lines = zipfile.ZipFile(path).read("hull/hull.obj").decode().splitlines()
    vertices = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    faces = np.array([line.split()[1:] for line in lines if line.startswith("f ")], int) - 1
    off = np.abs(vertices - result.surface.vertices_mm @ turn.T).max()
    verdict.that(off <= 1e-5 * max(1.0, np.abs(vertices).max()), f"vertices are {off:.1e} mm from those of emitter.glb")
    verdict.that(sorted(map(tuple, faces)) == sorted(map(tuple, result.surface.triangles)), "faces are the triangles of emitter.glb")
    names = [entry.get("partName") for entry in root.iter("LightEmittingObject")]
    verdict.that(sorted(names) == sorted(objects), "objects of the product are those of the body")
    low, high = vertices.min(axis=0) / 1e3 - 1e-9, vertices.max(axis=0) / 1e3 + 1e-9
    for entry in root.iter("LightEmittingObject"):
        middle = np.array([float(entry.find("Position").get(key)) for key in "xyz"])
        half = np.array([float(entry.find("Rectangle").get(key)) for key in ("sizeX", "sizeY")] + [0.0]) / 2
        within = bool(np.all(middle - half >= low - 1e-6) and np.all(middle + half <= high + 1e-6))
        verdict.that(within, f"{entry.get('partName')} lies within the body")
    owned = np.zeros(len(faces), int)
    for surface in root.iter("LightEmittingSurface"):
        verdict.that(surface.find("LightEmittingObjectReference").get("lightEmittingPartName") in names, "a surface names an object")
        for entry in surface.find("FaceAssignments"):
            begin = int(entry.get("faceIndexBegin", entry.get("faceIndex")))
            owned[begin : int(entry.get("faceIndexEnd", begin)) + 1] += 1
    verdict.that(owned.max() == 1 and owned.mean() > 0.99, f"{(owned == 1).mean():.3f} of the faces shine")
