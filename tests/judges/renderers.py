"""Renderers as judges. Usage: renderers.py LAMPWRIGHT FOLDER, the binary and a folder with the models flat-chip, four-chips, dome
and two-lobes.

Mitsuba 3 and Radiance open what `lampwright adapter` writes. Irradiance on planes and pictures of the source are compared with closed forms
and with `lampwright evaluate`, which computes the same model without noise. Bounds are those of the renderer's own noise, from renderings with
eight seeds, and what is stated beside them. Prints the table of openapi/RENDERERS.md; exit 1 if anything is off or nothing was checked."""

import importlib
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

from known import CELLS, EYE, FINE, PIXELS, SOURCES, camera_points, coarse, plane_points
from radiance import BIN, run

mi.set_variant("llvm_ad_rgb")
SEEDS = 8
SAMPLES = 64
# Noise in sigma: of 1500 numbers one is beyond 5 once in a thousand runs. Seeds are fixed.
SIGMA = 5.0
# What quadratures, steps of radiance (Radiance's files have half a percent) and 32-bit numbers add.
MITSUBA_ROUNDING, RADIANCE_ROUNDING = 0.004, 0.012


class Verdict:
    def __init__(self):
        self.checked, self.failed, self.rows = 0, 0, []

    def that(self, good, words):
        self.checked += 1
        if not good:
            self.failed += 1
            print(f"  FAILED: {words}")

    def near(self, found, expected, allowed, words):
        """Every cell within what is allowed."""
        over = np.nanmax((np.abs(found - expected) - allowed) / np.nanmax(np.abs(expected)))
        worst = np.nanmax(np.abs(found - expected)) / np.nanmax(np.abs(expected))
        self.that(over <= 0, f"{words}: a cell is {over:.4f} of the largest beyond its bound ({worst:.4f} off)")


