"""Makes an object of a Lampwright source model in Blender: a mesh whose light is stock nodes of Cycles.

    blender --python lampwright_blender.py                 Blender, with the lamp in it
    blender -b --python lampwright_blender.py -- lamp.blend    writes lamp.blend

or, in a script of your own: import lampwright_blender; lamp = lampwright_blender.lamp()

A point of the surface sends the radiance M q / |cos| in each direction, to both sides, and lets light pass. M is the attribute "lampwright_light" of
the vertices. q is a sum over zones: the attribute "lampwright_zone_N" times an IES texture, looked up by the direction in the object's own axes, so
that the lamp can be moved, turned and scaled. Faces of like zones share a material.
"""

import sys
from pathlib import Path

import bpy
import numpy as np

HERE = Path(__file__).resolve().parent
# Blender's IES texture gives candela times 4 pi / 177.83; it takes a W of white light for 177.83 lm.
LM_PER_W = 177.83
IES_FACTOR = 0.0706650768394
# The largest number in an IES text, which has four decimals.
PEAK = 100000.0
LIGHT, ZONE, SCALE = "lampwright_light", "lampwright_zone_%d", "lampwright_scale"
GRAZING = 1e-4


def lamp(folder=HERE, name="Lampwright lamp", units_per_mm=0.001):
    """A new object, linked to the scene's collection. Of lengths, a mm becomes `units_per_mm` units: 0.001 where a unit is a metre.

    Its property "lampwright_scale" multiplies its light: 1/177.83 gives W of lm as Blender's own IES lamps do, 1 gives cd/m2."""
    with np.load(Path(folder) / "lampwright_model.npz") as stored:
        model = {key: stored[key] for key in stored.files}
    mesh = bpy.data.meshes.new(name)
    positions = model["positions_mm"] * units_per_mm
    mesh.from_pydata(positions.tolist(), [], model["triangles"].tolist())
    put(mesh, LIGHT, "FLOAT_VECTOR", "vector", model["exitance"])
    weights = weights_of_zones(model)
    zones = len(weights)
    if zones > 1:
        for zone, weight in enumerate(weights):
            put(mesh, ZONE % zone, "FLOAT", "value", weight)
    materials(mesh, model, weights, name)
    made = bpy.data.objects.new(name, mesh)
    made[SCALE] = 1 / LM_PER_W if model["is_photometric"][0] else 1.0
    bpy.context.scene.collection.objects.link(made)
    return made


def put(mesh, name, kind, field, numbers):
    attribute = mesh.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(field, np.ascontiguousarray(numbers, np.float32).ravel())


def weights_of_zones(model):
    """Weight of each zone at each vertex, [zone][vertex]."""
    zones, weights = model["zones"].astype(int), model["weights"]
    table = np.zeros((len(model["distributions"]), len(zones)), np.float32)
    for place in range(zones.shape[1]):
        np.add.at(table, (zones[:, place], np.arange(len(zones))), weights[:, place])
    return table


def materials(mesh, model, weights, name):
    """A material for the faces that have most of their light in a zone; it knows all zones that these faces have light of."""
    on_faces = weights[:, model["triangles"].astype(int)].mean(axis=2)
    chief = on_faces.argmax(axis=0)
    textures, slots = {}, np.zeros(len(chief), np.int32)
    for zone in np.unique(chief):
        faces = chief == zone
        used = np.flatnonzero(on_faces[:, faces].max(axis=1) > 0)
        for other in used:
            if other not in textures:
                textures[other] = texture(model, int(other), name)
        slots[faces] = len(mesh.materials)
        mesh.materials.append(material(f"{name} {zone}", model, [(int(other), *textures[other]) for other in used], len(weights) > 1))
    mesh.polygons.foreach_set("material_index", slots)


