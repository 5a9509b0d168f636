"""Sends a ray file with tuspy to a server that dies again and again, and compares what is kept with hashlib's digest."""

import argparse
import atexit
import contextlib
import hashlib
import os
import pathlib
import random
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse

import boto3
import numpy
import requests
from tusclient.client import TusClient
from tusclient.uploader import Uploader

ROOT = pathlib.Path(__file__).resolve().parents[2]
BINARY = os.environ.get("LAMPWRIGHT", str(ROOT / "target/debug/lampwright"))
HEADER_BYTES, RAY_BYTES = 208, 28
# Longest wait for anything, on a machine busy with others, s.
PATIENCE_S = 1800
# Uploads that may be over before a kill comes, for each kill.
TRIES = 20


def ray_file(path, mib):
    """A Zemax binary source file of about so many MiB, after the vendor's format page; its SHA-256."""
    rays = ((mib << 20) - HEADER_BYTES) // RAY_BYTES
    header = bytearray(HEADER_BYTES)

    def word(at, value, kind):
        header[at : at + 4] = numpy.array([value], dtype=kind).tobytes()

    word(0, 1010, "<i4")
    word(4, rays, "<u4")
    header[8:12] = b"test"
    word(108, rays, "<f4")
    word(112, rays, "<f4")
    word(116, 0.55, "<f4")
    word(136, 4, "<i4")
    digest = hashlib.sha256(header)
    with open(path, "wb") as file:
        file.write(header)
        for first in range(0, rays, 1 << 20):
            number = numpy.arange(first, min(rays, first + (1 << 20)))
            ray = numpy.zeros((len(number), 7), dtype="<f4")
            ray[:, 0] = (number % 997) / 997
            ray[:, 1] = (number % 991) / 991
            ray[:, 5:] = 1
            digest.update(ray.tobytes())
            file.write(ray.tobytes())
    return digest.hexdigest()


def free_port():
    """A port that no client gets as its own while the server is dead: below those the system hands out."""
    while True:
        port = random.randrange(10_000, 32_000)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
                return port
            except OSError:
                continue


class Node:
    """A server on an address of its own, which it keeps when it is started again; killed at the end, whatever that is."""

    def __init__(self, folder):
        self.folder, self.process, self.address = folder, None, None
        atexit.register(self.kill)
        while self.address is None:
            self.address = f"127.0.0.1:{free_port()}"
            self.start(is_first=True)

    def start(self, is_first=False):
        """Returns once it answers. Where somebody was faster at a port that was free, the first start takes another."""
        # Kills are this test's doing, not the upload's; a lease of a second, so that nobody waits for the dead.
        command = [BINARY, "serve", "--listen", self.address, "--data", str(self.folder), "--role", "api", "--no-sample"]
        command += ["--attempts", "1000", "--lease", "1", "--log", "warn"]
        if "TEST_DATABASE_URL" in os.environ:
            command += ["--database-url", os.environ["TEST_DATABASE_URL"], "--storage-url", storage_url()]
        log = open(self.folder.parent / "server.log", "ab")
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log)
        wait_for("a server", lambda: self.process.poll() is not None or self.answers())
        if self.process.poll() is not None:
            told = (self.folder.parent / "server.log").read_text()[-4000:]
            if not is_first or "cannot listen on" not in told:
                sys.exit(f"the server ended: {told}")
            self.address = None

    def answers(self):
        try:
            return requests.get(f"http://{self.address}/readyz", timeout=10).status_code == 200
        except requests.RequestException:
            return False

    def kill(self):
        if self.process is not None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()

    def get(self, path):
        """The JSON at a path; None when no answer came."""
        try:
            answer = requests.get(f"http://{self.address}{path}", timeout=60)
        except requests.RequestException:
            return None
        return answer.json() if answer.status_code == 200 else None


def storage_url():
    return os.environ["TEST_STORAGE_URL"] + "/tus"


def wait_for(what, found):
    start = time.monotonic()
    while not (answer := found()):
        if time.monotonic() - start > PATIENCE_S:
            sys.exit(f"still waiting for {what}")
        time.sleep(0.02)
    return answer


