# The worker: takes training jobs, simulates with SAPIEN on Mesa's software Vulkan driver, publishes models.
#   docker build --file docker/worker.Dockerfile --tag shape-concepts-worker .
# worker.Dockerfile.dockerignore says what of the repository the build sees.

FROM debian:trixie-slim AS build
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates python3-venv \
    && rm -rf /var/lib/apt/lists/*
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /src
COPY docker/constraints.txt docker/
RUN python3 -m venv /opt/build \
    && /opt/build/bin/pip install --constraint docker/constraints.txt setuptools \
    && python3 -m venv --without-pip /opt/shape-concepts
# The libraries first: a change of the source does not fetch them again.
COPY pyproject.toml docker/requirements.py ./
RUN python3 requirements.py worker > requirements.txt \
    && /opt/build/bin/pip --python /opt/shape-concepts/bin/python install \
       --constraint docker/constraints.txt --requirement requirements.txt
COPY README.md LICENSE ./
COPY service service
COPY worker worker
RUN /opt/build/bin/pip wheel --no-deps --no-build-isolation --wheel-dir wheels . \
    && /opt/build/bin/pip --python /opt/shape-concepts/bin/python install --no-deps --no-index wheels/*.whl

FROM debian:trixie-slim
LABEL org.opencontainers.image.title="Shape Concepts: worker" org.opencontainers.image.licenses="MIT"
# What Open3D links to, and what SAPIEN renders with on any processor.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates python3 \
       libegl1 libgl1 libgomp1 libidn2-0 libusb-1.0-0 libx11-6 libvulkan1 mesa-vulkan-drivers \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --system --uid 10001 --user-group --home-dir /data --shell /usr/sbin/nologin shape-concepts \
    && install --directory --owner=10001 --group=10001 /data /var/cache/shape-concepts
COPY --from=build /opt/shape-concepts /opt/shape-concepts
COPY docker/compile_kernels.py /opt/shape-concepts/share/
# Kernels are compiled for every processor of the architecture, not for the one that builds the image.
ENV PATH=/opt/shape-concepts/bin:/usr/local/bin:/usr/bin:/bin \
    PYTHONDONTWRITEBYTECODE=1 \
    NUMBA_CACHE_DIR=/var/cache/shape-concepts \
    NUMBA_CPU_NAME=generic \
    NUMBA_CPU_FEATURES="" \
    XDG_DATA_HOME=/data
USER 10001:10001
WORKDIR /data
RUN python /opt/shape-concepts/share/compile_kernels.py
VOLUME /data
STOPSIGNAL SIGTERM
# A worker that died is seen without it; this one sees whether the queue is within reach.
HEALTHCHECK --interval=60s --timeout=20s --start-period=60s CMD ["shape-concepts", "jobs", "list", "--limit", "1"]
ENTRYPOINT ["shape-concepts-worker"]
CMD ["run"]
