"""What an operator can set, by environment variables: `SHAPE_CONCEPTS_` and the setting's name in capitals."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, SecretStr
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from service.streams import Stream

MEBIBYTE = 2**20
Listed = Annotated[  # separated by commas in the environment
    tuple[str, ...],
    NoDecode,
    BeforeValidator(
        lambda given: [part.strip() for part in given.split(",") if part.strip()] if isinstance(given, str) else given
    ),
]


def default_store() -> str:
    """The folder `shape-concepts` in the user's data directory, by the custom of the platform."""
    home = Path.home()
    if sys.platform == "darwin":
        base = home / "Library" / "Application Support"
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local"))
    else:
        base = Path(os.environ.get("XDG_DATA_HOME") or home / ".local" / "share")
    return str(base / "shape-concepts")


def default_jobs_url() -> str:
    """The database `jobs.sqlite` in the folder of the default store."""
    return f"sqlite:///{Path(default_store()) / 'jobs.sqlite'}"


class Settings(BaseSettings):
    """Settings of the service; read once, where the process starts, and passed down."""

    model_config = SettingsConfigDict(env_prefix="SHAPE_CONCEPTS_", frozen=True, env_ignore_empty=True)

    store: str = Field(
        default_factory=default_store,
        description="URL of the model store: a folder, file:///folder or s3://bucket/prefix",
    )
    jobs_url: str = Field(
        default_factory=default_jobs_url,
        description="database of the jobs: sqlite:///FILE or postgresql://USER:PASSWORD@HOST/DATABASE",
    )
    cluster: str | None = Field(
        None,
        description="scheduler of the Dask cluster that does the work of training: tcp://HOST:8786; by default this "
        "machine's cores do",
    )
    worker_lease: float = Field(
        30.0,
        ge=3,
        description="after this time without a sign of life a worker is taken for dead, and others take its job over, "
        "seconds",
    )
    built_in: bool = Field(
        True, description="whether the model that comes with the service answers as long as the store holds none"
    )
    model: str | None = Field(
        None,
        description="model that answers requests which name none: NAME, NAME@ALIAS or NAME:VERSION; by default the "
        "only one in the store",
    )
    host: str = Field("127.0.0.1", description="address to listen on; 0.0.0.0 for all of this machine's")
    port: int = Field(8000, ge=0, le=65535, description="TCP port to listen on; 0 for any free one")
    grpc_port: int = Field(8001, ge=-1, le=65535, description="TCP port of gRPC; 0 for any free one, -1 for no gRPC")
    access: Literal["auto", "keys", "open"] = Field(
        "auto",
        description="who may ask: 'keys': holders of access keys; 'open': everybody; 'auto': everybody where only this "
        "machine can reach the address, holders of keys elsewhere",
    )
    tls_certificate: Path | None = Field(None, description="PEM file of the certificate chain for TLS; none: no TLS")
    tls_key: Path | None = Field(None, description="PEM file of the certificate's private key")
    workers: int = Field(
        default_factory=lambda: os.cpu_count() or 1,
        ge=1,
        le=1024,
        description="clouds answered at the same time, threads",
    )
    queue: int = Field(
        32,
        ge=0,
        description="requests of a burst that may wait for a worker before others are refused; where some have waited "
        "all the time, three a worker may, requests",
    )
    max_body: int = Field(128 * MEBIBYTE, ge=1024, description="largest request body, bytes")
    max_bodies: int = Field(
        512 * MEBIBYTE,
        ge=1024,
        description="bytes of all requests' bodies in memory, arriving, waiting or at work; one of max_body is always "
        "taken, bytes",
    )
    body_timeout: float = Field(60.0, gt=0, description="longest time a request's body may take to arrive, seconds")
    body_pause: float = Field(10.0, gt=0, description="longest pause within a request's body, seconds")
    max_archive: int = Field(2048 * MEBIBYTE, ge=1024, description="largest archive of clouds, bytes")
    max_unpacked: int = Field(8192 * MEBIBYTE, ge=1024, description="all files of an archive together, unpacked, bytes")
    max_entries: int = Field(100_000, ge=1, description="files and folders in an archive, entries")
    archive_timeout: float = Field(3600.0, gt=0, description="longest time an archive may take to arrive, seconds")
    max_batch: int = Field(64, ge=1, le=1000, description="largest batch, clouds")
    max_points: int = Field(5_000_000, ge=100, description="largest cloud, points")
    max_objects: int = Field(
        64, ge=1, le=1000, description="objects of a scene that are answered, nearest first, objects"
    )
    loaded_models: int = Field(4, ge=1, description="versions kept in memory, models")
    zenoh_mode: Literal["client", "peer", "router"] | None = Field(
        None, description="what the service is among zenoh nodes; by default a peer if it listens, else a client"
    )
    zenoh_connect: Listed = Field(
        (), description="zenoh endpoints to connect to, separated by commas: tcp/HOST:7447 or tls/HOST:7447"
    )
    zenoh_listen: Listed = Field((), description="zenoh endpoints to listen on, separated by commas")
    zenoh_config: Path | None = Field(
        None, description="configuration file of zenoh (JSON5 or YAML) for all else; the other settings go before it"
    )
    zenoh_user: str | None = Field(None, description="name that zenoh nodes are shown")
    zenoh_password: SecretStr | None = Field(None, description="its password")
    zenoh_ca: Path | None = Field(None, description="certificates (PEM) of the authorities that zenoh nodes must have")
    zenoh_certificate: Path | None = Field(
        None, description="certificate (PEM) shown to zenoh nodes; with zenoh_ca, they must show one as well"
    )
    zenoh_key: Path | None = Field(None, description="private key (PEM) of the certificate")
    streams: tuple[Stream, ...] = Field(
        (), description='clouds that are answered as zenoh brings them, JSON: [{"key": "robots/*/cloud"}]'
    )
    log_format: Literal["text", "json"] = Field(
        "text", description="form of the log's lines: 'text' for people, 'json': one JSON object a line, for programs"
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field("info", description="least severity that is logged")
