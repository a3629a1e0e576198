"""Who may ask the studio: token, Host, Origin, limits, names; and what every answer carries."""

from __future__ import annotations

import hashlib
import io
import json
import socket
import stat
import time
import urllib.parse
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.errors import BadOption, FileError, MissingDependency
from dynident.studio import assets
from dynident.studio.folder import SAFE, Folder, safe_name
from dynident.studio.handler import StudioHandler
from dynident.studio.server import studio

# The fixture `client` asks as the studio's own page does; `ask` takes headers to change, with _ for -.


def test_the_page_opens_with_the_token_and_goes_on_with_the_cookie(running, client) -> None:
    address = urllib.parse.urlsplit(running.address)
    assert address.hostname == "127.0.0.1"
    status, headers, _ = client.ask("GET", f"/?{address.query}", Cookie=None, Origin=None)
    assert status == 200
    assert headers["set-cookie"] == running.session.gate.cookie
    assert "HttpOnly" in headers["set-cookie"] and "SameSite=Strict" in headers["set-cookie"]
    assert client.ask("GET", "/", Origin=None)[0] == 200
    assert client.ask("GET", "/api/state")[0] == 200


def test_every_path_is_shut_to_others(client) -> None:
    others: list[dict[str, str | None]] = [
        {"Cookie": None},
        {"Cookie": "dynident-studio-1=x"},
        {"Host": "evil.example"},
        {"Host": "127.0.0.1:1"},
        {"Host": None},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ]
    for path in ("/api/state", "/static/main.js", "/file?name=x", "/report?name=x"):
        for changes in others:
            status, headers, body = client.ask("GET", path, **changes)
            assert status == 403, (path, changes)
            assert json.loads(body).keys() == {"error"}
            assert "set-cookie" not in headers


def test_a_wrong_token_and_a_token_elsewhere_open_nothing(running, client) -> None:
    token = running.session.gate.token
    assert client.ask("GET", "/?token=wrong", Cookie=None, Origin=None)[0] == 403
    assert client.ask("GET", f"/api/state?token={token}", Cookie=None)[0] == 403
    assert token not in repr(running.session.gate)


def test_what_changes_something_says_where_it_comes_from(client) -> None:
    assert client.ask("POST", "/api/run", b"{}", Origin=None)[0] == 403
    assert client.ask("PUT", "/api/run", b"{}")[0] == 501


def test_every_answer_forbids_what_is_not_its_own(client) -> None:
    for path in ("/", "/api/state", "/static/studio.css", "/nothing", "/api/robot?name=nothing"):
        headers = client.ask("GET", path)[1]
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy and "script-src 'self';" in policy and "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["cache-control"] == "no-store"
        assert headers["cross-origin-resource-policy"] == "same-origin"


def test_it_listens_on_the_loopback_only(running) -> None:
    with socket.socket() as other:
        other.settimeout(2)
        with pytest.raises(OSError):
            other.connect(("127.0.0.2", running.session.gate.port))


HOSTILE = (
    "../../etc/passwd", "..\\..\\boot.ini", "/etc/passwd", ".hidden", "-o", "--report.html", "con.csv", "a\x00b.csv",
    "<script>alert(1)</script>.csv", "x" * 5000 + ".csv", "", ".", "..", "\u202elog.csv", "ü ö.csv", "a\nb.csv",
    "=HYPERLINK('x').csv",
)  # fmt: skip


def test_a_hostile_name_stays_in_the_folder(client) -> None:
    names = [client.upload(name, str(k).encode()) for k, name in enumerate(HOSTILE)]
    assert {path.name for path in client.folder.iterdir()} == set(names) and len(set(names)) == len(HOSTILE)
    assert {path.name for path in client.folder.parent.iterdir()} == {client.folder.name}
    for k, name in enumerate(names):
        status, headers, body = client.ask("GET", f"/file?{urllib.parse.urlencode({'name': name})}")
        assert (status, body) == (200, str(k).encode())
        assert headers["content-disposition"].startswith("attachment;")


