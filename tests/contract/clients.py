"""Generates a client in Python and one in TypeScript from `openapi/openapi.json`, and has both do what a client does."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from service import ROOT, Service, sample

HERE = Path(__file__).resolve().parent
JUDGES = ROOT / "target/judges"
CONTRACT = ROOT / "openapi/openapi.json"


def python(folder):
    """The command that uses the generated Python."""
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--path", CONTRACT, "--meta", "none"]
    command += ["--output-path", folder / "lampwright_client", "--config", HERE / "python.yaml", "--fail-on-warning"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return [sys.executable, HERE / "smoke.py"]


def typescript(folder):
    """The command that uses the generated TypeScript, which has passed the strictest check of types."""
    (folder / "node_modules").symlink_to(JUDGES / "node_modules")
    (folder / "package.json").write_text('{ "type": "module" }')
    for name in ["generate.mjs", "smoke.ts", "tsconfig.json"]:
        (folder / name).write_text((HERE / name).read_text())
    subprocess.run(["node", "generate.mjs", CONTRACT, "lampwright.ts"], cwd=folder, check=True)
    subprocess.run(["node", "node_modules/typescript/bin/tsc", "--project", "."], cwd=folder, check=True)
    return ["node", folder / "out/smoke.js"]


def smoke(language, command, folder):
    with Service(folder / "service", keys=True) as service:
        rays = folder / "chip.tm25ray"
        rays.write_bytes(sample(folder, "flat-chip", 2000))
        command = [str(word) for word in [*command, service.url, service.key, rays]]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(folder)})
    print(f"the client in {language} works", flush=True)


if __name__ == "__main__":
    for language, generate in [("Python", python), ("TypeScript", typescript)]:
        with tempfile.TemporaryDirectory() as place:
            smoke(language, generate(Path(place)), Path(place))
