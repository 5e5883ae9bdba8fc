"""A page of another site in the same browser changes, follows and reads nothing here, and has none of the pages in a frame."""

from __future__ import annotations

import json
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

from playwright.sync_api import Browser

from .conftest import RunningSystem, sign_in

ATTACK = """async url => {
  const body = '{"effect": "Jar002 isOn Platform001"}';
  const outcome = {};
  for (const type of ['text/plain', 'application/x-www-form-urlencoded']) {
    await fetch(`${url}/api/tasks`, {method: 'POST', mode: 'no-cors', headers: {'Content-Type': type}, body}).catch(() => {});
  }
  const asJson = {method: 'POST', headers: {'Content-Type': 'application/json'}, body};
  outcome.json = await fetch(`${url}/api/tasks`, asJson).then(() => true, () => false);
  outcome.map = await fetch(`${url}/api/map`).then(() => true, () => false);
  for (const path of ['/api/live', '/api/poses']) {
    outcome[path] = await new Promise(done => {
      const socket = new WebSocket(url.replace('http', 'ws') + path);
      socket.onopen = () => done(true);
      socket.onerror = () => done(false);
    });
  }
  const form = document.createElement('form');
  Object.assign(form, {method: 'POST', action: `${url}/api/tasks`, target: 'sink', enctype: 'text/plain'});
  const field = Object.assign(document.createElement('input'), {name: '{"effect": "Jar002 isOn Platform001", "label": "', value: '"}'});
  form.append(field);
  const frame = Object.assign(document.createElement('iframe'), {name: 'sink'});
  document.body.append(frame, form);
  const loaded = new Promise(done => { frame.onload = done; });
  form.submit();
  await loaded;
  const page = Object.assign(document.createElement('iframe'), {src: url});
  const shown = new Promise(done => { page.onload = done; });
  document.body.append(page);
  await shown;
  return outcome;
}"""


class Elsewhere(BaseHTTPRequestHandler):
    """The server of another site."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><body>Kittens</body>")

    def log_message(self, format: str, *arguments: object) -> None:
        pass


@contextmanager
def another_site() -> Iterator[str]:
    server = HTTPServer(("127.0.0.1", 0), Elsewhere)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def tasks(system: RunningSystem) -> list[object]:
    with urllib.request.urlopen(f"{system.url}/api/tasks") as answer:
        rows: list[object] = json.load(answer)["rows"]
        return rows


def test_the_page_of_another_site_has_no_power_here(system: RunningSystem, browser: Browser) -> None:
    earlier_tasks, profile = tasks(system), browser.new_context()
    sign_in(profile, system.url)
    page = profile.new_page()
    with another_site() as address:
        page.goto(address)
        outcome = page.evaluate(ATTACK, system.url)
        pages_shown = [frame.url for frame in page.frames if frame.query_selector("header")]
    profile.close()
    assert outcome == {"json": False, "map": False, "/api/live": False, "/api/poses": False}
    assert not pages_shown, "a page of another site shows pages of this one as its own"
    assert tasks(system) == earlier_tasks, "nothing was obeyed"
