"""Campaigns whose runs a Dask cluster carries out."""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from support.campaigns import TINY, Watch

from ngspring import Design, ProblemError
from ngspring.campaign.plan import Campaign, Run
from ngspring.campaign.run import run_campaign
from ngspring.evolution.folder import CHECKPOINT


def test_without_dask_or_a_scheduler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = Campaign((Run("a", TINY),))
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ProblemError, match=r"ngspring\[campaign\]"):
        run_campaign(campaign, tmp_path, scheduler="tcp://127.0.0.1:1")


needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None,
    reason="dask.distributed is not installed (the optional extra 'campaign')",
)


@needs_dask
def test_a_scheduler_that_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ngspring.campaign.dask.SECONDS_TO_CONNECT", 0.5)
    campaign = Campaign((Run("a", TINY),))
    for address in ("tcp://127.0.0.1:1", "nonsense://x", "127.0.0.1:no"):
        with pytest.raises(ProblemError, match="no Dask scheduler answers") as caught:
            run_campaign(campaign, tmp_path, scheduler=address)
        assert len(str(caught.value).splitlines()) == 1


def one_dask_worker(threads: int) -> Any:
    """A cluster of one worker.

    Dask gives the thread of its event loop ten seconds to begin, which once was not enough beside
    other tests: then it is asked again.
    """
    from distributed import LocalCluster  # type: ignore[import-not-found,unused-ignore]

    def cluster() -> Any:
        return LocalCluster(n_workers=1, threads_per_worker=threads, dashboard_address=None)

    try:
        return cluster()
    except AssertionError:
        return cluster()


@pytest.mark.long
@needs_dask
def test_a_dask_cluster(tmp_path: Path) -> None:
    runs = [Run("first", TINY, max_updates=2), Run("in the way", TINY)]
    runs.append(Run("last", TINY, "run:first", max_updates=1))
    (tmp_path / "in the way").touch()
    watch = Watch()
    with one_dask_worker(threads=2) as cluster:
        outcomes = run_campaign(
            Campaign(tuple(runs)),
            tmp_path,
            scheduler=cluster.scheduler_address,
            observers=[watch],
        )
    assert [outcome.status for outcome in outcomes] == ["not converged", "failed", "not converged"]
    assert [outcome.updates for outcome in outcomes] == [2, None, 1]
    assert "cannot make the folder" in outcomes[1].message
    assert watch.first("first", "ended") < watch.first("last", "started")
    assert (tmp_path / "results.csv").exists()


@pytest.mark.long
@needs_dask
def test_a_run_goes_on_when_its_dask_worker_is_killed(tmp_path: Path) -> None:
    checkpoint, stop = tmp_path / "first" / CHECKPOINT, threading.Event()
    killed: list[int] = []

    def kill(pid: int) -> None:
        while not stop.wait(0.01):
            if checkpoint.exists():
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
                return

    with one_dask_worker(threads=1) as cluster:
        (pid,) = (nanny.pid for nanny in cluster.workers.values())
        killer = threading.Thread(target=kill, args=(pid,))
        killer.start()
        (outcome,) = run_campaign(
            Campaign((Run("first", TINY),)), tmp_path, scheduler=cluster.scheduler_address
        )
        stop.set()
        killer.join()
        assert [nanny.pid for nanny in cluster.workers.values()] != [pid]
    assert killed == [pid]
    assert outcome.status == "converged"
    # It went on from its checkpoint: no update is missing or there twice.
    history = Design.load(tmp_path / "first" / "design.npz").history
    assert history is not None
    assert list(history["update"]) == list(range(len(history)))
