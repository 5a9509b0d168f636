"""Radiance as a judge: its own ies2rad reads the file, its own rtrace finds the light in every direction."""

import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pyradiance

BIN = Path(pyradiance.__file__).parent / "bin"
LM_PER_W = 179.0  # Radiance's own white luminous efficacy
DISTANCE_M = 100.0


def directions(c_deg, gamma_deg):
    """Where ies2rad puts them: nadir -Z, C0 +X, C90 +Y."""
    c, gamma = np.radians(c_deg), np.radians(gamma_deg)
    return np.stack([np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), -np.cos(gamma)], axis=-1)


def run(*command, stdin=b"", cwd):
    done = subprocess.run([str(part) for part in command], input=stdin, cwd=cwd, capture_output=True)
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]}: {done.stderr.decode()}")
    return done.stdout


def candela(ies, c_deg, gamma_deg):
    """Luminous intensity of an IES file in directions (degrees), as irradiance far away times distance squared."""
    toward = directions(c_deg, gamma_deg)
    rays = np.concatenate([toward * DISTANCE_M, -toward], axis=1)
    with tempfile.TemporaryDirectory() as folder:
        run(BIN / "ies2rad", "-dm", "-o", "light", Path(ies).resolve(), cwd=folder)
        octree = Path(folder) / "light.oct"
        rayleigh = BIN.parent / "lib"
        environment = f"RAYPATH={rayleigh}:."
        octree.write_bytes(run("env", environment, BIN / "oconv", "light.rad", cwd=folder))
        found = run("env", environment, BIN / "rtrace", "-h", "-I", "-ff", "-ab", "0", "-ds", "0", "-dt", "0", octree,
                    stdin=rays.astype(np.float32).tobytes(), cwd=folder)
    irradiance = np.frombuffer(found, np.float32).astype(float).reshape(-1, 3)
    return irradiance.mean(axis=1) * LM_PER_W * DISTANCE_M**2


def lumens(ies, gamma_step_deg, c_step_deg=3.0):
    """Luminous flux of an IES file: midpoint rule over the sphere, exact solid angles."""
    gamma_edges = np.radians(np.arange(0, 180 + gamma_step_deg / 2, gamma_step_deg))
    gamma = np.degrees((gamma_edges[1:] + gamma_edges[:-1]) / 2)
    c = np.arange(c_step_deg / 2, 360, c_step_deg)
    weight = (np.cos(gamma_edges[:-1]) - np.cos(gamma_edges[1:])) * np.radians(c_step_deg)
    grid = np.meshgrid(c, gamma)
    values = candela(ies, grid[0].ravel(), grid[1].ravel()).reshape(grid[0].shape)
    return float((values.sum(axis=1) * weight).sum())
