"""Where the work of learning and simulating is done: on this machine's cores, or on a Dask cluster.

The stages call joblib and do not know. A cluster must give the same bits, so its workers must run the same software.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from joblib import parallel_config

from service.engine.errors import ClusterUnavailable
from service.model_file import libraries
from worker.processes import end_with

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 10.0  # seconds
FEWEST = 2  # workers of a cluster


@contextmanager
def shared_out(workers: int, cluster: str | None = None, patience: float = PATIENCE) -> Iterator[None]:
    """Whatever runs through `joblib.Parallel` within is done by so many processes here, or by a cluster.

    Args:
        workers: processes of this machine; of no meaning to a cluster, which has as many as it has.
        cluster: address of a Dask scheduler, "tcp://HOST:8786"; None for this machine.
        patience: how long a scheduler, and a worker of it, may take to be there, seconds.

    Raises:
        ClusterUnavailable: Dask is not installed, no scheduler or worker is there, or its workers would give other
            bits.
    """
    if cluster is None:
        with parallel_config(backend="loky", n_jobs=workers, initializer=end_with, initargs=(os.getpid(),)):
            yield
        return
    client = _connect(cluster, patience)
    try:
        _check(client, cluster, patience)
        with parallel_config(backend="dask", client=client):
            yield
    finally:
        client.close(timeout=patience)


def _connect(address: str, patience: float) -> Client:
    try:
        from distributed import Client
    except ImportError as error:
        raise ClusterUnavailable(
            "Dask, which shares work out to a cluster, is not installed here: pip install 'shape-concepts[cluster]'."
        ) from error
    try:
        return Client(address, timeout=patience, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterUnavailable(
            f"No Dask scheduler answers at {address} ({type(error).__name__}). Start one with 'dask scheduler', and "
            "say where it listens, as in --cluster tcp://HOST:8786."
        ) from error


def _check(client: Client, address: str, patience: float) -> None:
    """Sees to it that there are workers, that each runs one thread, and that all run the software that runs here.

    To a single worker joblib would give nothing: it does such work where it is called. Threads of one process would
    change one another's number of threads for linear algebra, on which sums depend.
    """
    try:
        client.wait_for_workers(FEWEST, timeout=patience)
    except TimeoutError as error:
        raise ClusterUnavailable(
            f"The scheduler at {address} has {len(client.nthreads())} workers, and needs {FEWEST}. Start some with "
            f"'dask worker {address} --nworkers N --nthreads 1'."
        ) from error
    threads = client.nthreads()
    if several := sorted(worker for worker, count in threads.items() if count != 1):
        raise ClusterUnavailable(
            f"The worker {several[0]} has {threads[several[0]]} threads; each must have one. Start workers with "
            "'--nworkers N --nthreads 1'."
        )
    ours = libraries()
    for worker, theirs in client.run(libraries, on_error="return").items():
        if isinstance(theirs, BaseException):
            raise ClusterUnavailable(
                f"The worker {worker} cannot run this software ({theirs}). Install the same version of it there, with "
                "the extras worker and cluster."
            )
        if differing := [name for name in ours if theirs.get(name) != ours[name]]:
            told = ", ".join(f"{name} {theirs.get(name, 'none')} instead of {ours[name]}" for name in differing)
            raise ClusterUnavailable(f"The worker {worker} runs other software, and could give other bits: {told}.")