@given(st.text(max_size=200))
def test_safe_names_are_plain_and_stay_as_they_are(name: str) -> None:
    kept = safe_name(name)
    assert 0 < len(kept) <= 115 and kept[0].isalnum() and set(kept) <= set(SAFE)
    assert safe_name(kept) == kept


def test_only_files_of_the_session_are_given_out(client) -> None:
    secret = "number 42"
    (client.folder.parent / "other").write_text(secret)
    (client.folder / "link").symlink_to(client.folder.parent / "other")
    (client.folder / ".part").write_text(secret)
    (client.folder / "sub").mkdir()
    (client.folder / "sub" / "inner").write_text(secret)
    for name in ("../other", "..%2fother", str(client.folder.parent / "other"), "link", ".part", "sub/inner"):
        for place in ("file", "report", "api/log", "api/robot", "api/case", "api/estimate", "api/motion"):
            status, _, body = client.ask("GET", f"/{place}?name={name}")
            assert status == 422 and secret.encode() not in body
        assert client.post("/api/remove", {"name": name})[0] == 422
        assert client.ask("GET", f"/static/{name}")[0] == 404


def test_uploads_have_limits(client) -> None:
    status, _, body = client.ask("POST", "/api/upload?name=a.csv", b"", Content_Length=str(10**10))
    assert status == 422 and b"--max-upload" in body
    assert client.ask("POST", "/api/upload?name=a.csv", b"0\r\n\r\n", Transfer_Encoding="chunked")[0] == 411
    assert client.ask("POST", "/api/upload?name=a.csv", b"x", Content_Length="-1")[0] == 411
    assert client.ask("POST", "/api/run", b"x" * 10, Content_Length="3000000")[0] == 413
    assert list(client.folder.iterdir()) == []


def test_half_an_upload_leaves_nothing(tmp_path: Path) -> None:
    folder = Folder(tmp_path, 1000)
    with pytest.raises(FileError, match="only 3 of 10 bytes came"):
        folder.receive("a.csv", io.BytesIO(b"abc"), 10)
    assert list(tmp_path.iterdir()) == []


def test_a_browser_that_goes_away_leaves_nothing_and_harms_nobody(client) -> None:
    given = "".join(f"{name}: {value}\r\n" for name, value in client.own.items())
    with socket.create_connection(("127.0.0.1", client.port)) as other:
        request = f"POST /api/upload?name=a.csv HTTP/1.1\r\n{given}Content-Length: 1000000\r\n\r\n"
        other.sendall(request.encode() + b"t\n" * 1000)
        end = time.monotonic() + 10
        while not list(client.folder.iterdir()) and time.monotonic() < end:
            time.sleep(0.01)
        assert [path.suffix for path in client.folder.iterdir()] == [".part"]
    end = time.monotonic() + 10
    while list(client.folder.iterdir()) and time.monotonic() < end:
        time.sleep(0.01)
    assert list(client.folder.iterdir()) == []
    kept = client.upload("b.csv", b"0" * 5_000_000)
    with socket.create_connection(("127.0.0.1", client.port)) as other:
        other.sendall(f"GET /file?name={kept} HTTP/1.1\r\n{given}\r\n".encode())
        assert other.recv(100).startswith(b"HTTP/1.1 200")
    assert client.names() == ["b.csv"]


def test_two_studios_stand_side_by_side(running, client) -> None:
    with studio() as other:
        theirs = other.session.gate.cookie.split(";")[0]
        assert theirs.partition("=")[0] != client.own["Cookie"].partition("=")[0]  # a browser keeps both
        assert client.ask("GET", "/api/state", Cookie=theirs)[0] == 403
        assert client.ask("GET", "/api/state", Cookie=f"{theirs}; {client.own['Cookie']}")[0] == 200
    assert client.ask("GET", "/api/state")[0] == 200


