# syntax=docker/dockerfile:1
# Digests are those of the multi-platform indexes. For a newer one: docker buildx imagetools inspect TAG, then change both.
ARG RUST_IMAGE=rust:1.95-slim-bookworm@sha256:d7482085ff5b415f84dba5647ae71606650bdef00db7aeb69f4b3d170c3e4082
ARG BASE_IMAGE=gcr.io/distroless/cc-debian12:nonroot@sha256:9dac0a79194e45a7da0158a9c6da57b217585af0786db3845d1f0ec1a0dd182f

FROM ${RUST_IMAGE} AS build
WORKDIR /build
# The dependencies are a layer of their own, which only the manifests change: empty sources stand in for ours, and for the
# targets of tests, which Cargo wants to exist.
COPY Cargo.toml Cargo.lock ./
COPY src/pipeline/Cargo.toml src/pipeline/Cargo.toml
COPY src/service/Cargo.toml src/service/build.rs src/service/
COPY tests/support/Cargo.toml tests/support/Cargo.toml
RUN touch src/pipeline/lib.rs src/service/lib.rs tests/support/lib.rs && echo 'fn main() {}' >src/main.rs \
    && sed -n 's/^path = "\(tests\/.*\)"/\1/p' Cargo.toml | while read -r target; do \
        mkdir -p "$(dirname "$target")" && touch "$target"; done \
    && cargo build --release --locked
COPY src src
# Cargo goes by the time of a change, and a checkout may be older than the layer above.
RUN find src -type f -exec touch {} + && cargo build --release --locked \
    && cp target/release/lampwright /lampwright && mkdir /data

# No shell, no package manager. The service runs as user 65532 (nonroot) and writes to /data only: a folder of the host that is
# mounted there must belong to that user (chown -R 65532 FOLDER), or be its owner's (docker run --user "$(id -u):$(id -g)").
FROM ${BASE_IMAGE}
COPY --from=build /lampwright /usr/local/bin/lampwright
COPY --from=build --chown=65532:65532 /data /data
VOLUME /data
EXPOSE 8080
ENV LAMPWRIGHT_LISTEN=0.0.0.0:8080 LAMPWRIGHT_DATA=/data
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=15s --timeout=5s --start-period=10s --retries=3 CMD ["/usr/local/bin/lampwright", "health"]
ENTRYPOINT ["/usr/local/bin/lampwright"]
CMD ["serve"]
# Last, so that they cost no layer: docker build --build-arg VERSION=.. --build-arg REVISION="$(git rev-parse HEAD)".
ARG VERSION=0.1.0
ARG REVISION=unknown
LABEL org.opencontainers.image.title="Lampwright" \
    org.opencontainers.image.description="Turns a light source's ray file into a continuous source model, over HTTP" \
    org.opencontainers.image.source="https://github.com/lampwright/lampwright" \
    org.opencontainers.image.licenses="MIT OR Apache-2.0" \
    org.opencontainers.image.version="${VERSION}" \
    org.opencontainers.image.revision="${REVISION}"