class Sending(threading.Thread):
    """tuspy at work; goes on after every failure, as often as it is told to."""

    def __init__(self, address, path, retries, chunk_bytes, url=None):
        super().__init__(daemon=True)
        client = TusClient(f"http://{address}/v1/uploads")
        self.uploader = Uploader(
            str(path),
            client=client,
            url=url,
            chunk_size=chunk_bytes,
            retries=retries,
            retry_delay=0.1,
            upload_checksum=False,
            metadata={"filename": path.name, "length_unit": "mm", "quantity": "radiant"},
        )
        if url is None:
            self.uploader.set_url(self.uploader.create_url())
        self.path = urllib.parse.urlparse(self.uploader.url).path
        self.failure = None
        self.start()

    def run(self):
        try:
            self.uploader.upload()
        except Exception as failure:  # whatever it is, it is the test's finding
            self.failure = failure


def named_parts(ray_set, folder):
    """Keys of the blobs that the rows of a ray set name, in order, read past the service."""
    if "TEST_DATABASE_URL" not in os.environ:
        with contextlib.closing(sqlite3.connect(f"file:{folder / 'service.db'}?mode=ro", uri=True)) as database:
            rows = database.execute("SELECT blob FROM parts WHERE ray_set_id = ? ORDER BY number", [ray_set])
            return [blob for (blob,) in rows]
    command = ["psql", "--no-psqlrc", "--tuples-only", "--no-align", "--set=ON_ERROR_STOP=1", f"--set=id={ray_set}"]
    query = "SELECT blob FROM parts WHERE ray_set_id = :'id' ORDER BY number"
    asked = subprocess.run(
        [*command, os.environ["TEST_DATABASE_URL"]], input=query, check=True, capture_output=True, text=True
    )
    return asked.stdout.split()


class Store:
    """The object store past the service: the folder of blobs, or the bucket."""

    def __init__(self, folder):
        self.folder, self.bucket = folder / "blobs", None
        if "TEST_DATABASE_URL" in os.environ:
            place = urllib.parse.urlparse(storage_url())
            self.bucket, self.prefix = place.netloc, place.path.strip("/")
            address = {"endpoint_url": os.environ["AWS_ENDPOINT_URL"], "region_name": os.environ["AWS_REGION"]}
            self.s3 = boto3.client("s3", **address)

    def read(self, key):
        if self.bucket is None:
            return (self.folder / key).read_bytes()
        return self.s3.get_object(Bucket=self.bucket, Key=f"{self.prefix}/{key}")["Body"].read()

    def write(self, key, content):
        if self.bucket is None:
            (self.folder / key).write_bytes(content)
        else:
            self.s3.put_object(Bucket=self.bucket, Key=f"{self.prefix}/{key}", Body=content)


def stored_digest(ray_set, folder):
    """SHA-256 of the parts of a ray set, read past the service. What a killed session left beside them is no part of it: the
    service sweeps it away later, and only the rows say which blobs are parts."""
    store, parts = Store(folder), named_parts(ray_set, folder)
    # A session that is killed between a part's bytes and its row leaves such a blob. Whether one of this run's kills did is
    # chance; so there is always one, between the first part and the second.
    store.write(parts[0] + "-of-a-killed-session", b"no part of the ray set")
    digest = hashlib.sha256()
    for part in parts:
        digest.update(store.read(part))
    return digest.hexdigest()


def judge(node, path, expected, byte_count):
    """Waits for the end of an upload and holds it to what was sent."""

    def ended():
        upload = node.get(path)
        return upload if upload and upload["state"] in ("taken", "refused") else None

    upload = wait_for("the end of the upload", ended)
    if upload["state"] != "taken":
        sys.exit(f"refused: {upload}")
    [ray_set] = upload["ray_sets"]
    told = node.get(f"/v1/ray-sets/{ray_set}")
    found = (told["sha256"], told["byte_count"], stored_digest(ray_set, node.folder))
    if found != (expected, byte_count, expected):
        sys.exit(f"sent {expected} of {byte_count} bytes, kept {found}")
    if len(node.get("/v1/ray-sets")["ray_sets"]) != 1:
        sys.exit("it was taken more than once")
    requests.delete(f"http://{node.address}/v1/ray-sets/{ray_set}", timeout=60).raise_for_status()


