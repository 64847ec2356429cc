"""The use cases on schedules, for the command line and every transport; it knows none of them."""

from __future__ import annotations

from service.cron import read_cron
from service.job_specs import JobSpec
from service.schedules import Schedule, Schedules
from service.training import Training


class Scheduling:
    """The use cases on schedules.

    Args:
        schedules: in the database of the jobs.
        training: the use cases on jobs, which say what a job may be.
    """

    def __init__(self, schedules: Schedules, training: Training) -> None:
        self._schedules, self._training = schedules, training

    def create(self, name: str, cron: str, spec: JobSpec, zone: str = "UTC", *, local: bool = False) -> Schedule:
        """Has a job submitted at the times of a cron expression; made again, it is the same schedule.

        Args:
            name: of the schedule.
            cron: minute, hour, day of month, month, day of week.
            spec: what each job is to do.
            zone: IANA name of the time zone.
            local: whether it is somebody of this machine who asks.

        Raises:
            InvalidParameter: the name, the expression, the time zone or the job cannot be.
            ModelNotFound: a model that the job needs is not there.
            ScheduleExists: there is another one of that name.
        """
        times = read_cron(cron, zone)
        self._training.check(spec, local=local)
        return self._schedules.create(name, times, spec)

    def schedules(self) -> list[Schedule]:
        """All schedules, by name."""
        return self._schedules.all()

    def schedule(self, name: str) -> Schedule:
        """A schedule as it stands."""
        return self._schedules.show(name)

    def pause(self, name: str) -> Schedule:
        """Submits nothing from now on."""
        return self._schedules.pause(name)

    def resume(self, name: str) -> Schedule:
        """Submits again; the times of the pause count for nothing."""
        return self._schedules.resume(name)

    def delete(self, name: str) -> Schedule:
        """Removes a schedule; jobs that it has submitted stay. Returns what it was."""
        return self._schedules.delete(name)

    def close(self) -> None:
        """Lets the database go."""
        self._schedules.close()
