"""Whether the service in this container can answer clouds: exit code 0 if it says so."""

from __future__ import annotations

import os
import ssl
import sys
import urllib.request

scheme = "https" if os.environ.get("SHAPE_CONCEPTS_TLS_CERTIFICATE") else "http"
address = f"{scheme}://127.0.0.1:{os.environ.get('SHAPE_CONCEPTS_PORT') or 8000}/readyz"
context = ssl._create_unverified_context()  # the certificate is for another name than that of the loopback
try:
    with urllib.request.urlopen(address, timeout=4, context=context if scheme == "https" else None) as answer:
        print(answer.read().decode())
except OSError as error:  # no connection, or 503 while it is not ready
    sys.exit(f"{address}: {error}")
