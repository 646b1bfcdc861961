"""Processes to work on: a cluster of this machine, reachable from nowhere else, or somebody's scheduler.

Dask moves pickles between its processes: whoever can reach a scheduler can run code on its workers. Hence the local
cluster listens on the loopback address alone, and a scheduler in a network belongs behind TLS (``tls://``).
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfea_vision.distributed.tasks import fingerprint
from rfea_vision.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

DEFAULT_WORKERS = 2  # on the machine that the batch is started on
_ANSWER_S = 5.0  # a scheduler that is there answers within milliseconds
_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "MALLOC_ARENA_MAX"), "1"
)
_SETTINGS = {
    "distributed.scheduler.allowed-failures": 10,  # a worker that is killed is no fault of the campaign it worked on
    "distributed.deploy.lost-worker-timeout": "120s",  # on a busy machine a process needs more than Dask's 15 s to come back
    "distributed.admin.low-level-log-length": 0,
    "distributed.worker.memory.target": False,  # tasks hand over paths: there is nothing to write to disk
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.nanny.pre-spawn-environ": _ONE_THREAD,
}


@dataclass(frozen=True)
class Security:
    """Files (PEM) for a scheduler at ``tls://``: the authority, and the client's own certificate and key."""

    authority: Path | None = None
    certificate: Path | None = None
    key: Path | None = None

    def for_dask(self) -> Any:
        """Return what Dask wants, or None where nothing is given: then Dask's own configuration counts.

        Raises
        ------
        InputError
            If one of the three files is not given, or not there.
        """
        if self.authority is None and self.certificate is None and self.key is None:
            return None
        from distributed import Security as DaskSecurity

        for option, file in (("ca", self.authority), ("cert", self.certificate), ("key", self.key)):
            if file is None:
                raise InputError(f"--tls-{option}: is missing; --tls-ca, --tls-cert and --tls-key belong together")
            if not file.is_file():
                raise InputError(f"--tls-{option} {file}: not found; correct the path")
        return DaskSecurity(
            tls_ca_file=str(self.authority),
            tls_client_cert=str(self.certificate),
            tls_client_key=str(self.key),
            require_encryption=True,
        )


@contextmanager
def dask_client(
    scheduler: str | None,
    workers: int = DEFAULT_WORKERS,
    *,
    memory: str = "auto",
    security: Security | None = None,
    folders: Sequence[Path] = (),
    files: Sequence[Path] = (),
) -> Iterator[Client]:
    """Connect to a scheduler, or start a cluster of processes on this machine for as long as the block runs.

    Parameters
    ----------
    scheduler : its address; None starts a cluster here
    workers, memory : processes of the cluster here, and what each may use (``auto``: an equal share)
    security : for ``tls://``
    folders, files : what the workers of a scheduler must see under the same paths

    Raises
    ------
    InputError
        If no scheduler answers at the address, it has no workers, or these run another version or do not see the folders.
    """
    from dask import config
    from distributed import Client, LocalCluster

    if scheduler is not None:
        timeouts = config.set({"distributed.comm.timeouts.connect": f"{_ANSWER_S:g}s"})
        with timeouts, _connected(scheduler, security or Security()) as client:
            # one that is not here either, or is no folder, is refused as on this machine: by name, beside the others
            _check_workers(client, scheduler, [*(folder for folder in folders if folder.is_dir()), *files])
            yield client
        return
    with (
        config.set(_SETTINGS),
        LocalCluster(
            n_workers=0,  # Dask gives a cluster up that loses one of its first
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=share_of_memory(memory, workers),
            silence_logs=50,
        ) as cluster,
        Client(cluster) as client,
    ):
        cluster.scale(workers)  # pyright: ignore[reportAttributeAccessIssue]
        yield client


def share_of_memory(memory: str, workers: int) -> str | float:
    """What one of so many processes may use: an amount, or a share of the machine (Dask's own share is one of its cores)."""
    return 1.0 / workers if memory == "auto" else memory


def start_again(client: Client) -> None:
    """Start processes of this machine that Dask has given up, as it does with those that are killed while they start."""
    from distributed import Status

    cluster: Any = client.cluster
    if cluster is None:
        return
    gone = [name for name, nanny in list(cluster.workers.items()) if nanny.status in (Status.closed, Status.failed)]
    for name in gone:
        cluster.workers.pop(name, None)
    if gone or len(cluster.workers) < len(cluster.worker_spec):
        cluster.scale(len(cluster.worker_spec))


@contextmanager
def _connected(scheduler: str, security: Security) -> Iterator[Client]:
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # said here, in a sentence
    given = security.for_dask()
    try:
        # the client itself waits without end for one that takes the connection and says nothing
        asyncio.run(asyncio.wait_for(_greet(scheduler, given), _ANSWER_S))
        client = Client(scheduler, timeout=_ANSWER_S, **({} if given is None else {"security": given}))
    except Exception as error:  # sockets, TLS and whatever else listens at that port each have their own kinds
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        tls = "; for tls:// give --tls-ca, --tls-cert and --tls-key" if scheduler.startswith("tls://") else ""
        raise InputError(
            f"--scheduler {scheduler}: nothing answers there ({reason}); start 'dask scheduler' or drop the option{tls}"
        ) from error
    with client:
        yield client


async def _greet(scheduler: str, security: Any) -> None:
    """Shake hands with a scheduler."""
    from distributed import Security as DaskSecurity
    from distributed.comm.core import connect

    arguments = (security or DaskSecurity()).get_connection_args("client")
    comm = await connect(scheduler, timeout=_ANSWER_S, **arguments)
    await comm.close()


def _check_workers(client: Client, scheduler: str, needed: Sequence[Path]) -> None:
    """Ask every worker which version it runs and which folders and files it does not see."""
    wanted, paths = fingerprint(), [str(path.resolve()) for path in needed]
    ends = time.monotonic() + 0.5 * _ANSWER_S
    while not client.scheduler_info(n_workers=-1)["workers"]:
        if time.monotonic() > ends:
            raise InputError(f"--scheduler {scheduler}: it has no workers; start some with 'dask worker {scheduler}'")
        time.sleep(0.1)

    # a local function: it is sent by value, as the worker may know another version
    def look() -> tuple[str, list[str]]:
        import os

        try:
            from rfea_vision.distributed.tasks import fingerprint as here
        except ImportError:
            return "", []
        return here(), [path for path in paths if not os.path.exists(path)]  # noqa: PTH110

    try:
        answers: Any = client.run(look, on_error="return")
    except Exception as error:
        raise InputError(f"--scheduler {scheduler}: its workers do not answer ({error}); start them again") from error
    for address, answer in answers.items():
        where = f"--scheduler {scheduler}: the worker at {address}"
        if isinstance(answer, BaseException):
            raise InputError(f"{where} does not answer ({answer}); start it again with the Python of this command")
        version, missing = answer
        if not version:
            raise InputError(f"{where} has no rfea-vision of this kind; install the version that runs here, {wanted}")
        if version != wanted:
            raise InputError(f"{where} runs rfea-vision {version}, here it is {wanted}; install the same on both")
        if missing:
            raise InputError(f"{where} does not see {missing[0]}; mount the folder there under the same path")


def dashboard(client: Client) -> str:
    """Address of the pages that show a scheduler at work: Dask's live page, or without Bokeh its plain list of workers."""
    link = client.dashboard_link or ""
    return link if find_spec("bokeh") is not None else link.replace("/status", "/info/main/workers.html")
