# The four programs as images; deploy/README.md tells how to run them. The plain `docker build` of
# Debian's docker.io will do: BuildKit is not needed.
#
#   docker build --target coordinator -t isoscope-coordinator .
#   docker build --target agent -t isoscope-agent .
#   docker build --target gateway -t isoscope-gateway .
#   docker build --target cli-cpu -t isoscope .         # draws by the CPU; `cli` has Mesa and isoscope-bench, too
#   docker run --rm -p 127.0.0.1:8080:8080 -v "$PWD:/data" isoscope view /data/head.nii.gz
#
# BASE_IMAGE may name any Debian 12 image (--build-arg BASE_IMAGE=...). Without Git the programs have CMake's version;
# --build-arg ISOSCOPE_VERSION="$(scripts/version.sh)" gives them that of the commit.
ARG BASE_IMAGE=debian:bookworm-slim

FROM ${BASE_IMAGE} AS build
WORKDIR /src
COPY scripts/packages.sh scripts/packages.sh
RUN bash -euc '. scripts/packages.sh; install_packages "${ISOSCOPE_BUILD_PACKAGES[@]}"; apt-get clean'
COPY . .
ARG ISOSCOPE_VERSION
RUN bash scripts/build.sh && strip build/release/bin/isoscope* build/release/lib/isoscope/*.so

# Packages of the coordinator and the gateway: neither geometry nor OpenGL.
FROM ${BASE_IMAGE} AS runtime
COPY scripts/packages.sh /usr/share/isoscope/
RUN bash -euc '. /usr/share/isoscope/packages.sh; install_packages "${ISOSCOPE_RUNTIME_PACKAGES[@]}"; \
    apt-get clean; rm -rf /var/lib/apt/lists/*' \
 && useradd --system --create-home --uid 10001 isoscope
LABEL org.opencontainers.image.title="Isoscope" \
      org.opencontainers.image.description="Isosurfaces of volumes too large for one machine, as a gRPC service" \
      org.opencontainers.image.licenses="Apache-2.0"

# OpenGL: a GPU's driver comes from the engine, Mesa's software one (most of this stage's size) from
# here. Its shader cache has no place on a read-only root file system.
FROM runtime AS rendering
ENV MESA_SHADER_CACHE_DISABLE=true
RUN bash -euc '. /usr/share/isoscope/packages.sh; install_packages "${ISOSCOPE_RENDERING_PACKAGES[@]}"; \
    apt-get clean; rm -rf /var/lib/apt/lists/*'

# The health checks below ask the program whether it serves. They take its address and its certificates
# from the environment (ISOSCOPE_LISTEN, ISOSCOPE_TLS_*), so set these there and not as options.
FROM runtime AS coordinator
COPY --from=build /src/build/release/bin/isoscope-coordinator /usr/local/bin/
ARG ISOSCOPE_VERSION
LABEL org.opencontainers.image.version="$ISOSCOPE_VERSION"
ENV ISOSCOPE_LISTEN=0.0.0.0:50051
EXPOSE 50051
HEALTHCHECK --interval=10s --timeout=5s --start-period=10s \
  CMD ["isoscope-coordinator", "--probe"]
USER isoscope
ENTRYPOINT ["isoscope-coordinator"]

# In a container the loopback address is unreachable from outside. So the programs need certificates (ISOSCOPE_TLS_*),
# or ISOSCOPE_INSECURE=true in a private network. The gateway requires a token: that of ISOSCOPE_GATEWAY_TOKEN, or one
# from its log.
FROM runtime AS gateway
RUN bash -euc '. /usr/share/isoscope/packages.sh; install_packages "${ISOSCOPE_GATEWAY_PACKAGES[@]}"; \
    apt-get clean; rm -rf /var/lib/apt/lists/*'
COPY --from=build /src/build/release/bin/isoscope-gateway /usr/local/bin/
ARG ISOSCOPE_VERSION
LABEL org.opencontainers.image.version="$ISOSCOPE_VERSION"
ENV ISOSCOPE_LISTEN=0.0.0.0:8080
EXPOSE 8080
HEALTHCHECK --interval=10s --timeout=5s --start-period=10s \
  CMD ["isoscope-gateway", "--probe"]
USER isoscope
ENTRYPOINT ["isoscope-gateway"]

# It reads the sources of index-only datasets.
FROM rendering AS agent
RUN bash -euc '. /usr/share/isoscope/packages.sh; install_packages "${ISOSCOPE_SOURCE_PACKAGES[@]}"; \
    apt-get clean; rm -rf /var/lib/apt/lists/*'
COPY --from=build /src/build/release/bin/isoscope-agent /usr/local/bin/
ARG ISOSCOPE_VERSION
LABEL org.opencontainers.image.version="$ISOSCOPE_VERSION"
ENV ISOSCOPE_LISTEN=0.0.0.0:50052
EXPOSE 50052
HEALTHCHECK --interval=10s --timeout=5s --start-period=10s \
  CMD ["isoscope-agent", "--probe"]
USER isoscope
ENTRYPOINT ["isoscope-agent"]
CMD ["--shard", "/shard"]

# isoscope alone, without Mesa and OpenVDB. The page of `isoscope view` is for the engine to publish, and its address is
# that of the engine's host; for another port than 8080: -e ISOSCOPE_VIEW_PUBLISHED=localhost:9000
# -p 127.0.0.1:9000:9000.
FROM runtime AS cli-cpu
# Nothing here reads GDCM's rules of information objects, nor X11's names of keys.
RUN bash -euc '. /usr/share/isoscope/packages.sh; install_packages libepoxy0 "${ISOSCOPE_SOURCE_PACKAGES[@]}"; \
    apt-get clean; rm -rf /var/lib/apt/lists/* /usr/share/gdcm-3.0 /usr/share/X11'
COPY --from=build /src/build/release/bin/isoscope /usr/local/bin/
COPY --from=build /src/build/release/lib/isoscope/isoscope_dicom.so /usr/local/lib/isoscope/
ARG ISOSCOPE_VERSION
LABEL org.opencontainers.image.version="$ISOSCOPE_VERSION"
ENV ISOSCOPE_VIEW_PUBLISHED=localhost:8080
EXPOSE 8080
USER isoscope
WORKDIR /data
ENTRYPOINT ["isoscope"]

FROM rendering AS cli
RUN bash -euc '. /usr/share/isoscope/packages.sh; install_packages "${ISOSCOPE_SOURCE_PACKAGES[@]}" \
      "${ISOSCOPE_VDB_PACKAGES[@]}"; \
    apt-get clean; rm -rf /var/lib/apt/lists/*'
COPY --from=build /src/build/release/bin/isoscope /src/build/release/bin/isoscope-bench /usr/local/bin/
COPY --from=build /src/build/release/lib/isoscope/ /usr/local/lib/isoscope/
ARG ISOSCOPE_VERSION
LABEL org.opencontainers.image.version="$ISOSCOPE_VERSION"
ENV ISOSCOPE_VIEW_PUBLISHED=localhost:8080
EXPOSE 8080
USER isoscope
WORKDIR /data
ENTRYPOINT ["isoscope"]

# isoscope, the MRI head of Debian's mricron-data, and a folder that a new volume takes its owner from.
FROM cli AS demo
USER root
RUN bash -euc '. /usr/share/isoscope/packages.sh; install_packages "${ISOSCOPE_DEMO_PACKAGES[@]}"; \
    apt-get clean; rm -rf /var/lib/apt/lists/*; chown isoscope /data'
USER isoscope
