"""Generates a client in Python and one in TypeScript from `openapi/openapi.json`, and has both do what a client does."""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from service import ROOT, Service, sample

HERE = Path(__file__).resolve().parent
JUDGES = ROOT / "target/judges"
CONTRACT = ROOT / "openapi/openapi.json"


def operations():
    """`(path, method, operation)` of everything that the contract offers."""
    for path, item in json.loads(CONTRACT.read_text())["paths"].items():
        for method, operation in item.items():
            yield path, method, operation


def missing(what, names):
    if names:
        raise SystemExit(f"{what} lacks {', '.join(sorted(names))}")


def python(folder):
    """The command that uses the generated Python. The generator is used as it comes, and may leave nothing out: no route, no
    answer of one, no type."""
    client = folder / "lampwright_client"
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--path", CONTRACT, "--meta", "none"]
    command += ["--output-path", client, "--config", HERE / "python.yaml", "--fail-on-warning"]
    made = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if made.returncode or "WARNING" in made.stdout:
        raise SystemExit(f"the generator of the client in Python is not content:\n{made.stdout}")
    routes = {path.stem for path in client.glob("api/*/*.py")}
    missing("the client in Python", {operation["operationId"] for _, _, operation in operations()} - routes)
    known = " ".join(path.read_text() for path in client.glob("models/*.py"))
    classes = {name.lower() for name in re.findall(r"^class (\w+)", known, re.MULTILINE)}
    schemas = json.loads(CONTRACT.read_text())["components"]["schemas"]
    # A choice is a union of its kinds, and a list of numbers a list.
    named = {name for name, schema in schemas.items() if schema.get("type") == "object" or "enum" in schema}
    missing("the client in Python", {name for name in named if name.replace("_", "").lower() not in classes})
    return [sys.executable, HERE / "smoke.py"]


def typescript(folder):
    """The command that uses the generated TypeScript, which has passed the strictest check of types."""
    (folder / "node_modules").symlink_to(JUDGES / "node_modules")
    (folder / "package.json").write_text('{ "type": "module" }')
    for name in ["generate.mjs", "smoke.ts", "tsconfig.json"]:
        (folder / name).write_text((HERE / name).read_text())
    subprocess.run(["node", "generate.mjs", CONTRACT, "lampwright.ts"], cwd=folder, check=True)
    types = (folder / "lampwright.ts").read_text()
    # As `paths` has them: `"/v1/jobs": { .. get: operations["list_jobs"]; ..`.
    missing(
        "the client in TypeScript",
        {
            f"{method} {path}"
            for path, method, operation in operations()
            if f'"{path}": {{' not in types or f'{method}: operations["{operation["operationId"]}"];' not in types
        },
    )
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
