"""Everything that can go wrong, as the engine, the store and the worker say it.

The classes know nothing of HTTP or gRPC: `service/transports/errors.py` maps each to a status. A message
says what was given, what was expected and what to try.
"""


class ShapeConceptsError(Exception):
    """Something that a caller can act on went wrong."""

    @classmethod
    def type_name(cls) -> str:
        """Stable, kebab-case name of the error, as every transport shows it: `TooFewPoints` is `too-few-points`."""
        name = cls.__name__
        return "".join(f"-{c.lower()}" if c.isupper() and i else c.lower() for i, c in enumerate(name))


class InvalidParameter(ShapeConceptsError):
    """A parameter of a request or of a configuration is out of its range, or contradicts another one."""


class InvalidCloud(ShapeConceptsError):
    """The cloud was read, but is not one that the method can answer."""


class EmptyCloud(InvalidCloud):
    """The cloud holds no point at all, or the file no byte."""


class NoFinitePoints(InvalidCloud):
    """Every point of the cloud is NaN or infinite: the sensor measured nothing."""


class TooFewPoints(InvalidCloud):
    """The cloud has fewer points than the method needs."""


class TooManyPoints(InvalidCloud):
    """The cloud, or what its header promises, is larger than the limit."""


class DegenerateCloud(InvalidCloud):
    """The points coincide or lie on one line: there is no surface to describe."""


class ImplausibleExtent(InvalidCloud):
    """The object is far too large or too small for metres: most likely its unit is another one."""


class DistantCloud(InvalidCloud):
    """The object lies so far from the sensor that its coordinates no longer tell its surface."""


class NoSupportingPlane(InvalidCloud):
    """The scene has no plane on which objects could stand."""


class ContentTooLarge(ShapeConceptsError):
    """The body of the request, its message or its payload, is larger than the limit, or holds more clouds."""


class UnreadableCloud(ShapeConceptsError):
    """The bytes are not a well-formed cloud of the format they claim: truncated, damaged or contradictory."""


class UnsupportedFormat(ShapeConceptsError):
    """The format of the cloud is not one of those that the service reads."""


class NotEnoughSamples(ShapeConceptsError):
    """Learning needs at least two clouds that can be described."""


class RendererUnavailable(ShapeConceptsError):
    """SAPIEN finds no rendering device."""


class ModelNotFound(ShapeConceptsError):
    """The store has no model, version or alias of that name."""


class ConceptNotFound(ShapeConceptsError):
    """The version of the model has no concept of that id, at any filtration time."""


class ModelDamaged(ShapeConceptsError):
    """The model's files are incomplete, altered, or not a shape model."""


class ModelIncompatible(ShapeConceptsError):
    """The model was published in a layout that this version of the software does not read."""


class StoreUnavailable(ShapeConceptsError):
    """The model store cannot be read or written."""


class DatasetNotFound(ShapeConceptsError):
    """There is no dataset of that name."""


class DatasetExists(ShapeConceptsError):
    """There is a dataset of that name, and it is another one."""


class DatasetInUse(ShapeConceptsError):
    """A model learnt from the dataset, and could not be made again without it."""


class DatasetDamaged(ShapeConceptsError):
    """What the store holds of a dataset is incomplete or altered."""


class CloudNotFound(ShapeConceptsError):
    """The dataset has no cloud of that key."""


class CloudExists(ShapeConceptsError):
    """The dataset has another cloud of that key."""


class UnreadableArchive(ShapeConceptsError):
    """The bytes are no zip or tar archive, or it is truncated, damaged, or reaches out of itself."""


class ArchiveTooLarge(ShapeConceptsError):
    """The archive holds, or unfolds to, more than is taken."""


class UploadNotFound(ShapeConceptsError):
    """There is no upload of that id, or it was finished or given up."""


class UploadConflict(ShapeConceptsError):
    """The piece does not follow what the upload has so far."""


class JobNotFound(ShapeConceptsError):
    """There is no job of that id."""


class ScheduleNotFound(ShapeConceptsError):
    """There is no schedule of that name."""


class ScheduleExists(ShapeConceptsError):
    """There is a schedule of that name, and it is another one."""


class StreamNotFound(ShapeConceptsError):
    """The service answers no stream of that key."""


class StreamsUnavailable(ShapeConceptsError):
    """The service has not reached zenoh, which brings the streams."""


class JobsUnavailable(ShapeConceptsError):
    """The database of jobs cannot be used, or the job engine is not installed."""


class ClusterUnavailable(ShapeConceptsError):
    """The Dask cluster cannot be used: it is not there, has no workers, or its workers would give other bits."""


class JobConflict(ShapeConceptsError):
    """The job is in a state in which this cannot be done."""


class JobTimedOut(ShapeConceptsError):
    """The job was at work for longer than it was allowed to."""


class StageDied(ShapeConceptsError):
    """The process that was at work on a stage of the job was killed, most likely for want of memory."""


class NotAuthenticated(ShapeConceptsError):
    """The request bears no access key that is valid here."""


class NotAllowed(ShapeConceptsError):
    """The access key does not allow what was asked for."""


class KeyNotFound(ShapeConceptsError):
    """There is no access key of that id."""


class RateExceeded(ShapeConceptsError):
    """The access key's requests are too many, a second or at a time; try again later.

    Attributes:
        after: seconds after which it may.
    """

    def __init__(self, message: str = "", after: float = 0) -> None:
        super().__init__(message)
        self.after = after


class Overloaded(ShapeConceptsError):
    """More work is waiting than the service accepts; try again later."""


class Cancelled(ShapeConceptsError):
    """The caller gave up, or its deadline passed, and the work was stopped."""
