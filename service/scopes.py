"""What an access key can allow."""

from __future__ import annotations

from typing import Literal, get_args

Scope = Literal["answer", "train", "manage"]
SCOPES: tuple[Scope, ...] = get_args(Scope)