def test_a_body_that_stays_away_is_given_up(client, monkeypatch: pytest.MonkeyPatch) -> None:
    post = StudioHandler.do_POST

    def impatient(self: StudioHandler) -> None:
        self.connection.settimeout(0.1)  # the body alone is waited for that short: a busy machine sends headers late
        post(self)

    monkeypatch.setattr(StudioHandler, "do_POST", impatient)
    for path in ("/api/upload?name=a.csv", "/api/run"):
        status, headers, body = client.ask("POST", path, Content_Length="1000")
        assert status == 408 and headers["connection"] == "close"
        assert json.loads(body) == {"error": "the rest of the request did not come"}
    assert list(client.folder.iterdir()) == []


def test_a_session_holds_so_many_files_and_so_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Folder(tmp_path, 10)
    kept = [folder.receive("a.csv", io.BytesIO(b"x" * 10), 10) for _ in range(4)]
    assert kept == ["a.csv", "a_2.csv", "a_3.csv", "a_4.csv"]
    with pytest.raises(FileError, match="too many beside"):
        folder.receive("a.csv", io.BytesIO(b"x"), 1)
    monkeypatch.setattr("dynident.studio.folder.MAX_FILES", 4)
    folder.remove("a_4.csv")
    (tmp_path / "other.csv").write_text("")
    with pytest.raises(FileError, match="the session has 4 files"):
        folder.receive("a.csv", io.BytesIO(b"x"), 1)


