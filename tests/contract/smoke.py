"""`smoke.py URL KEY RAYS`: a client that openapi-python-client has generated does what a client does."""

import base64
import io
import sys
import time
import uuid
import zipfile
from pathlib import Path

from lampwright_client import AuthenticatedClient
from lampwright_client.api.artifacts import get_artifact, get_zip, list_artifacts
from lampwright_client.api.health import metrics
from lampwright_client.api.jobs import create_job, delete_job, get_job, list_jobs
from lampwright_client.api.ray_sets import get_origins_drawing, list_ray_sets, upload_ray_set
from lampwright_client.api.uploads import append_to_upload, create_upload, get_upload
from lampwright_client.models import (
    ArtifactList,
    Channel,
    ChannelFluxLuminousLm,
    GoniogramOptions,
    Job,
    JobList,
    JobOptions,
    NewJob,
    Problem,
    RaySetList,
    State,
    Taken,
    Upload,
    Zones,
)
from lampwright_client.types import File

url, key, rays = sys.argv[1:]
client = AuthenticatedClient(base_url=url, token=key, raise_on_unexpected_status=True)

with open(rays, "rb") as file:
    taken = upload_ray_set.sync(client=client, body=File(file), name="chip.tm25ray")
assert isinstance(taken, Taken) and len(taken.ray_sets) == 1, taken
ray_set = taken.ray_sets[0]
assert (ray_set.name, ray_set.byte_count) == ("chip.tm25ray", Path(rays).stat().st_size), ray_set

options = JobOptions(goniogram=GoniogramOptions(zones=Zones(columns=2, rows=1)))
channel = Channel(ray_set=ray_set.id, flux=ChannelFluxLuminousLm(12.5))
job = create_job.sync(client=client, body=NewJob(channels=[channel], options=options))
assert isinstance(job, Job) and job.finished_ms is None, job
deadline = time.monotonic() + 240
while job.state in (State.QUEUED, State.RUNNING):
    assert time.monotonic() < deadline, job
    time.sleep(0.1)
    job = get_job.sync(str(job.id), client=client)
    assert isinstance(job, Job), job
assert job.state == State.SUCCEEDED and job.problem is None and job.progress == 1, job
assert job.options.goniogram.zones == Zones(columns=2, rows=1), job.options
assert job.channels[0].flux == ChannelFluxLuminousLm(12.5), job.channels

listed = list_artifacts.sync(str(job.id), client=client)
assert isinstance(listed, ArtifactList), listed
packed = get_zip.sync(str(job.id), client=client)
assert isinstance(packed, File), packed
names = zipfile.ZipFile(io.BytesIO(packed.payload.read())).namelist()
assert [artifact.name for artifact in listed.artifacts] == names, (listed, names)
# A name with a slash in it, and the bytes that were promised.
ies = next(artifact for artifact in listed.artifacts if artifact.name == "ies/total.ies")
assert len(get_artifact.sync(str(job.id), ies.name, client=client).payload.read()) == ies.byte_count
assert get_origins_drawing.sync(str(ray_set.id), client=client).payload.read().startswith(b"<svg")
assert "lampwright_" in metrics.sync(client=client)

# A file in two requests, with what the client says of it.
half = Path(rays).stat().st_size // 2
whole = Path(rays).read_bytes()
said = base64.b64encode(b'{"order":"4711"}').decode()
begun = create_upload.sync_detailed(
    client=client, body=File(io.BytesIO(whole[:half])), tus_resumable="1.0.0", upload_length=len(whole),
    upload_metadata=f"metadata {said}",
)
assert begun.status_code == 201, begun
upload = begun.headers["Location"].rsplit("/", 1)[1]
added = append_to_upload.sync_detailed(
    upload, client=client, body=File(io.BytesIO(whole[half:])), tus_resumable="1.0.0", upload_offset=half
)
assert (added.status_code, added.headers["Upload-Offset"]) == (204, str(len(whole))), added
known = get_upload.sync(upload, client=client)
assert isinstance(known, Upload) and known.metadata["order"] == "4711" and known.state == "taken", known
found = list_ray_sets.sync(client=client, metadata='{"order":"4711"}')
assert [one.id for one in found.ray_sets] == [uuid.UUID(known.ray_sets[0])], found

ray_sets = list_ray_sets.sync(client=client, name="chip.tm25ray", limit=1)
assert isinstance(ray_sets, RaySetList) and [one.id for one in ray_sets.ray_sets] == [ray_set.id], ray_sets
jobs = list_jobs.sync(client=client, state=[State.SUCCEEDED])
assert isinstance(jobs, JobList) and [one.id for one in jobs.jobs] == [job.id] and jobs.next_ is None, jobs

missing = get_job.sync("00000000-0000-7000-8000-000000000000", client=client)
assert isinstance(missing, Problem) and (missing.status, missing.code) == (404, "job.not_found"), missing
stranger = list_jobs.sync(client=AuthenticatedClient(base_url=url, token="lw_0_0"))
assert isinstance(stranger, Problem) and stranger.status == 401, stranger
assert delete_job.sync_detailed(str(job.id), client=client).status_code == 204
