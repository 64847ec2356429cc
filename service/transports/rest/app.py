"""The HTTP interface as an ASGI app."""

from __future__ import annotations

from fastapi import FastAPI
from fastapi_offline import FastAPIOffline
from starlette.middleware.gzip import GZipMiddleware

from service import __version__
from service.application import Application
from service.transports.rest import (
    access,
    batches,
    dataset_uploads,
    datasets,
    health,
    jobs,
    models,
    names,
    objects,
    observing,
    page,
    points,
    problems,
    responses,
    schedules,
    streams,
)
from service.transports.rest.encodings import Decoding
from service.transports.rest.known import Known

WORTHWHILE = 4096  # bytes of the smallest answer that is compressed for those who accept it


def create_app(application: Application) -> FastAPI:
    """An app that answers for an application.

    Its pages /docs and /redoc load nothing from elsewhere: many robots have no internet.
    """
    app = FastAPIOffline(
        title="Shape Concepts",
        version=__version__,
        summary="Tells of an object's point cloud which learned shape concepts it resembles.",
    )
    app.state.known = Known(application)
    app.router.routes.insert(0, app.state.known)
    app.add_middleware(Decoding)
    app.add_middleware(GZipMiddleware, minimum_size=WORTHWHILE, compresslevel=5)
    app.add_middleware(observing.Observing, application=application)
    problems.install(app)
    app.include_router(page.router())
    app.include_router(health.router(application))
    app.include_router(observing.router(application), dependencies=[access.needing(application, "manage")])
    for module, entering in (
        (responses, access.needing(application, "answer")),
        (batches, access.needing(application, "answer")),
        (points, access.needing(application, "answer")),
        (objects, access.reading(application, otherwise="manage")),
        (models, access.reading(application, otherwise="manage")),
        (names, access.reading(application, otherwise="manage")),
        (datasets, access.reading(application, "answer", "train", otherwise="train")),
        (dataset_uploads, access.reading(application, "answer", "train", otherwise="train")),
        (jobs, access.reading(application, "answer", "train", otherwise="train")),
        (schedules, access.reading(application, "answer", "train", otherwise="train")),
        (streams, access.reading(application, otherwise="manage")),
    ):
        app.include_router(
            module.router(application), dependencies=[entering], responses=problems.refused(401, 403, 429)
        )
    return app
