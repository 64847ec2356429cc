"""Takes part in zenoh for as long as the service runs."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress

import zenoh

from service.application import Application
from service.engine.errors import InvalidParameter
from service.transports.zenoh.answering import Answering, camera_of, key_of, pose_of
from service.transports.zenoh.config import check_endpoints, configuration, endpoints_of, is_wanted, mode_of
from service.transports.zenoh.queries import Queries
from service.transports.zenoh.replicas import REPLICAS

log = logging.getLogger(__name__)

AGAIN = 1.0  # seconds between attempts of a client to find its router


@asynccontextmanager
async def serving(application: Application) -> AsyncIterator[None]:
    """Answers queries and streams until the context ends; does nothing if zenoh is not configured.

    Once connected, zenoh itself connects again to whatever went away. A client whose router is not there at the
    start looks for it in the background; meanwhile the other transports answer.

    Raises:
        InvalidParameter: the settings of zenoh cannot be used, or an endpoint cannot be listened on.
    """
    if not is_wanted(application.settings):
        yield
        return
    config = configuration(application.settings)
    if application.access.open and application.settings.access != "open":
        check_endpoints(config)
    for stream in application.settings.streams:
        key_of(stream), pose_of(stream), camera_of(stream)
    if mode_of(config) == "client":
        background = asyncio.create_task(_as_client(application, config))
        try:
            yield
        finally:
            background.cancel()
            with suppress(asyncio.CancelledError):
                await background
        return
    if mode_of(config) == "peer" and not endpoints_of(config):
        log.warning("a peer that does not listen may not hear other peers: set SHAPE_CONCEPTS_ZENOH_LISTEN")
    try:
        session = await asyncio.to_thread(zenoh.open, config)
    except zenoh.ZError as error:
        raise InvalidParameter(f"zenoh cannot begin: {str(error).partition(' at /')[0]}") from None
    async with _answering(application, session):
        yield


async def _as_client(application: Application, config: zenoh.Config) -> None:
    """Finds a router, and answers until cancelled."""
    said = ""
    while True:
        try:
            session = await _opened(config)
            async with _answering(application, session):
                await asyncio.get_running_loop().create_future()  # until cancelled
        except zenoh.ZError as error:
            if said != (said := str(error).partition(" at /")[0]):
                log.warning("not answering over zenoh yet, and trying on: %s", said)
        except Exception:
            log.exception("not answering over zenoh, and trying on")
        await asyncio.sleep(AGAIN)


async def _opened(config: zenoh.Config) -> zenoh.Session:
    """A session; none is left behind when this is cancelled meanwhile."""
    opening = asyncio.create_task(asyncio.to_thread(zenoh.open, config))
    try:
        return await asyncio.shield(opening)
    except asyncio.CancelledError:
        with suppress(zenoh.ZError):
            (await opening).close()
        raise


@asynccontextmanager
async def _answering(application: Application, session: zenoh.Session) -> AsyncIterator[None]:
    """Answers on a session, and closes it at the end."""
    settings = application.settings
    turns = asyncio.Semaphore(settings.workers)
    async with AsyncExitStack() as stack:
        stack.push_async_callback(asyncio.to_thread, session.close)
        queries = Queries(application, session)
        stack.push_async_callback(queries.close)
        for stream in settings.streams:
            answering = Answering(application, session, stream, turns)
            await answering.open(list(settings.streams))
            stack.push_async_callback(answering.close)
        stack.enter_context(application.live.answering())
        token = session.liveliness().declare_token(f"{REPLICAS}/{session.zid()}")
        stack.callback(token.undeclare)
        log.info("zenoh: answering as %s", session.zid())
        yield
