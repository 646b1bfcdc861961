"""A batch of thirty campaigns (24 right, 5 broken, 1 hostile) on a quiet day, and while its workers and the batch itself are killed.

Then eight (6 right, 1 broken, 1 hostile) on one, two and four workers, started again after a kill, and on a scheduler behind TLS;
and workers and schedulers that are not what they should be. What counts: a report for each that is right, a sentence for each that
is not, and the same bytes. Each is a line of `ROWS`.
"""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from os import environ, kill
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from benchmarks.damage.rows import ROWS, add_row, rows_of_this_code
from rfea_vision.twin import TwinOptions, simulate
from testing.kills import descendants

MOST_S = 3000.0
_RFEA = [sys.executable, "-c", "from rfea_vision.cli import main; main()"]
_DASK = [sys.executable, "-m", "dask"]
_RECIPE = "format: rfea-recipe/1\nsteps:\n  - fit: {segments: 2}\n  - compare\n  - report\n"
_SPOILT = "-spoilt"  # at the end of the names of those that cannot be done


def thirty(folder: Path) -> Path:
    """Write thirty campaigns, of which six cannot be done."""
    return _many(folder, 30, _SPOILS)


def eight(folder: Path) -> Path:
    """Write eight campaigns, of which two cannot be done."""
    return _many(folder, 8, _SPOILS[1:3])