def texture(model, zone, name):
    """The distribution of a zone as an IES text, and what the texture is to be multiplied by to give it, per sr."""
    q, gamma = model["distributions"][zone].astype(float), np.degrees(model["gamma"].astype(float))
    peak = max(q.max(), 1e-30)
    planes, nodes = q.shape
    rows = np.concatenate((q, q[:1])) / peak * PEAK
    c = np.arange(planes + 1) * 360 / planes
    lines = ["IESNA:LM-63-2002", f"[OTHER] distribution of zone {zone} of a Lampwright model", "TILT=NONE"]
    lines += [f"1 -1 1 {nodes} {planes + 1} 1 2 0 0 0", "1 1 0"]
    lines += [" ".join(f"{angle:.6g}" for angle in angles) for angles in (np.round(gamma, 6), c)]
    lines += [" ".join(f"{value:.4f}" for value in row) for row in rows]
    text = bpy.data.texts.new(f"{name} {zone}.ies")
    text.write("\n".join(lines) + "\n")
    return text, peak / (PEAK * IES_FACTOR)


def material(name, model, zones, has_weights):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    made.cycles.emission_sampling = "FRONT_BACK"
    tree = made.node_tree
    tree.nodes.clear()

    def node(kind, inputs=(), **settings):
        """A new node; each input is a number or a socket."""
        new = tree.nodes.new(kind)
        for key, value in settings.items():
            setattr(new, key, value)
        for place, value in dict(inputs).items():
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, new.inputs[place])
            else:
                new.inputs[place].default_value = value
        return new

    def math(operation, *values):
        return node("ShaderNodeMath", enumerate(values), operation=operation).outputs[0]

    def vector(operation, *values):
        found = node("ShaderNodeVectorMath", enumerate(values), operation=operation)
        return found.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]

    def attribute(name, output, kind="GEOMETRY"):
        return node("ShaderNodeAttribute", attribute_name=name, attribute_type=kind).outputs[output]

    geometry = node("ShaderNodeNewGeometry")
    away = geometry.outputs["Incoming"]
    turn = node("ShaderNodeVectorTransform", {0: away}, vector_type="VECTOR", convert_from="WORLD", convert_to="OBJECT")
    along = vector("NORMALIZE", turn.outputs[0])
    # The texture has nadir at -Z, C0 at -Y and C90 at -X.
    x, y, z = (tuple(map(float, axis)) for axis in model["axes"])
    minus = [tuple(-part for part in axis) for axis in (y, x)]
    parts = [vector("DOT_PRODUCT", along, axis) for axis in (*minus, z)]
    # At C = 360 exactly the texture gives nothing: what lies in the plane of C0 is turned by a millionth.
    parts[0] = math("SUBTRACT", parts[0], 1e-6)
    direction = node("ShaderNodeCombineXYZ", enumerate(parts)).outputs[0]
    q = None
    for zone, text, factor in zones:
        ies = node("ShaderNodeTexIES", mode="INTERNAL", ies=text)
        tree.links.new(direction, ies.inputs["Vector"])
        ies.inputs["Strength"].default_value = factor
        part = ies.outputs[0]
        if has_weights:
            part = math("MULTIPLY", part, attribute(ZONE % zone, "Fac"))
        q = part if q is None else math("ADD", q, part)
    cosine = math("MAXIMUM", math("ABSOLUTE", vector("DOT_PRODUCT", away, geometry.outputs["True Normal"])), GRAZING)
    strength = math("MULTIPLY", math("DIVIDE", q, cosine), attribute(SCALE, "Fac", "OBJECT"))
    emission = node("ShaderNodeEmission", {"Color": attribute(LIGHT, "Vector"), "Strength": strength})
    passing = node("ShaderNodeBsdfTransparent")
    both = node("ShaderNodeAddShader", {0: emission.outputs[0], 1: passing.outputs[0]})
    node("ShaderNodeOutputMaterial", {"Surface": both.outputs[0]})
    return made


def main(arguments):
    bpy.context.scene.render.engine = "CYCLES"
    made = lamp()
    if arguments:
        bpy.ops.wm.save_as_mainfile(filepath=str(Path(arguments[0]).resolve()))
    print(f"{made.name}: {len(made.data.vertices)} vertices, {len(made.data.materials)} materials")


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