def evaluated(lampwright, model, *view):
    """Values and bounds of `lampwright evaluate`, per mm2."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "answer.json"
        command = [lampwright, "evaluate", model, *map(str, view), "--light", "radiant", "-o", path]
        subprocess.run(command, check=True, capture_output=True)
        channel = json.loads(path.read_text())["channels"][0]
    return np.array(channel["values"]) * 1e-6, np.array(channel["bounds"]) * 1e-6


def vector(values):
    return ",".join(f"{value:.9g}" for value in values)


def rendered(scene):
    """Mean and standard error of all cells, per mm2, and the standard deviation of a sample."""
    pictures = np.stack([np.array(mi.render(scene, seed=seed, spp=SAMPLES))[..., 1] for seed in range(SEEDS)]) * 1e-6
    deviation = pictures.std(axis=0, ddof=1)
    # Of eight seeds the deviation itself is 27 % uncertain: cells share what is typical.
    relative = np.sqrt(np.mean((deviation / np.maximum(pictures.mean(axis=0), 1e-30)) ** 2, where=pictures.mean(axis=0) > 0))
    pooled = np.maximum(deviation, relative * pictures.mean(axis=0))
    return pictures.mean(axis=0), pooled / math.sqrt(SEEDS), relative * math.sqrt(SAMPLES)


def film(count):
    return {"type": "hdrfilm", "width": count, "height": count, "rfilter": {"type": "box"}, "pixel_format": "rgb"}


def sensor(origin, target, up, width, near, count):
    turn = mi.ScalarTransform4f()
    return {
        "type": "orthographic",
        "near_clip": near,
        "to_world": turn.look_at(origin=list(map(float, origin)), target=list(map(float, target)), up=up).scale([width / 2, width / 2, 1]),
        "film": film(count),
        "sampler": {"type": "independent"},
    }


def emitter(folder):
    """The module of a folder that was written for Mitsuba."""
    sys.path.insert(0, str(folder))
    sys.modules.pop("lampwright_emitter", None)
    module = importlib.import_module("lampwright_emitter")
    sys.path.pop(0)
    return module


def mitsuba_irradiance(lamp, z, width):
    """Mean, standard error and relative deviation of a sample, of the cells of a plane that looks down: a diffuse one as it is seen."""
    turn = mi.ScalarTransform4f()
    scene = mi.load_dict({
        "type": "scene",
        "lamp": lamp,
        "integrator": {"type": "volpath", "max_depth": 3},
        "plane": {
            "type": "rectangle",
            "to_world": turn.translate([0, 0, z]).rotate([1, 0, 0], 180).scale(10 * width),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}},
        },
        "sensor": sensor([0, 0, z - 1e-3], [0, 0, z], [0, 1, 0], width, 1e-5, CELLS),
    })
    found, noise, of_sample = rendered(scene)
    return found * math.pi / 0.5, noise * math.pi / 0.5, of_sample


def judge_mitsuba(name, source, folder, model, lampwright, verdict):
    lamp = emitter(folder).lamp()
    for z in source.heights:
        width = source.width * z / 2
        found, noise, of_sample = mitsuba_irradiance(lamp, z, width)
        view = ["plane", "--center", f"0,0,{z}", "--normal=0,0,-1", "--width", width, "--columns", CELLS * FINE, "--tolerance", 0.003]
        ours = coarse(evaluated(lampwright, model, *view)[0])
        exact = coarse(source.irradiance(*plane_points(z, width, CELLS * FINE)))
        words = f"Mitsuba, {name}, irradiance at z = {z}"
        verdict.near(found, ours, SIGMA * noise + MITSUBA_ROUNDING * ours, f"{words} against the model")
        verdict.near(found, exact, SIGMA * noise + source.model_error * exact.max(), f"{words} against the closed form")
        verdict.that(of_sample / 4 < 0.25, f"{words}: 16 samples leave a noise of {of_sample / 4:.3f}")
        off = 100 * (found.mean() / exact.mean() - 1)
        sigma = 100 * math.sqrt((noise**2).sum()) / CELLS**2 / exact.mean()
        apart = 100 * (found.mean() - ours.mean()) / exact.mean()
        verdict.that(abs(apart) < SIGMA * sigma + 0.2, f"{words}: the mean is {apart:.2f} ± {sigma:.2f} % off the model")
        renderer = f"Mitsuba 3, noise of 16 samples {100 * of_sample / 4:.1f} %"
        verdict.rows.append((name, f"irradiance at z = {z:g} mm, mean of {width:g} x {width:g} mm", exact.mean(), ours.mean(), renderer, off, sigma))
    width = 0.75 * source.width
    scene = mi.load_dict({"type": "scene", "lamp": lamp, "integrator": {"type": "volpath"}, "sensor": sensor(EYE, [0, 0, 0], [0, 0, 1], width, 1e-2, PIXELS)})
    found, noise, _ = rendered(scene)
    ours, bound = evaluated(lampwright, model, "camera", "--eye", vector(EYE), "--width", width, "--columns", PIXELS, "--samples", 16)
    words = f"Mitsuba, {name}, radiance"
    verdict.near(found, ours, SIGMA * noise + bound + MITSUBA_ROUNDING * ours.max(), f"{words} against the model")
    add_picture(name, source, "Mitsuba 3", found, ours, width, words, verdict)


def add_picture(name, source, renderer, found, ours, width, words, verdict):
    """Compares cells that lie within even light, and adds a row."""
    exact = coarse(source.radiance(*camera_points(width, PIXELS * FINE)))
    inside = exact > 0
    verdict.that(inside.sum() >= 4, f"{words}: {inside.sum()} cells lie within the light")
    means = [values[inside].mean() for values in (found, exact, ours)]
    off = means[0] / means[1] - 1
    verdict.that(abs(off) < source.picture_error, f"{words}: {off:.4f} off the closed form")
    dark = np.where(exact == 0, found, 0).max() / exact[inside].max()
    verdict.that(dark < source.dark_error, f"{words}: {dark:.4f} of the light where there is none")
    verdict.rows.append((name, "radiance within its light, from 36 degrees", means[1], means[2], renderer, 100 * off, None))


def traced(folder, points, directions, *options):
    """What rtrace finds along rays, [..][red, green, blue]."""
    if not (folder / "scene.oct").exists():
        (folder / "scene.oct").write_bytes(run(BIN / "oconv", "light.rad", "seen.rad", cwd=folder))
    rays = np.concatenate([points.reshape(-1, 3), np.broadcast_to(directions, points.shape).reshape(-1, 3)], axis=1)
    command = [BIN / "rtrace", "-h", "-ff", "-ab", "0", "-ds", "0", "-dt", "0", *options, "scene.oct"]
    out = run(*command, stdin=rays.astype(np.float32).tobytes(), cwd=folder)
    return np.frombuffer(out, np.float32).astype(float).reshape(*points.shape[:-1], 3)


def radiance_irradiance(folder, z, width):
    points = np.stack(plane_points(z, width, CELLS), axis=-1)
    return traced(folder, points, np.array([0.0, 0.0, -1.0]), "-I")[..., 1] * 1e-6


def judge_radiance(name, source, folder, model, lampwright, verdict):
    for z in source.heights:
        width = source.width * z / 2
        found = radiance_irradiance(folder, z, width)
        ours, _ = evaluated(lampwright, model, "plane", "--center", f"0,0,{z}", "--normal=0,0,-1", "--width", width, "--columns", CELLS, "--tolerance", 0.003)
        exact = source.irradiance(*plane_points(z, width, CELLS))
        words = f"Radiance, {name}, irradiance at z = {z}"
        verdict.near(found, ours, RADIANCE_ROUNDING * ours.max(), f"{words} against the model")
        verdict.near(found, exact, source.model_error * exact.max(), f"{words} against the closed form")
        off = 100 * (found.mean() / exact.mean() - 1)
        verdict.rows.append((name, f"irradiance at z = {z:g} mm, mean of 8 x 8 points", exact.mean(), ours.mean(), "Radiance", off, None))
    width = 0.75 * source.width
    points, toward = camera_points(width, PIXELS * FINE)
    found = traced(folder, points + 10 * toward, -toward)[..., 1] * 1e-6
    ours, _ = evaluated(lampwright, model, "camera", "--eye", vector(EYE), "--width", width, "--columns", PIXELS * FINE, "--samples", 1)
    words = f"Radiance, {name}, radiance"
    off = np.abs(found - ours) / ours.max()
    verdict.that(np.quantile(off, 0.95) < 0.03, f"{words}: 5 % of the lines are {np.quantile(off, 0.95):.4f} of the peak off the model")
    verdict.that(abs(found.sum() / ours.sum() - 1) < RADIANCE_ROUNDING, f"{words}: {found.sum() / ours.sum() - 1:.4f} off the model in all")
    add_picture(name, source, "Radiance", coarse(found), coarse(ours), width, words, verdict)


def judge_colour(lampwright, model, verdict):
    """In colour: the luminous flux of four chips by Radiance's and sRGB's luminance, and each chip has its own colour."""
    flux = json.loads((model / "goniograms.json").read_text())["total"]["flux_lm"]
    with tempfile.TemporaryDirectory() as folder:
        for renderer, weights in (("mitsuba", [0.2126, 0.7152, 0.0722]), ("radiance", np.array([0.265, 0.670, 0.065]) * 179)):
            target = Path(folder) / renderer
            adapt(lampwright, renderer, model, target)
            width, count = 2.63, 26  # no multiple of the chips: their edges fall between the lines alike
            x, y, z = plane_points(1.0, width, count)
            if renderer == "mitsuba":
                scene = mi.load_dict({
                    "type": "scene",
                    "lamp": emitter(target).lamp(),
                    "integrator": {"type": "volpath"},
                    "sensor": sensor([0, 0, 9], [0, 0, 0], [0, 1, 0], width, 1e-2, count),
                })
                colour = np.array(mi.render(scene, seed=1, spp=256))[:, ::-1]
            else:
                fine = np.stack(plane_points(1.0, width, FINE * count), axis=-1)
                colour = traced(target, fine, np.array([0.0, 0.0, -1.0])).reshape(count, FINE, count, FINE, 3).mean(axis=(1, 3))
            lumen = (colour @ np.array(weights)).mean() * width**2 * 1e-6 * math.pi
            verdict.that(abs(lumen / flux - 1) < 0.03, f"{renderer}, colour: {lumen:.1f} lm are seen of {flux:.1f} lm")
            for cx, cy, strongest, least in ((-0.6, -0.6, 2, 0), (0.6, -0.6, 1, 0), (-0.6, 0.6, 1, 0), (0.6, 0.6, 0, 2)):
                seen = colour[(abs(x - cx) < 0.4) & (abs(y - cy) < 0.4)].mean(axis=0)
                verdict.that(seen.argmax() == strongest and seen[least] < 0.2 * seen[strongest], f"{renderer}, chip at {cx}, {cy}: {seen}")


def judge_orientation(lampwright, model, verdict):
    """Which way round: 1 W go towards +X+Z and half as much towards +Y+Z, so a plane far above has two spots. A mirror image has one elsewhere."""
    z, width = 20.0, 48.0
    x, y, _ = plane_points(z, width, CELLS)
    view = ["plane", "--center", f"0,0,{z}", "--normal=0,0,-1", "--width", width, "--columns", CELLS * FINE, "--tolerance", 0.003]
    ours = coarse(evaluated(lampwright, model, *view)[0])
    with tempfile.TemporaryDirectory() as work:
        for renderer in ("mitsuba", "radiance"):
            folder = Path(work) / renderer
            adapt(lampwright, renderer, model, folder, "--light", "radiant")
            if renderer == "mitsuba":
                found, noise, _ = mitsuba_irradiance(emitter(folder).lamp(), z, width)
                verdict.near(found, ours, SIGMA * noise + MITSUBA_ROUNDING * ours.max(), f"{renderer}, two lobes against the model")
            else:
                found = radiance_irradiance(folder, z, width)
            spots = [found[mask].sum() for mask in ((x > 9) & (abs(y) < 9), (y > 9) & (abs(x) < 9), (x < -9) & (abs(y) < 9), (y < -9) & (abs(x) < 9))]
            ratio = spots[0] / spots[1]
            verdict.that(abs(ratio / 2 - 1) < 0.05, f"{renderer}: the spots at +X and +Y differ by {ratio:.3f}, not by 2")
            verdict.that(max(spots[2:]) < 0.02 * spots[1], f"{renderer}: there is light at -X or -Y, {spots}")


def adapt(lampwright, renderer, model, folder, *options):
    subprocess.run([lampwright, "adapter", renderer, model, "-o", folder, *options], check=True, capture_output=True)


def table(rows):
    print("| source | what | closed form | model | renderer | off the closed form |\n|---|---|---:|---:|---|---:|")
    for name, what, exact, ours, renderer, off, sigma in rows:
        unit = "W/mm²" if "irradiance" in what else "W/(mm² sr)"
        noise = "" if sigma is None else f" ± {sigma:.2f}"
        print(f"| {name} | {what} | {exact:.4g} {unit} | {ours:.4g} {unit} | {renderer} | {off:+.2f}{noise} % |")


def main(lampwright, models):
    os.environ["RAYPATH"] = f"{BIN.parent / 'lib'}:."
    verdict = Verdict()
    lampwright, models = Path(lampwright).resolve(), Path(models).resolve()
    with tempfile.TemporaryDirectory() as work:
        for name, source in SOURCES.items():
            for renderer, judge in (("mitsuba", judge_mitsuba), ("radiance", judge_radiance)):
                folder = Path(work) / f"{name}-{renderer}"
                adapt(lampwright, renderer, models / name, folder, "--light", "radiant")
                judge(name, source, folder, models / name, lampwright, verdict)
    judge_colour(lampwright, models / "four-chips", verdict)
    judge_orientation(lampwright, models / "two-lobes", verdict)
    table(verdict.rows)
    print(f"{verdict.checked} checks, {verdict.failed} failed")
    return 1 if verdict.failed or verdict.checked == 0 else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