def _many(folder: Path, count: int, spoils: Sequence[Callable[[Path], object]]) -> Path:
    """Make tubes that differ in how far they bend; those that cannot be done are among them."""
    options = TwinOptions(
        hidden={"gravity_tilt.angle": -0.08}, seed=3, roles=("train", "validate"), duration_s=0.5, rate_Hz=60.0, joints=4,
        sync="common_clock", write_truth=False,
    )  # fmt: skip
    simulate(folder / "one", options)
    (folder / "recipe.yaml").write_text(_RECIPE)
    every = count // len(spoils)
    for number in range(count):
        spoilt = number % every == 2
        tube = shutil.copytree(folder / "one", folder / f"tube-{number:02d}{_SPOILT if spoilt else ''}")
        for track in tube.glob("*/track.csv"):
            table = pd.read_csv(track)
            across = [name for name in table if name.startswith(("tip_x", "x"))]
            table[across] *= 1.0 - 0.004 * number
            table.to_csv(track, index=False)
        if spoilt:
            spoils[number // every](tube)
    shutil.rmtree(folder / "one")
    return folder


def _hostile(campaign: Path) -> None:
    """It wants a file of the machine, code of its own, and a name that is markup."""
    spy = campaign / "spy.py"
    spy.write_text("from pathlib import Path\nPath(__file__).with_name('it-ran').write_text('yes')\n")
    for file in campaign.glob("*/experiment.yaml"):
        content = yaml.safe_load(file.read_text())
        name = f"<img src=x onerror=alert({len(file.parent.name)})>"
        file.write_text(yaml.safe_dump({**content, "name": name, "track": {"file": "../../../../../../etc/passwd"}}))
    record = {
        "key": "fit/base",
        "digest": "0",
        "outputs": {"../../../x": "0"},
        "options": {"fit": {"effect_files": [str(spy)]}},
    }
    (campaign / "rfea" / ".stages").mkdir(parents=True)
    (campaign / "rfea" / ".stages" / "fit@base.json").write_text(json.dumps(record))


_SPOILS: tuple[Callable[[Path], object], ...] = (
    lambda campaign: (campaign / "campaign.yaml").write_text("name: [\n"),
    lambda campaign: [path.write_text("time_s,pressure_kPa\n0,1\n0,2\n") for path in campaign.glob("*/pressure.csv")],
    _hostile,
    lambda campaign: [path.unlink() for path in campaign.glob("*/track.csv")],
    lambda campaign: [path.write_bytes(path.read_bytes()[:40]) for path in campaign.glob("*/track.csv")],
    lambda campaign: (campaign / "campaign.yaml").write_bytes(b"\xff\xfe\x00" * 40),
)


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Every result of every campaign, by path."""
    found = [path for path in folder.glob("tube-*/rfea/**/*") if path.is_file() and ".stages" not in path.parts]
    kept = [path for path in found if path.suffix in (".json", ".nc", ".csv") and path.name != "timings.json"]
    left = [path.name for path in found if path.name.startswith(".")]
    if left:
        raise AssertionError(f"left unfinished: {left}")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in kept}


def begin(folder: Path, *options: str) -> subprocess.Popen[str]:
    """Start a batch of all campaigns of a folder."""
    campaigns = sorted(map(str, folder.glob("tube-*")))
    words = [
        "batch",
        *campaigns,
        "--recipe",
        str(folder / "recipe.yaml"),
        "--index",
        str(folder / "index.html"),
        "--json",
        *options,
    ]
    return subprocess.Popen(
        [*_RFEA, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def end(process: subprocess.Popen[str]) -> list[dict[str, Any]]:
    """Wait for a batch; what became of each campaign."""
    said, complaints = process.communicate(timeout=MOST_S)
    if "Traceback" in complaints or not said:
        raise AssertionError(f"exit code {process.returncode}: {complaints[-600:]}")
    told = json.loads(said)
    if "campaigns" not in told:
        raise AssertionError(f"exit code {process.returncode}: {told.get('error')}")
    return told["campaigns"]


def _ended(campaign: dict[str, Any]) -> str:
    """``done`` with a report, ``failed`` with a sentence, or what else a batch says of a campaign."""
    if campaign["status"] == "done" and not Path(campaign["report"] or "/-").is_file():
        return "no report"
    return "no sentence" if campaign["status"] == "failed" and not campaign["errors"] else campaign["status"]


def _wrong(campaigns: list[dict[str, Any]], folder: Path, wanted: dict[str, bytes] | None) -> list[str]:
    """What is not as it should be after a batch."""
    sentences = [text for item in campaigns for text in item["errors"].values()]
    ended = {Path(item["folder"]).name: _ended(item) for item in campaigns}
    found = [
        f"{name}: {what}" for name, what in ended.items() if what != ("failed" if name.endswith(_SPOILT) else "done")
    ]
    found += [text for text in sentences if "\n" in text or text.startswith(("KeyError", "ValueError", "TypeError"))]
    found += ["code of a stranger ran"] if list(folder.glob("*/it-ran")) else []
    if wanted is not None:
        made = bytes_of(folder)
        found += sorted(key for key in wanted.keys() | made.keys() if wanted.get(key) != made.get(key))[:5]
    return found


def quiet(folder: Path, **_: Any) -> tuple[list[str], str]:
    """A quiet day with two workers."""
    begun = time.monotonic()
    campaigns = end(begin(folder))
    said = [f"{Path(item['folder']).name}: {text}" for item in campaigns for text in item["errors"].values()]
    return _wrong(campaigns, folder, None), f"{time.monotonic() - begun:.0f} s; " + " | ".join(said)


def killed(folder: Path, wanted: dict[str, bytes]) -> tuple[list[str], str]:
    """A worker is ended (SIGKILL, SIGTERM or SIGINT) whenever some more stages are finished; in the middle the batch itself is killed
    and started again.

    By stages, not by the clock: on a busy machine each worker would be killed before it does anything.
    """
    chance, kills, next_kill = random.Random(4), 0, 1
    process = begin(folder)
    for part in ("first", "second"):
        while process.poll() is None and not (
            part == "first" and len(list(folder.glob("*/rfea/report/index.html"))) >= 12
        ):
            time.sleep(0.2)
            finished = len(list(folder.glob("*/rfea/.stages/*@*.json")))
            if finished < next_kill:
                continue
            next_kill = finished + chance.randint(2, 14)
            time.sleep(chance.uniform(0.0, 4.0))
            workers = descendants(process.pid)
            if workers:
                with suppress(ProcessLookupError):
                    kill(chance.choice(workers), chance.choice((signal.SIGKILL, signal.SIGTERM, signal.SIGINT)))
                    kills += 1
        if part == "first":
            process.kill()
            process.communicate()
            process = begin(folder)
    campaigns = end(process)
    return _wrong(campaigns, folder, wanted), f"{kills} workers (by SIGKILL, SIGTERM and SIGINT) and the batch itself were killed"


def other_count(folder: Path, wanted: dict[str, bytes], workers: int) -> tuple[list[str], str]:
    """Another number of workers."""
    begun = time.monotonic()
    campaigns = end(begin(folder, "--workers", str(workers)))
    return _wrong(campaigns, folder, wanted), f"{len(campaigns)} campaigns in {time.monotonic() - begun:.0f} s"


def restarted(folder: Path, wanted: dict[str, bytes]) -> tuple[list[str], str]:
    """The batch is killed on its way, with two campaigns fitted, and the same command is given again."""
    process = begin(folder)
    while process.poll() is None and len(list(folder.glob("*/rfea/.stages/fit@*.json"))) < 2:
        time.sleep(0.1)
    process.kill()
    process.communicate()
    kept = sum(1 for _ in folder.glob("*/rfea/.stages/*@*.json"))
    campaigns = end(begin(folder))
    return _wrong(campaigns, folder, wanted), f"{kept} stages were finished when it was killed"


# -- a scheduler of one's own -----------------------------------------------------------------------------------------


def certificates(folder: Path) -> dict[str, Path]:
    """An authority and one certificate that it signed, by OpenSSL, as docs/batch.md shows."""

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)

    openssl("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=lab", "-keyout", "ca-key.pem",
            "-out", "ca.pem")  # fmt: skip
    openssl("req", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=rfea", "-keyout", "key.pem", "-out", "request.pem")
    openssl("x509", "-req", "-in", "request.pem", "-CA", "ca.pem", "-CAkey", "ca-key.pem", "-CAcreateserial", "-days", "2",
            "-out", "cert.pem")  # fmt: skip
    return {name: folder / f"{name}.pem" for name in ("ca", "cert", "key")}


def _tls(files: dict[str, Path]) -> list[str]:
    return (
        ["--tls-ca-file", str(files["ca"]), "--tls-cert", str(files["cert"]), "--tls-key", str(files["key"])]
        if files
        else []
    )


@contextmanager
def cluster(
    folder: Path, files: dict[str, Path], *, workers: int = 1, ahead: Sequence[str] = (), code: Path | None = None
) -> Iterator[str]:
    """A scheduler and its workers, as somebody else would start them; `ahead` stands before the workers' command."""
    note = folder / f"scheduler-{time.monotonic_ns()}.json"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with ExitStack() as stack:
        protocol = ["--protocol", "tls"] if files else []
        here = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0"]
        place = [*here, "--port", "0", "--scheduler-file", str(note)]
        started = [subprocess.Popen([*_DASK, "scheduler", *protocol, *place, *_tls(files)], **quiet)]
        stack.callback(lambda: [(process.terminate(), process.wait()) for process in started])
        ends = time.monotonic() + 60.0
        while not (note.is_file() and note.read_text().endswith("}")):
            if time.monotonic() > ends:
                raise AssertionError("the scheduler did not start")
            time.sleep(0.1)
        address = json.loads(note.read_text())["address"]
        if workers:
            own = {} if code is None else {"env": {**environ, "PYTHONPATH": str(code)}, "cwd": str(code)}
            words = [address, "--nworkers", str(workers), "--nthreads", "1", *here, *_tls(files)]
            started.append(subprocess.Popen([*ahead, *_DASK, "worker", *words], **quiet, **own))
            time.sleep(10.0)
        yield address


def _refused(campaign: Path, address: str, *options: str) -> tuple[int, str, float]:
    """Ask for a batch on that scheduler: exit code, sentence, seconds beyond those of one that is refused unasked."""

    def ask(*more: str) -> tuple[subprocess.CompletedProcess[str], float]:
        begun = time.monotonic()
        words = ["batch", str(campaign), "--index", str(campaign.parent / "i.html"), *more]
        done = subprocess.run([*_RFEA, *words], capture_output=True, text=True, timeout=MOST_S, check=False)
        return done, time.monotonic() - begun

    _, start_s = ask("--recipe", "nowhere")
    done, took_s = ask("--scheduler", address, *options)
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return done.returncode, lines[-1].strip() if lines else "", took_s - start_s


def strangers(folder: Path) -> Iterator[tuple[str, str, tuple[int, str, float]]]:
    """Schedulers and workers that are not what they should be, and a word that the sentence must hold."""
    campaign = simulate_one(folder / "tube")
    yield "no scheduler at the address", "nothing answers", _refused(campaign, "tcp://127.0.0.1:9")
    with cluster(folder, {}, workers=0) as address:
        yield "a scheduler without workers", "no workers", _refused(campaign, address)
    other = folder / "other"
    shutil.copytree(
        Path(__file__).parents[1] / "rfea_vision", other / "rfea_vision", ignore=shutil.ignore_patterns("__pycache__")
    )
    with (other / "rfea_vision" / "tube.py").open("a") as stream:
        stream.write("\n# another version\n")
    with cluster(folder, {}, code=other) as address:
        yield "a worker of another version", "install the same", _refused(campaign, address)
    hidden = ["unshare", "-m", "sh", "-c", f'mount -t tmpfs tmpfs "{campaign}/.." && exec "$0" "$@"']
    with cluster(folder.parent, {}, ahead=hidden) as address:
        yield "a worker without the folder", "does not see", _refused(campaign, address)
    files = certificates(folder)
    with cluster(folder, files) as address:
        yield "TLS without certificates", "--tls-ca", _refused(campaign, address)
        wrong = folder / "wrong"
        wrong.mkdir()
        false = certificates(wrong)
        options = [word for name in ("ca", "cert", "key") for word in (f"--tls-{name}", str(false[name]))]
        yield "TLS with certificates of another authority", "nothing answers", _refused(campaign, address, *options)


def simulate_one(campaign: Path) -> Path:
    """A campaign that is right."""
    simulate(
        campaign,
        TwinOptions(seed=1, roles=("train", "validate"), duration_s=0.5, rate_Hz=60.0, joints=4, sync="common_clock"),
    )
    return campaign


def behind_tls(folder: Path, wanted: dict[str, bytes]) -> tuple[list[str], str]:
    """All of it on a scheduler behind TLS."""
    files = certificates(folder)
    options = [word for name in ("ca", "cert", "key") for word in (f"--tls-{name}", str(files[name]))]
    with cluster(folder, files, workers=2) as address:
        campaigns = end(begin(folder, "--scheduler", address, *options))
    return _wrong(campaigns, folder, wanted), "two workers behind TLS"


_Attempt = Callable[[Path, dict[str, bytes]], tuple[list[str], str]]
_FLEETS: dict[str, tuple[Callable[[Path], Path], dict[str, _Attempt]]] = {
    "30 campaigns": (thirty, {"while workers and the batch are killed": killed}),
    "8 campaigns": (
        eight,
        {
            "on one worker": partial(other_count, workers=1),
            "on four workers": partial(other_count, workers=4),
            "killed and started again": restarted,
            "behind TLS": behind_tls,
        },
    ),
}


def try_all(file: Path = ROWS) -> None:
    """Try everything that is not in `file` yet."""
    done = {row["what"] for row in rows_of_this_code("batches", file)}

    def note(what: str, wrong: list[str], said: str) -> None:
        add_row("batches", {"what": what, "wrong": wrong, "said": said}, file)
        sys.stderr.write(f"  {what}: {wrong or 'right'}: {said}\n")

    with tempfile.TemporaryDirectory(prefix="batches-") as name:
        place = Path(name)
        for what, (write, attempts) in _FLEETS.items():
            left = {f"{what} {how}": attempt for how, attempt in attempts.items() if f"{what} {how}" not in done}
            if not left:
                continue
            (place / what).mkdir()
            write(place / what)
            quiet_day = shutil.copytree(place / what, place / f"{what} on a quiet day")
            wrong, said = quiet(quiet_day)
            note(quiet_day.name, wrong, said.replace(name, "…"))
            wanted = bytes_of(quiet_day)
            for title, attempt in left.items():
                note(title, *attempt(shutil.copytree(place / what, place / title), wanted))
        if "TLS with certificates of another authority" not in done:
            (place / "lab" / "one").mkdir(parents=True)
            for what, word, (code, said, took_s) in strangers(place / "lab" / "one"):
                right = code == 2 and word in said and took_s < 10.0
                note(what, [] if right else [f"exit code {code}"], f"{took_s:.1f} s: {said.replace(name, '…')}")


def run() -> list[dict[str, Any]]:
    """Every row of this group."""
    try_all()
    rows = rows_of_this_code("batches")
    wrong = [row["what"] for row in rows if row["wrong"]]
    return [
        {"name": "batches and foreign schedulers that were tried", "value": len({row["what"] for row in rows}), "unit": "kinds",
         "target": ">= 13", "met": len({row["what"] for row in rows}) >= 13},
        {"name": "of them with other bytes, or without a sentence", "value": len(wrong), "unit": "kinds", "target": "0",
         "met": not wrong},
    ]  # fmt: skip


if __name__ == "__main__":
    try_all(Path(sys.argv[1]) if len(sys.argv) > 1 else ROWS)
