# The service: answers clouds over REST, gRPC and zenoh. Without the worker, Open3D and SAPIEN.
#   docker build --file docker/api.Dockerfile --tag shape-concepts-api .
# api.Dockerfile.dockerignore says what of the repository the build sees.

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
RUN python3 requirements.py jobs traces > requirements.txt \
    && /opt/build/bin/pip --python /opt/shape-concepts/bin/python install \
       --constraint docker/constraints.txt --requirement requirements.txt
COPY README.md LICENSE ./
COPY service service
RUN /opt/build/bin/pip wheel --no-deps --no-build-isolation --wheel-dir wheels . \
    && /opt/build/bin/pip --python /opt/shape-concepts/bin/python install --no-deps --no-index wheels/*.whl

FROM debian:trixie-slim
LABEL org.opencontainers.image.title="Shape Concepts: service" org.opencontainers.image.licenses="MIT"
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates python3 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --system --uid 10001 --user-group --home-dir /data --shell /usr/sbin/nologin shape-concepts \
    && install --directory --owner=10001 --group=10001 /data /var/cache/shape-concepts
COPY --from=build /opt/shape-concepts /opt/shape-concepts
COPY docker/health.py docker/compile_kernels.py docker/copy_store.py /opt/shape-concepts/share/
# Kernels are compiled for every processor of the architecture, not for the one that builds the image.
ENV PATH=/opt/shape-concepts/bin:/usr/local/bin:/usr/bin:/bin \
    PYTHONDONTWRITEBYTECODE=1 \
    NUMBA_CACHE_DIR=/var/cache/shape-concepts \
    NUMBA_CPU_NAME=generic \
    NUMBA_CPU_FEATURES="" \
    XDG_DATA_HOME=/data \
    SHAPE_CONCEPTS_HOST=0.0.0.0 \
    SHAPE_CONCEPTS_LOG_FORMAT=json
USER 10001:10001
WORKDIR /data
RUN python /opt/shape-concepts/share/compile_kernels.py
VOLUME /data
EXPOSE 8000 8001
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=5s --start-period=30s CMD ["python", "/opt/shape-concepts/share/health.py"]
ENTRYPOINT ["shape-concepts"]
CMD ["serve"]
