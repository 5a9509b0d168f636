"""Schemathesis against the running service, without keys and with one. `fuzz.py [CASES] [SEED] [what else schemathesis is told]`."""

import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from service import Service, sample

HERE = Path(__file__).resolve().parent
SPECTRUM = b"440 0\n450 1\n460 0\n"
# Of each kind; some are deleted on the way.
SEEDS = 6


def seed(service, folder):
    """Things for requests to be about: their identifiers, and files to send, next to the configuration."""
    rays = sample(folder, "flat-chip", 500)
    ray_sets = [service.ray_set(rays) for _ in range(SEEDS)]
    spectra = [service.spectrum(SPECTRUM) for _ in range(SEEDS)]
    jobs = [service.job(ray_set) for ray_set in ray_sets]
    for job in jobs:
        service.succeeded(job)
    uploads = [service.upload(10_000) for _ in range(SEEDS)]
    webhooks = [service.webhook() for _ in range(SEEDS)]
    deliveries = [service.delivery(webhook) for webhook in webhooks]
    things = {"ray_sets": ray_sets, "spectra": spectra, "jobs": jobs, "uploads": uploads}
    for name, ids in [*things.items(), ("webhooks", webhooks), ("deliveries", deliveries)]:
        (folder / f"{name}.dict").write_text("".join(f'"{id}"\n' for id in ids))
    for kind, bytes in [("rays", rays), ("spectra", SPECTRUM)]:
        (folder / kind).mkdir()
        (folder / kind / "file").write_bytes(bytes)
    for name in ["schemathesis.toml", "hooks.py"]:
        (folder / name).write_text((HERE / name).read_text())


def fuzz(keys, cases, seed_number, others):
    """Whether all checks passed, and what schemathesis said; with the errors the service logged where they did not."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "fuzz"
        with Service(Path(place) / "service", keys) as service:
            folder.mkdir()
            seed(service, folder)
            command = [sys.executable, "-m", "schemathesis.cli", "--config-file", folder / "schemathesis.toml", "run"]
            command += [service.url + "/openapi.json", "--max-examples", cases, "--seed", seed_number, *others]
            if keys:
                command += ["--header", f"Authorization: Bearer {service.key}"]
            else:
                # The contract is of a service that asks for keys; on loopback this one does not.
                command += ["--exclude-checks", "ignored_auth"]
                told = (folder / "schemathesis.toml").read_text()
                told = told.replace("[generation]", "[generation]\nwith-security-parameters = false")
                (folder / "schemathesis.toml").write_text(told)
            environment = {**os.environ, "CONTRACT_FILES": str(folder), "PYTHONPATH": str(folder)}
            said = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
            done = subprocess.run([str(word) for word in command], cwd=folder, env=environment, **said)
            assert service.lives(), f"the service ended\n{done.stdout}"
            passed = done.returncode == 0
            return passed, done.stdout if passed else done.stdout + service.errors()


if __name__ == "__main__":
    words = sys.argv[1:] + ["10", "1"][len(sys.argv) - 1 :]
    cases, seed_number = int(words[0]), int(words[1])
    print(f"{cases} cases per operation, seed {seed_number}", flush=True)
    # Both at once, on a core each; what they say is printed one after the other.
    with ThreadPoolExecutor() as both:
        runs = [both.submit(fuzz, keys, cases, seed_number, words[2:]) for keys in (False, True)]
        for name, run in zip(["without keys", "with a key"], runs):
            print(f"{name}:\n{run.result()[1]}", flush=True)
    failed = [name for name, run in zip(["without keys", "with a key"], runs) if not run.result()[0]]
    if failed:
        sys.exit(f"error: schemathesis found failures in the run {' and '.join(failed)}, seed {seed_number}")
