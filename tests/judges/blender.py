"""Blender as a judge, by hand, because its module is 970 MB. Usage: blender.py FOLDER [PICTURES], with what `lampwright adapter blender --light radiant`
wrote of flat-chip, four-chips and dome in FOLDER; Python 3.11 with bpy 5.0.1 (pip install bpy==5.0.1).

Prints rows for the table of openapi/RENDERERS.md, and writes a picture of each source to PICTURES, to be looked at."""

import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

from known import CELLS, EYE, FINE, PIXELS, SOURCES, camera_points, coarse, plane_points

SAMPLES, SEEDS = 64, 4


def rendered(count, samples, seed):
    """Radiance of a square picture, rows from the top."""
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = count
    scene.cycles.samples, scene.cycles.seed = samples, seed
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = f"{folder}/picture.exr"
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        picture = np.array(image.pixels).reshape(count, count, 4)[::-1, :, 1]
        bpy.data.images.remove(image)
    return picture


def prepare(folder):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.use_denoising = "CYCLES", False
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filter_size, scene.cycles.pixel_filter_type = 0.01, "BOX"
    scene.world = bpy.data.worlds.new("dark")
    scene.world.color = (0, 0, 0)
    sys.path.insert(0, str(folder))
    sys.modules.pop("lampwright_blender", None)
    import lampwright_blender

    sys.path.pop(0)
    lampwright_blender.lamp(units_per_mm=1.0)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera, camera.data.type, camera.data.clip_start = camera, "ORTHO", 1e-4
    return camera


def add_plane(z):
    bpy.ops.mesh.primitive_plane_add(size=400, location=(0, 0, z), rotation=(math.pi, 0, 0))
    plane = bpy.context.object
    paint = bpy.data.materials.new("paint")
    paint.use_nodes = True
    nodes = paint.node_tree.nodes
    nodes.clear()
    diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1)
    paint.node_tree.links.new(diffuse.outputs[0], output.inputs[0])
    plane.data.materials.append(paint)
    bpy.context.scene.cycles.max_bounces = 1
    return plane


def row(name, what, unit, exact, found, noise):
    sigma = f" ± {100 * noise / exact:.2f}" if noise else ""
    print(f"| {name} | {what} | {exact:.4g} {unit} | Blender 5.0.1 | {100 * (found / exact - 1):+.2f}{sigma} % |", flush=True)


def main(folder, pictures=None):
    from mathutils import Vector

    for name, source in SOURCES.items():
        camera = prepare(Path(folder).resolve() / name)
        width = 0.75 * source.width
        camera.location, camera.data.ortho_scale = EYE, width
        camera.rotation_euler = (-Vector(EYE)).to_track_quat("-Z", "Y").to_euler()
        found = rendered(PIXELS, SAMPLES, 0) * 1e-6
        exact = coarse(source.radiance(*camera_points(width, PIXELS * FINE)))
        row(name, "radiance within its light, from 36 degrees", "W/(mm² sr)", exact[exact > 0].mean(), found[exact > 0].mean(), None)
        if pictures:
            picture = rendered(256, SAMPLES, 0)
            levels = (np.clip(picture / np.quantile(picture[picture > 0], 0.95), 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
            Path(pictures, f"{name}.pgm").write_bytes(b"P5 256 256 255\n" + levels.tobytes())
        for z in source.heights:
            plane = add_plane(z)
            width = source.width * z / 2
            camera.location, camera.rotation_euler, camera.data.ortho_scale = (0, 0, z - 0.005), (math.pi, 0, math.pi), width
            means = np.array([rendered(CELLS, SAMPLES, seed).mean() for seed in range(SEEDS)]) * 1e-6 * math.pi / 0.5
            exact = source.irradiance(*plane_points(z, width, CELLS * FINE)).mean()
            what = f"irradiance at z = {z:g} mm, mean of {width:g} x {width:g} mm"
            row(name, what, "W/mm²", exact, means.mean(), means.std(ddof=1) / math.sqrt(SEEDS))
            bpy.data.objects.remove(plane)


if __name__ == "__main__":
    main(*sys.argv[1:])
