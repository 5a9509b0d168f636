"""Sends a ray file with tuspy to a server that dies again and again, and compares what is kept with hashlib's digest."""

import argparse
import atexit
import hashlib
import os
import pathlib
import random
import re
import shutil
import signal
import socket
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
        self.folder = folder
        self.address = f"127.0.0.1:{free_port()}"
        self.start()
        atexit.register(self.kill)

    def start(self):
        # Kills are this test's doing, not the upload's; a lease of a second, so that nobody waits for the dead.
        command = [BINARY, "serve", "--listen", self.address, "--data", str(self.folder), "--role", "api", "--no-sample"]
        command += ["--attempts", "1000", "--lease", "1", "--log", "warn"]
        if "TEST_DATABASE_URL" in os.environ:
            command += ["--database-url", os.environ["TEST_DATABASE_URL"], "--storage-url", storage_url()]
        log = open(self.folder.parent / "server.log", "ab")
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log)
        wait_for("a server", self.answers)

    def answers(self):
        if self.process.poll() is not None:
            sys.exit(f"the server ended: {(self.folder.parent / 'server.log').read_text()[-4000:]}")
        try:
            return requests.get(f"http://{self.address}/readyz", timeout=10).status_code == 200
        except requests.RequestException:
            return False

    def kill(self):
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


def stored_digest(ray_set, folder):
    """SHA-256 of the parts of a ray set, read past the service."""
    digest, prefix = hashlib.sha256(), f"ray-sets/{ray_set}/"
    if "TEST_DATABASE_URL" not in os.environ:
        for part in sorted((folder / "blobs" / prefix).iterdir()):
            with open(part, "rb") as file:
                while block := file.read(1 << 20):
                    digest.update(block)
        return digest.hexdigest()
    place = urllib.parse.urlparse(storage_url())
    store = boto3.client("s3", endpoint_url=os.environ["AWS_ENDPOINT_URL"], region_name=os.environ["AWS_REGION"])
    pages = store.get_paginator("list_objects_v2").paginate(Bucket=place.netloc, Prefix=place.path.strip("/") + "/" + prefix)
    for key in sorted(item["Key"] for page in pages for item in page.get("Contents", [])):
        digest.update(store.get_object(Bucket=place.netloc, Key=key)["Body"].read())
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
    """One server, killed at random moments while a file is sent, and once when all of it is there."""
    node, byte_count = Node(folder), file.stat().st_size
    start = time.monotonic()
    sending = Sending(node.address, file, 100_000, 64 << 20)
    moments = sorted(chance.uniform(0, 0.9) * byte_count for _ in range(kills - 1)) + [byte_count]
    offsets, least = [], 0
    for moment in moments:

        def reached():
            if sending.failure:
                sys.exit(f"tuspy gave up: {sending.failure!r}")
            upload = node.get(sending.path)
            return upload if upload and upload["offset"] >= moment else None

        upload = wait_for("bytes to come", reached)
        if upload["state"] == "taken":
            sys.exit("the upload was over before all kills were done: send more")
        if upload["offset"] < least:
            sys.exit(f"{least} bytes were there, and now {upload['offset']}")
        least = upload["offset"]
        time.sleep(chance.uniform(0, 0.02))
        node.kill()
        offsets.append(least >> 20)
        node.start()
    sending.join(PATIENCE_S)
    if sending.failure or sending.is_alive():
        sys.exit(f"tuspy did not come to its end: {sending.failure!r}")
    judge(node, sending.path, expected, byte_count)
    took = time.monotonic() - start
    print(f"{byte_count} bytes through {kills} kills in {took:.1f} s, SHA-256 equal; killed at MiB {offsets}")
    node.kill()


def moved(work, file, expected, chance):
    """Begun on node A, which dies; finished on node B."""
    for name in "ab":
        (work / name / "data").mkdir(parents=True)
    byte_count = file.stat().st_size
    first = Node(work / "a/data")
    sending = Sending(first.address, file, 0, byte_count)
    moment = chance.uniform(0.2, 0.6) * byte_count
    wait_for("bytes to come", lambda: (first.get(sending.path) or {"offset": 0})["offset"] >= moment)
    first.kill()
    sending.join(PATIENCE_S)
    if sending.failure is None:
        sys.exit("the upload was over before node A was killed: send more")
    second = Node(work / "b/data")
    kept = second.get(sending.path)["offset"]
    if not moment <= kept < byte_count:
        sys.exit(f"node B has {kept} bytes")
    rest = Sending(second.address, file, 0, 64 << 20, f"http://{second.address}{sending.path}")
    rest.join(PATIENCE_S)
    if rest.failure or rest.is_alive():
        sys.exit(f"tuspy did not come to its end: {rest.failure!r}")
    judge(second, sending.path, expected, byte_count)
    print(f"{byte_count} bytes begun on node A, killed at {kept}, finished on node B, SHA-256 equal")


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
