"""The lamp over a table of twelve times its size. Usage: scene.py [PICTURE.exr]"""

import sys

import mitsuba as mi

mi.set_variant("llvm_ad_rgb")
import lampwright_emitter  # noqa: E402, the variant comes first


def scene(samples=64):
    surface = mi.load_dict(lampwright_emitter.lamp())
    box = surface.bbox()
    middle, size = (box.min + box.max) / 2, max(box.extents())
    table = middle.z - 2 * size
    turn = mi.ScalarTransform4f()
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 6},
        "lamp": lampwright_emitter.lamp(turn.translate(list(middle)).rotate([1, 0, 0], 180).translate([-x for x in middle])),
        "table": {
            "type": "rectangle",
            "to_world": turn.translate([middle.x, middle.y, table]).scale(6 * size),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.6}},
        },
        "sensor": {
            "type": "perspective",
            "fov": 40,
            "to_world": turn.look_at(
                origin=[middle.x + 9 * size, middle.y + 5 * size, middle.z + 3 * size], target=[middle.x, middle.y, table + size], up=[0, 0, 1]
            ),
            "film": {"type": "hdrfilm", "width": 640, "height": 480},
            "sampler": {"type": "independent", "sample_count": samples},
        },
    })


if __name__ == "__main__":
    name = sys.argv[1] if len(sys.argv) > 1 else "picture.exr"
    picture = mi.render(scene())
    mi.util.write_bitmap(name, picture)
    print(f"{name}: radiance; 99 % of the pixels are below {float(sorted(picture.array)[int(0.99 * len(picture.array))]):.4g}")
