"""Access keys: objects in the store, so that all replicas share them; of a key's secret only the hash is kept.

Layout, below the store's URL:

    keys/<id>.json      who may do what, and the hash of the secret; never altered
    keys/<id>.revoked   there, and empty, once the key is revoked

A secret has 256 random bits: its plain SHA-256 can be neither guessed nor looked up.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from service.engine.errors import InvalidParameter, KeyNotFound, NotAuthenticated
from service.objects import Objects
from service.scopes import SCOPES, Scope

FOLDER = "keys"
PATTERN = re.compile(r"sc_(?P<id>[0-9a-f]{12})_(?P<secret>[A-Za-z0-9_-]{43})")


class AccessKey(BaseModel):
    """A key as the store has it: all but its secret."""

    model_config = ConfigDict(frozen=True)

    id: str = Field(pattern="^[0-9a-f]{12}$", description="names the key in lists and logs; the part before the secret")
    name: str = Field(min_length=1, max_length=100, description="whose it is")
    scopes: tuple[Scope, ...] = Field(min_length=1, description="what it allows: answer, train, manage")
    sha256: str = Field(description="of the secret, hexadecimal")
    created: datetime = Field(description="UTC")
    rate: float | None = Field(None, gt=0, le=1e6, description="requests and clouds per second; null for no limit")
    concurrency: int | None = Field(None, ge=1, le=10_000, description="requests at the same time; null for no limit")
    max_body: int | None = Field(None, ge=1024, description="largest request body, bytes; null for the service's limit")
    max_points: int | None = Field(None, ge=100, description="largest cloud, points; null for the service's limit")
    max_batch: int | None = Field(None, ge=1, description="largest batch, clouds; null for the service's limit")


class IssuedKey(NamedTuple):
    """A new key: `text` is what its holder sends, told this once."""

    text: str
    key: AccessKey


class KeyStore:
    """The access keys of a store's URL."""

    def __init__(self, url: str | Path) -> None:
        self._objects = Objects(url)
        self._read: dict[str, AccessKey] = {}

    def create(
        self,
        name: str,
        scopes: tuple[Scope, ...],
        rate: float | None = None,
        concurrency: int | None = None,
        *,
        max_body: int | None = None,
        max_points: int | None = None,
        max_batch: int | None = None,
    ) -> IssuedKey:
        """Makes a key.

        Args:
            name: whose it is, 1 to 100 characters.
            scopes: what it allows.
            rate: requests per second that it may make of each replica, each cloud of a batch or a stream counting as
                one; None for no limit.
            concurrency: requests that it may have under way at each replica; None for no limit.
            max_body: largest body of its requests, bytes; None for the service's limit, which holds in any case.
            max_points: largest of its clouds, points; as above.
            max_batch: largest of its batches, clouds; as above.

        Raises:
            InvalidParameter: the name, the scopes or the limits are not of that kind.
        """
        secret = secrets.token_urlsafe(32)
        try:
            key = AccessKey(
                id=secrets.token_hex(6),
                name=name,
                scopes=tuple(scope for scope in SCOPES if scope in scopes),
                sha256=_hash(secret),
                created=datetime.now(UTC).replace(microsecond=0),
                rate=rate,
                concurrency=concurrency,
                max_body=max_body,
                max_points=max_points,
                max_batch=max_batch,
            )
        except ValidationError as error:
            faults = "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors())
            raise InvalidParameter(f"The key cannot be made: {faults}.") from None
        self._objects.create(f"{FOLDER}/{key.id}.json", key.model_dump_json().encode())
        return IssuedKey(f"sc_{key.id}_{secret}", key)

    def revoke(self, key_id: str) -> AccessKey:
        """Makes a key worthless, on every replica within seconds; returns it. A revoked one stays revoked.

        Raises:
            KeyNotFound: there is no such key.
        """
        stored = self._stored()
        if key_id not in stored:
            raise KeyNotFound(f"There is no key {key_id}; shape-concepts keys list shows which there are.")
        self._objects.create(f"{FOLDER}/{key_id}.revoked", b"")
        return stored[key_id]

    def valid(self) -> dict[str, AccessKey]:
        """The keys that are not revoked, by id."""
        revoked = self.revoked()
        return {key_id: key for key_id, key in self._stored().items() if key_id not in revoked}

    def all(self) -> list[AccessKey]:
        """Every key that was ever made, oldest first."""
        return sorted(self._stored().values(), key=lambda key: (key.created, key.id))

    def revoked(self) -> set[str]:
        """The ids of revoked keys."""
        return {
            key[len(FOLDER) + 1 : -len(".revoked")] for key in self._objects.keys(FOLDER) if key.endswith(".revoked")
        }

    def _stored(self) -> dict[str, AccessKey]:
        """Every key by id; each is read from the store once, as it never changes. A damaged one is nobody's."""
        stored = {}
        for path in self._objects.keys(FOLDER):
            key_id = path[len(FOLDER) + 1 : -len(".json")]
            if path.endswith(".json"):
                try:
                    stored[key_id] = self._read.get(key_id) or AccessKey.model_validate_json(self._objects.get(path))
                except (ValidationError, FileNotFoundError):
                    continue
        self._read = stored
        return stored


def authenticate(text: str, valid: Mapping[str, AccessKey]) -> AccessKey:
    """The key that a text is.

    Args:
        text: as a client sent it.
        valid: the keys that are not revoked, by id.

    Raises:
        NotAuthenticated: it is none of them.
    """
    match = PATTERN.fullmatch(text)
    found = valid.get(match["id"]) if match else None
    # compared whether or not there is such a key, so that the time taken tells nothing
    same = hmac.compare_digest(_hash(match["secret"] if match else text), found.sha256 if found else "0" * 64)
    if found is None or not same:
        raise NotAuthenticated("The access key is unknown or revoked; ask the operator of the service for another one.")
    return found


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()