def test_what_a_command_writes_has_a_name_that_nothing_in_the_folder_has(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    folder = tmp_path / "work"
    (folder / "plan_3").mkdir(parents=True)
    (folder / "plan_1.json").symlink_to(tmp_path / "mine")  # a command would write through it
    for name in ("plan_2-old.json", "Plan_4.csv", ".plan_5.json.part"):
        (folder / name).write_text("mine")
    session = Folder(folder)
    before = sorted(folder.iterdir())
    assert session.reserve("plan", ".json") == "plan_6.json"
    session.release(("plan_6.json",))
    assert sorted(folder.iterdir()) == before
    assert session.receive("plan_1.json", io.BytesIO(b"new"), 3) == "plan_1_2.json"
    assert session.receive("plan_3", io.BytesIO(b"new"), 3) == "plan_3_2"
    assert (folder / "plan_1.json").is_symlink() and (tmp_path / "mine").read_text() == "mine"


LAUGHS = b"""<?xml version="1.0"?>
<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;">]>
<robot name="&c;"><link name="base"/></robot>"""


@pytest.mark.parametrize(
    "text",
    [
        LAUGHS,
        b'<!DOCTYPE robot SYSTEM "http://127.0.0.1:1/robot.dtd"><robot name="a"><link name="base"/></robot>',
        b'<!DOCTYPE robot [<!ENTITY x SYSTEM "other">]><robot name="&x;"><link name="base"/></robot>',
        LAUGHS.decode().encode("utf-16"),
    ],
    ids=["entities", "a definition elsewhere", "an entity of a file", "in UTF-16"],
)
def test_a_description_with_a_document_type_is_refused(client, text: bytes) -> None:
    (client.folder / "other").write_text("number 42")
    kept = client.upload("arm.urdf", text)
    case = client.upload("case.yaml", f"case: 1\nrobot: {kept}\n".encode())
    for name in (kept, case):
        status, _, body = client.ask("GET", f"/api/robot?name={name}")
        assert status == 422 and b"number 42" not in body
        told = json.loads(body)["error"]
        assert told.startswith("arm.urdf") and "DOCTYPE" in told, told


def test_files_that_were_there_before_are_not_removed(client) -> None:
    (client.folder / "mine.csv").write_text("t\n")
    assert client.post("/api/remove", {"name": "mine.csv"})[0] == 422
    assert (client.folder / "mine.csv").exists()
    kept = client.upload("up.csv", b"t\n")
    assert client.post("/api/remove", {"name": kept})[0] == 200
    assert not (client.folder / kept).exists()


def test_a_report_is_shown_in_an_origin_of_its_own(client) -> None:
    kept = client.upload("report.html", b"<script>alert(1)</script>")
    _, headers, _ = client.ask("GET", f"/report?name={kept}")
    policy = headers["content-security-policy"]
    assert policy.startswith("sandbox allow-scripts;") and "allow-same-origin" not in policy
    assert "connect-src" not in policy and "default-src 'none'" in policy
    assert client.ask("GET", f"/report?name={client.upload('a.csv', b't')}")[0] == 422


def test_a_body_that_is_no_object_is_refused(client) -> None:
    halves = (b'{"verb": "\\ud800"}', b'{"\\udc00": 1}', b'{"verb": "\xed\xa0\x80"}')  # of surrogate pairs
    for body in (b"[]", b"{", b"null", b"[" * 100_000, b"\xff", b'{"a": %s}' % (b"1" * 5000), *halves):
        for path in ("run", "remove"):
            status, _, answer = client.ask("POST", f"/api/{path}", body)
            assert status == 400 and b"not one JSON object" in answer, body[:20]


def test_a_case_is_saved_with_every_character_and_with_no_half_of_one(client) -> None:
    name = client.upload("own.yaml", b"case: 1\n")
    text = "# \U0001f600 \u00e9"  # the first is sent as two halves
    digest = hashlib.sha256(b"case: 1\n").hexdigest()
    assert client.post("/api/case", {"name": name, "text": text, "sha256": digest})[0] == 200
    assert client.post("/api/case", {"name": name, "text": "# \ud800"})[0] == 400
    assert (client.folder / name).read_text(encoding="utf-8") == text


def test_columns_cannot_be_saved_into_a_case_that_is_no_text(client) -> None:
    name = client.upload("own.yaml", b"case: 1 # \xe9\n")
    units = {"time": "s", "position": "SI"}
    status, refused = client.post(
        "/api/case", {"name": name, "joints": ["a"], "signals": {"q": ["q1"]}, "time": "t", "units": units}
    )
    assert status == 422 and refused["error"] == "own.yaml: byte 10 is not UTF-8 text; save the file as UTF-8"


def test_columns_that_are_no_list_of_names_are_refused(client) -> None:
    name = client.upload("a.csv", b"t,q1\n" + b"".join(b"%d,1\n" % k for k in range(20)))
    for columns in (b"{", b"null", b"{}", b"q1", b"\xff", b"[" * 3000, b"1" * 5000, b'["\\ud800"]'):
        status, _, answer = client.ask("GET", f"/api/log?name={name}&columns={urllib.parse.quote_from_bytes(columns)}")
        assert status == 400 and b"not a JSON list" in answer
    for text, key in (("[]", "header"), ('["q1"]', "curves")):
        assert key in client.get(f"/api/log?name={name}&columns={urllib.parse.quote(text)}")


def test_an_address_that_is_none_has_an_answer(client) -> None:
    for target in ("http://[/", "http://[::1/api/state"):
        status, headers, body = client.ask("GET", target)
        assert status == 400 and headers["connection"] == "close" and b"not valid" in body


def test_a_session_without_a_folder_is_gone_at_its_end() -> None:
    with studio() as running:
        place = running.session.folder.path
        assert stat.S_IMODE(place.stat().st_mode) == 0o700
    assert not place.exists()


def test_settings_that_cannot_be_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such folder"), studio(work=tmp_path / "none"):
        pass
    with pytest.raises(BadOption, match="--max-upload"), studio(max_upload_mb=0):
        pass
    with studio() as running, pytest.raises(BadOption, match="--port"), studio(port=running.session.gate.port):
        pass


def test_three_js_is_what_its_authors_built(monkeypatch: pytest.MonkeyPatch, client) -> None:
    pytest.importorskip("trimesh", reason="the studio extra is not installed")
    status, headers, body = client.ask("GET", "/static/three.js")
    assert (status, headers["content-type"]) == (200, "text/javascript; charset=utf-8")
    assert body.startswith(b"/**\n * @license") and b"SPDX-License-Identifier: MIT" in body[:200]
    assert body.rstrip().endswith(b"}));") and b"B64GLTF" not in body
    assets.three_js.cache_clear()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependency, match=r"dynident\[studio\]"):
        assets.three_js()
