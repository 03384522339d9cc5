"""The runs of a campaign over worker processes, in the order that continuation asks for."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ngspring.basics.checks import shown
from ngspring.basics.errors import DesignFileError, ProblemError
from ngspring.basics.files import PathLike
from ngspring.campaign.dask import DaskWorkers
from ngspring.campaign.local import LocalWorkers
from ngspring.campaign.outcome import FAILED, INTERRUPTED, SKIPPED, Outcome, finished
from ngspring.campaign.plan import Campaign, Run
from ngspring.campaign.results import write_results
from ngspring.campaign.workers import Death, Workers
from ngspring.evolution.folder import CHECKPOINT, locked, read_design
from ngspring.evolution.updates import Update
from ngspring.fem.process import available

DEATHS = 3


@dataclass(frozen=True, eq=False)
class Event:
    """What an observer of a campaign gets.

    Attributes
    ----------
    run : Run
    kind : str
        ``"started"``, ``"update"`` (an accepted or rejected design update; not from a cluster),
        ``"restarted"`` (its worker process had died) or ``"ended"``; a run that was finished
        before only ends.
    update : Update, optional
    outcome : Outcome, optional
        Of a run that ended.
    reason : str
        Why a worker process died.
    """

    run: Run
    kind: str
    update: Update | None = None
    outcome: Outcome | None = None
    reason: str = ""


CampaignObserver = Callable[[Event], None]


def run_campaign(
    campaign: Campaign,
    out: PathLike,
    workers: int | None = None,
    threads: int = 1,
    scheduler: str | None = None,
    observers: Sequence[CampaignObserver] = (),
) -> list[Outcome]:
    """Compute the runs of a campaign, each in its folder ``out/NAME``, and write a table of them.

    What is finished is not repeated, and what was begun is resumed. A run that fails does not stop
    the others; one whose worker process is killed is restarted from its checkpoint, until the
    third death without a design update in between. Worker processes import the calling script:
    in a script, call this below ``if __name__ == "__main__":``.

    Parameters
    ----------
    campaign : Campaign
    out : path
        Folder of the campaign; at the end it holds ``results.csv`` and ``results.json``.
    workers : int, optional
        Runs at the same time; by default as many as there are processors for.
    threads : int
        Threads of each run.
    scheduler : str, optional
        Address of a Dask scheduler whose workers compute the runs instead of this machine. They
        must see the folder under the same path.
    observers : sequence of callables
        Called with an `Event` whenever something happens.

    Returns
    -------
    list of Outcome
        In the order of the campaign.

    Raises
    ------
    ProblemError
        If an argument is not valid, or no scheduler answers.
    DesignFileError
        If a run should start from a design that cannot be read.
    RunFolderError
        If another campaign uses the folder, or it cannot be written.
    KeyboardInterrupt
        After Ctrl-C, once every worker has stopped; the same call resumes.
    """
    for name, value in (("workers", workers), ("threads", threads)):
        right = value is None or (isinstance(value, int) and not isinstance(value, bool))
        if not right or (value is not None and value < 1):
            raise ProblemError(f"{name} = {shown(value)} must be an integer of at least 1")
    if workers is not None and scheduler is not None:
        raise ProblemError("workers are of this machine: a scheduler has its own")
    folder = Path(out).absolute()
    with locked(folder):
        loop = _Loop(campaign, folder, tuple(observers))
        loop.take_finished()
        loop.check_designs()
        if loop.waiting:
            pool: Workers = (
                LocalWorkers(workers or max(1, available() // threads), threads, folder)
                if scheduler is None
                else DaskWorkers(scheduler, threads, folder)
            )
            try:
                loop.work(pool)
            finally:
                pool.stop()
        outcomes = [loop.outcomes[run.name] for run in campaign.runs]
        write_results(outcomes, folder)
    return outcomes


class _Loop:
    """Which runs wait, which are done, and how often a worker died."""

    def __init__(
        self, campaign: Campaign, out: Path, observers: tuple[CampaignObserver, ...]
    ) -> None:
        self.out = out
        self.observers = observers
        self.waiting = list(campaign.runs)
        self.count = len(campaign.runs)
        self.outcomes: dict[str, Outcome] = {}
        self.updates: dict[str, float] = {}
        self.deaths: dict[str, tuple[int, float]] = {}

    def take_finished(self) -> None:
        for run in list(self.waiting):
            outcome = finished(run, self.out)
            if outcome is not None:
                self.waiting.remove(run)
                self.end(outcome)

    def check_designs(self) -> None:
        """Complain about the designs to start from before anything is computed."""
        for run in self.waiting:
            if run.design is not None and not os.path.exists(self.out / run.name / CHECKPOINT):
                try:
                    read_design(run.design)
                except DesignFileError as error:
                    raise DesignFileError(f"run {run.name!r}: {error}") from error

    def work(self, pool: Workers) -> None:
        while True:
            self.start_what_is_ready(pool)
            if len(self.outcomes) == self.count:
                return
            for news in pool.news():
                if isinstance(news, Death):
                    self.bury(news)
                elif isinstance(news, Outcome) and news.status == INTERRUPTED:
                    self.bury(Death(news.run, "told to stop"))
                elif isinstance(news, Outcome):
                    self.end(news)
                else:
                    run, update = news
                    self.updates[run.name] = update.row.update
                    self.tell(Event(run, "update", update=update))

    def start_what_is_ready(self, pool: Workers) -> None:
        changed = True
        while changed:
            changed = False
            for run in list(self.waiting):
                before = self.outcomes.get(run.after) if run.after else None
                if run.after and before is None:
                    continue
                if before is not None and not before.has_design:
                    message = f"run {run.after} left no design to continue from"
                    self.waiting.remove(run)
                    self.end(Outcome(run, SKIPPED, message))
                    # Others may have waited for this one.
                    changed = True
                elif not pool.full:
                    self.waiting.remove(run)
                    self.tell(Event(run, "started"))
                    pool.start(run)

    def bury(self, death: Death) -> None:
        run, update = death.run, self.updates.get(death.run.name, -1.0)
        count, at = self.deaths.get(run.name, (0, -1.0))
        count = count + 1 if update <= at else 1
        self.deaths[run.name] = count, update
        if count < DEATHS:
            self.waiting.insert(0, run)
            self.tell(Event(run, "restarted", reason=death.reason))
        else:
            message = f"its worker died {count} times without a design update: {death.reason}"
            self.end(Outcome(run, FAILED, message))

    def end(self, outcome: Outcome) -> None:
        self.outcomes[outcome.run.name] = outcome
        self.tell(Event(outcome.run, "ended", outcome=outcome))

    def tell(self, event: Event) -> None:
        for observer in self.observers:
            observer(event)
