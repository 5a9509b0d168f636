"""A running service with something in it: the binary on a free port of loopback, with a data folder of its own."""

import json
import os
import subprocess
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BINARY = os.environ.get("LAMPWRIGHT", str(ROOT / "target/debug/lampwright"))
TENANT = "lab"
SCOPES = ["uploads:read", "uploads:write", "jobs:read", "jobs:write", "webhooks:read", "webhooks:write", "metrics:read"]
# Neither asks how often nor how much nor how long: the bounds of one key are tests/api's.
UNBOUNDED = ["--rate", "1000000", "--burst", "1000000", "--quota-queued", "1000000", "--job-timeout", "4294967295"]
PATIENCE_S = 240


def run(*arguments):
    """Standard output of the binary."""
    return subprocess.run([BINARY, *map(str, arguments)], check=True, capture_output=True).stdout


def sample(folder, source, rays):
    """A ray file of a known source."""
    path = Path(folder) / f"{source}.tm25ray"
    run("sample", source, "--rays", rays, "--force", "-o", path)
    return path.read_bytes()


class Service:
    """`with Service(folder, keys=True) as service`: `url`, `key` (None without keys), `ask`."""

    def __init__(self, folder, keys):
        self.folder, self.key = Path(folder), None
        self.folder.mkdir()
        data = self.folder / "data"
        if keys:
            scopes = [word for scope in SCOPES for word in ("--scope", scope)]
            self.key = run("keys", "create", "--tenant", TENANT, *scopes, "--data", data).decode().strip()
        arguments = [BINARY, "serve", "--listen", "127.0.0.1:0", "--no-sample", "--data", data, *UNBOUNDED]
        environment = {name: value for name, value in os.environ.items() if not name.startswith("LAMPWRIGHT_")}
        self.log = open(self.folder / "log", "w")
        self.process = subprocess.Popen(
            [*arguments, *(["--auth", "on"] if keys else [])],
            stdout=subprocess.PIPE,
            stderr=self.log,
            env=environment,
            text=True,
        )
        first = self.process.stdout.readline()
        if " is at http://" not in first:
            raise SystemExit(f"the service did not start: {(self.folder / 'log').read_text()}")
        self.url = first.split(" is at ")[1].strip()
        until("/readyz", lambda: self.ask("GET", "/readyz"))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(60)
        self.log.close()

    def lives(self):
        return self.process.poll() is None

    def errors(self):
        """The errors in its log, one a line."""
        lines = (self.folder / "log").read_text().splitlines()
        return "".join(f"log: {line}\n" for line in lines if " ERROR " in line)

    def ask(self, method, path, body=None, media_type="application/json", more=()):
        """What a request that must succeed answers, as JSON, or else where it leads; None for nothing."""
        headers = dict(more) | ({"Authorization": f"Bearer {self.key}"} if self.key else {})
        if body is not None:
            headers["Content-Type"] = media_type
        body = json.dumps(body).encode() if media_type == "application/json" and body is not None else body
        request = urllib.request.Request(self.url + path, data=body, method=method, headers=headers)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return json.loads(answer.read() or json.dumps(answer.headers["Location"]))

    def ray_set(self, rays):
        answer = self.ask("POST", "/v1/ray-sets?name=chip.tm25ray", rays, "application/octet-stream")
        return answer["ray_sets"][0]["id"]

    def spectrum(self, text):
        return self.ask("POST", "/v1/spectra?name=blue.txt", text, "application/octet-stream")["id"]

    def job(self, ray_set):
        """A job of its own, though there may be an equal one."""
        return self.ask("POST", "/v1/jobs", {"channels": [{"ray_set": ray_set}], "reuse": False})["id"]

    def upload(self, byte_count):
        """A file of which no byte has come."""
        head = {"Tus-Resumable": "1.0.0", "Upload-Length": str(byte_count)}
        return self.ask("POST", "/v1/uploads", more=head).rsplit("/", 1)[1]

    def webhook(self):
        return self.ask("POST", "/v1/webhooks", {"url": "https://receiver.invalid/"})["id"]

    def delivery(self, webhook):
        return self.ask("POST", f"/v1/webhooks/{webhook}/ping", {})["id"]

    def succeeded(self, job):
        """Waits for the end of a job, which must be a good one."""
        path = f"/v1/jobs/{job}"
        until(path, lambda: self.ask("GET", path)["state"] not in ("queued", "running"))
        done = self.ask("GET", path)
        assert done["state"] == "succeeded", done
        return done


def until(what, true):
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        if time.monotonic() > deadline:
            raise SystemExit(f"still waiting for {what}")
        time.sleep(0.05)