def killed(folder, file, expected, kills, chance):
    """One server, killed at random moments while a file is sent, and once when all of it is there. How many kills fit into one
    upload is for the machine to say: what is over before its last kill is judged, and the rest of the kills meet another upload."""
    node, byte_count = Node(folder), file.stat().st_size
    moments = sorted(chance.uniform(0, 0.9) * byte_count for _ in range(kills - 1)) + [byte_count]
    start, offsets, uploads = time.monotonic(), [], 0
    while moments:
        if uploads == TRIES * kills:
            sys.exit(f"{uploads} uploads were over before all kills were done: send more")
        uploads += 1
        sending = Sending(node.address, file, 100_000, 64 << 20)
        while moments and (kept := reached(node, sending, moments[0], offsets)) is not None:
            time.sleep(chance.uniform(0, 0.02))
            node.kill()
            offsets.append(kept)
            moments.pop(0)
            node.start()
        offsets.append(None)
        sending.join(PATIENCE_S)
        if sending.failure or sending.is_alive():
            sys.exit(f"tuspy did not come to its end: {sending.failure!r}")
        judge(node, sending.path, expected, byte_count)
    took = time.monotonic() - start
    told = [offset >> 20 for offset in offsets if offset is not None]
    print(f"{byte_count} bytes in {uploads} uploads through {kills} kills in {took:.1f} s, SHA-256 equal; killed at MiB {told}")
    node.kill()


def reached(node, sending, moment, offsets):
    """Waits until an upload has come so far; its offset, or None when it was over before."""

    def far_enough():
        if sending.failure:
            sys.exit(f"tuspy gave up: {sending.failure!r}")
        upload = node.get(sending.path)
        return upload if upload and (upload["offset"] >= moment or upload["state"] == "taken") else None

    upload = wait_for("bytes to come", far_enough)
    least = (offsets or [None])[-1] or 0
    if upload["offset"] < least:
        sys.exit(f"{least} bytes were there, and now {upload['offset']}")
    return None if upload["state"] == "taken" else upload["offset"]


def moved(work, file, expected, chance):
    """Begun on node A, which dies; finished on node B. An upload that was over before A died is judged, and another begun."""
    for name in "ab":
        (work / name / "data").mkdir(parents=True)
    byte_count = file.stat().st_size
    first, second = Node(work / "a/data"), Node(work / "b/data")
    for _ in range(TRIES):
        sending = Sending(first.address, file, 0, byte_count)
        moment = chance.uniform(0.2, 0.6) * byte_count
        wait_for("bytes to come", lambda: (first.get(sending.path) or {"offset": 0})["offset"] >= moment)
        first.kill()
        sending.join(PATIENCE_S)
        kept = second.get(sending.path)["offset"]
        if kept < moment:
            sys.exit(f"node A told of {moment} bytes, node B has {kept}")
        if kept < byte_count:
            # What node A asked the database for last may be done after its death, and after B has told an offset: 409, and a look again.
            rest = Sending(second.address, file, 10, 64 << 20, f"http://{second.address}{sending.path}")
            rest.join(PATIENCE_S)
            if rest.failure or rest.is_alive():
                sys.exit(f"tuspy did not come to its end: {rest.failure!r}")
        judge(second, sending.path, expected, byte_count)
        if kept < byte_count:
            print(f"{byte_count} bytes begun on node A, killed at {kept}, finished on node B, SHA-256 equal")
            return
        first.start()
    sys.exit(f"{TRIES} uploads were over before node A was killed: send more")


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--mib", type=int, default=64)
    arguments.add_argument("--kills", type=int, default=3)
    arguments.add_argument("--seed", type=int, default=None)
    chosen = arguments.parse_args()
    seed = random.SystemRandom().randrange(1 << 32) if chosen.seed is None else chosen.seed
    print(f"seed {seed}", flush=True)
    chance = random.Random(seed)
    for name in [name for name in os.environ if re.match("LAMPWRIGHT_|(DATABASE|STORAGE)_URL$|ROLE$", name)]:
        del os.environ[name]
    work = pathlib.Path(tempfile.mkdtemp(prefix="tus-"))
    # What is registered last is done first: the servers die before their folder goes.
    atexit.register(shutil.rmtree, work)
    file = work / "sent.dat"
    expected = ray_file(file, chosen.mib)
    (work / "data").mkdir()
    killed(work / "data", file, expected, chosen.kills, chance)
    if "TEST_DATABASE_URL" in os.environ:
        moved(work, file, expected, chance)
    else:
        print("From node to node: only with tests/engines/with.")


main()
