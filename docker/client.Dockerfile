# cairn-client in a small image.   docker build -f docker/client.Dockerfile -t cairn-client .
FROM debian:12-slim AS build
WORKDIR /src
COPY dev .ci/packages.txt ./
RUN mkdir -p .ci && mv packages.txt .ci/ && ./dev deps
COPY . .
RUN cmake --preset release -DCAIRN_TESTS=OFF \
 && cmake --build --preset release --target cairn-client \
 && docker/runtime_packages.sh build/release/bin/cairn-client > /packages.txt

FROM debian:12-slim
COPY --from=build /packages.txt /packages.txt
RUN apt-get update -q \
 && xargs -a /packages.txt apt-get install -y -q --no-install-recommends \
 && rm -rf /var/lib/apt/lists/* /packages.txt \
 && useradd --system --uid 10001 cairn \
 && install -d -o cairn /var/lib/cairn
COPY --from=build /src/build/release/bin/cairn-client /usr/local/bin/
COPY config /etc/cairn
USER cairn
# The outbox lives here: keep it on a volume, so that keyframes survive the container.
WORKDIR /var/lib/cairn
VOLUME /var/lib/cairn
STOPSIGNAL SIGTERM
ENTRYPOINT ["cairn-client"]
CMD ["--help"]
