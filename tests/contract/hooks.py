"""What schemathesis cannot know from the contract: which bytes are a ray file, and which refusals are about more than form."""

import os
from pathlib import Path

import schemathesis
from hypothesis import strategies
from schemathesis.core.failures import AcceptedNegativeData, MalformedJson, ServerError
from schemathesis.openapi.checks import MissingHeaderNotRejected, RejectedPositiveData

FILES = Path(os.environ["CONTRACT_FILES"])
FITTING = {"upload_ray_set": "rays", "upload_spectrum": "spectra"}
# The contract's own limit for new rays, and how many a request of this test may ask for.
LIMIT_RAYS = 1_000_000_000_000
MOST_RAYS = 10_000
# Codes of refusals that the schema could have told of. All others are about what is in a file, whether a digest is right, or
# whether choices that are well formed go together.
FORM = {
    "request.malformed_json",
    "request.malformed_path",
    "request.missing_field",
    "request.not_found",
    "request.out_of_range",
    "request.unknown_field",
    "request.wrong_type",
}


@schemathesis.hook
def before_generate_body(context, strategy):
    """Files that the route takes, half of the time; what it refuses otherwise."""
    kind = FITTING.get(context.operation.definition.raw.get("operationId"))
    if kind is None:
        return strategy
    files = [path.read_bytes() for path in sorted((FILES / kind).iterdir())]
    return strategies.one_of(strategies.sampled_from(files), strategy)


@schemathesis.hook
def before_call(context, case, kwargs):
    """As many new rays as are asked for are sent: those of a request must fit into the memory of who reads it."""
    if case.operation.definition.raw.get("operationId") != "draw_rays":
        return
    asked = str((case.query or {}).get("count", ""))
    if asked.isdecimal() and MOST_RAYS < int(asked) <= LIMIT_RAYS:
        case.query["count"] = MOST_RAYS


@schemathesis.hook
def filter_failure(context, failure, case, response):
    """A request of the right form may be refused for what it means; for its form it may not. A part of a JSON file is no JSON."""
    if isinstance(failure, MalformedJson) and response.status_code == 206:
        return False
    # tus 1.0: a request in another version is not looked at any further, so that a missing key is not seen.
    if isinstance(failure, MissingHeaderNotRejected) and response.status_code == 412:
        return False
    # A header that nobody knows is to be ignored (RFC 9110, section 5.1).
    if isinstance(failure, AcceptedNegativeData) and "x-schemathesis-unknown-property" in (case.headers or {}):
        return False
    # An address that somebody else does not answer at: a gateway's own status.
    if isinstance(failure, ServerError) and response.status_code == 502:
        return response.json()["code"] != "ingest.unreachable"
    if not isinstance(failure, RejectedPositiveData) or not 400 <= response.status_code < 500:
        return True
    problem = response.json()
    # A text in a query that is JSON itself: the schema of a query has no words for what is in it.
    if problem.get("at") == "metadata" and "metadata" in (case.query or {}):
        return False
    # A schema could say that a switch can only be set; the generator of Python clients knows no such type.
    return problem["code"] in FORM and problem.get("at") != "enabled"
