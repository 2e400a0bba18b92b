# Builds with the plain `docker build` of Debian's docker.io; BuildKit is not needed.
#
#   docker build --target agent -t isoscope-agent .
#   docker build --target coordinator -t isoscope-coordinator .
#   docker build --target cli -t isoscope .
#
# BASE_IMAGE may name any Debian 12 image.
ARG BASE_IMAGE=debian:bookworm-slim

FROM ${BASE_IMAGE} AS build
ENV DEBIAN_FRONTEND=noninteractive
WORKDIR /src
COPY scripts/packages.sh scripts/packages.sh
RUN bash -c '. scripts/packages.sh && install_packages "${ISOSCOPE_BUILD_PACKAGES[@]}"' && apt-get clean
COPY . .
RUN bash scripts/build.sh

FROM ${BASE_IMAGE} AS runtime
ENV DEBIAN_FRONTEND=noninteractive
COPY scripts/packages.sh /tmp/packages.sh
RUN bash -c '. /tmp/packages.sh && install_packages "${ISOSCOPE_RUNTIME_PACKAGES[@]}"' && apt-get clean && rm -rf /var/lib/apt/lists/* /tmp/packages.sh \
 && useradd --system --create-home --uid 10001 isoscope
USER isoscope
WORKDIR /home/isoscope

FROM runtime AS agent
COPY --from=build /src/build/release/bin/isoscope-agent /usr/local/bin/
EXPOSE 50052
ENTRYPOINT ["isoscope-agent"]

FROM runtime AS coordinator
COPY --from=build /src/build/release/bin/isoscope-coordinator /usr/local/bin/
EXPOSE 50051
ENTRYPOINT ["isoscope-coordinator"]

FROM runtime AS cli
COPY --from=build /src/build/release/bin/isoscope /usr/local/bin/
ENTRYPOINT ["isoscope"]
