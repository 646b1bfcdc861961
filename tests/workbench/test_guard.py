"""Nobody but the page that was opened reaches the server."""

from __future__ import annotations

import asyncio
import http.client
import json
from urllib.parse import urlsplit

import pytest

from rfea_vision.errors import InputError
from rfea_vision.workbench.answers import law_open
from rfea_vision.workbench.app_state import AppState, Asked
from rfea_vision.workbench.guard import Guard

TOKEN, PORT = "secret", 8123
GOOD = {"host": f"127.0.0.1:{PORT}"}


def answer(path: str, headers: dict[str, str]) -> tuple[int, dict[str, str], str]:
    """Status, headers, and the path that the application behind the guard saw."""
    seen: list[str] = []
    sent: list[dict] = []

    async def application(scope, receive, send):
        seen.append(scope["path"])
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def send(message):
        sent.append(message)

    async def receive():
        return {"type": "http.request"}

    scope = {"type": "http", "path": path, "headers": [(k.encode(), v.encode()) for k, v in headers.items()]}
    asyncio.run(Guard(application, TOKEN, PORT)(scope, receive, send))
    return sent[0]["status"], {k.decode(): v.decode() for k, v in sent[0]["headers"]}, seen[0] if seen else ""


@pytest.mark.parametrize(
    "headers",
    [
        GOOD,
        {"host": f"localhost:{PORT}"},
        GOOD | {"origin": f"http://127.0.0.1:{PORT}"},
        GOOD | {"sec-fetch-site": "same-origin"},
    ],
)
def test_the_page_itself_is_served_below_its_token(headers):
    status, dressed, inner = answer(f"/{TOKEN}/c/0/state", headers)
    assert (status, inner) == (200, "/c/0/state")
    assert (
        "default-src 'none'" in dressed["content-security-policy"]
        and "unsafe" not in dressed["content-security-policy"]
    )
    assert dressed["referrer-policy"] == "no-referrer" and dressed["x-frame-options"] == "DENY"


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", GOOD),
        ("/c/0/state", GOOD),
        (f"/{TOKEN}x/", GOOD),
        (f"/{TOKEN[:-1]}/", GOOD),
        (f"//{TOKEN}/", GOOD),
        (f"/{TOKEN}/", {}),
        (f"/{TOKEN}/", {"host": "evil.example"}),
        (f"/{TOKEN}/", {"host": f"evil.example:{PORT}"}),
        (f"/{TOKEN}/", {"host": "127.0.0.1"}),
        (f"/{TOKEN}/", {"host": f"127.0.0.1:{PORT + 1}"}),
        (f"/{TOKEN}/", GOOD | {"origin": "https://evil.example"}),
        (f"/{TOKEN}/", GOOD | {"origin": "null"}),
        (f"/{TOKEN}/", GOOD | {"origin": f"http://127.0.0.1:{PORT + 1}"}),
        (f"/{TOKEN}/", GOOD | {"sec-fetch-site": "cross-site"}),
        (f"/{TOKEN}/", GOOD | {"sec-fetch-site": "same-site"}),
    ],
)
def test_everything_else_is_refused_before_it_is_looked_at(path, headers):
    status, dressed, inner = answer(path, headers)
    assert (status, inner) == (403, "")
    assert TOKEN not in json.dumps(dressed)


def test_the_server_listens_on_this_machine_alone_and_asks_for_json(serve, fitted):
    place = urlsplit(serve(fitted).address)
    assert place.hostname == "127.0.0.1" and len(place.path.strip("/")) >= 32

    def status(path: str, body: str | None = None, **headers: str) -> int:
        line = http.client.HTTPConnection(place.hostname, place.port, timeout=120)
        line.request("GET" if body is None else "POST", path, body, headers)
        return line.getresponse().status

    state, job = f"{place.path}c/0/state", f"{place.path}c/0/job"
    assert status(state) == 200
    assert (
        status("/c/0/state") == status(state, Host="evil.example") == status(state, Origin="http://evil.example") == 403
    )
    assert status(job, '{"do": "report"}', **{"Content-Type": "text/plain"}) == 415
    assert status(job, '{"do": "__init__"}', **{"Content-Type": "application/json"}) == 422
    assert (
        status(job, '{"do": "fit", "options": {"effect_files": ["/etc/x.py"]}}', **{"Content-Type": "application/json"})
        == 422
    )
    assert status(f"{place.path}static/..%2f__init__.py") == status(f"{place.path}c/9/state") == 404


def test_where_a_proposed_law_is_written_is_not_the_pages_to_say(fitted):
    app = AppState(fitted)
    handed = []
    app.worker.submit = lambda job: handed.append(job) or True  # nothing is to be worked on here
    try:
        with pytest.raises(InputError, match="not the page's to say"):
            app.begin(0, "propose", {"model": "base", "file": "/tmp/law.py"}, "")
        assert app.begin(0, "propose", {"model": "base"}, "")
    finally:
        app.close()
    file = handed[0]["options"]["file"]
    assert "effects/proposed_" in file and handed[0]["command"].endswith(f"base -o {file}")


def test_several_campaigns_do_not_share_a_folder_of_results(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "campaign.yaml").write_text("format: rfea-campaign/1\n")
    with pytest.raises(InputError, match=r"--out .*: is for one campaign"):
        AppState(tmp_path, tmp_path / "out")
    assert AppState(tmp_path / "a", tmp_path / "out").single


def test_typing_goes_over_no_law_that_was_not_opened(fitted, tmp_path):
    app, file = AppState(fitted), tmp_path / "mine.py"
    file.write_text("# a year's work")
    try:
        with pytest.raises(InputError, match="is there already: open it"):
            app.check_law(file, "# typed", keep=True)
        assert file.read_text() == "# a year's work"
        law_open(Asked(app, given={"file": str(file)}))
        with pytest.raises(InputError, match="no effect"):
            app.check_law(file, "# typed", keep=True)
        assert file.read_text() == "# typed"
    finally:
        app.close()
