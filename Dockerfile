# syntax=docker/dockerfile:1
FROM rust:1.95-slim-bookworm AS build
WORKDIR /build
COPY . .
# Both caches outlive the layer, so a change of ours does not build 250 crates again.
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    --mount=type=cache,target=/build/target \
    cargo build --release --locked && cp target/release/lampwright /lampwright && mkdir /data

# No shell, no package manager; uid 65532.
FROM gcr.io/distroless/cc-debian12:nonroot
COPY --from=build /lampwright /usr/local/bin/lampwright
COPY --from=build --chown=nonroot:nonroot /data /data
VOLUME /data
EXPOSE 8080
ENV LAMPWRIGHT_LISTEN=0.0.0.0:8080 LAMPWRIGHT_DATA=/data
HEALTHCHECK --interval=15s --timeout=5s --start-period=10s --retries=3 CMD ["/usr/local/bin/lampwright", "health"]
ENTRYPOINT ["/usr/local/bin/lampwright"]
CMD ["serve"]
