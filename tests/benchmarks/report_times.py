"""How long a report with a record of 150,000 points takes to open and to zoom, in a headless Chromium.

    python tests/benchmarks/report_times.py [--samples N] [--width PIXELS] [--repeat K]

Printed are the browser's own clock (navigation entry, from the start of the navigation to the load event, and to the
first complete drawing), the processor time of all its processes beyond that of an empty page, and the time of one step
of a zoom: data of the stretch, scales and drawing of all panels. Where other work shares the machine the clock says
less than the processor time.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from helpers.browser import BROWSER, processor_time

from lpvid.report import Curve, Page, Panel, Section, Traces, render

STEPS = 40
"""steps of the zoom gesture"""
SCRIPT = """
addEventListener('load', async () => {
  await window.lpvidTraces.all();
  await Promise.resolve();
  const drawn = performance.now(), figure = window.lpvidTraces.figures[0], [a, b] = figure.whole, took = [];
  let points = figure.charts.map(c => c.data[0].length);
  for (let k = 1; k <= STEPS; k++) {
    const half = 0.5 * (b - a) * Math.pow(0.85, k), before = performance.now();
    figure.show([0.5 * (a + b) - half, 0.5 * (a + b) + half]);
    await Promise.resolve();
    took.push(performance.now() - before);
    points = points.map((most, i) => Math.max(most, figure.charts[i].data[0].length));
  }
  took.sort((x, y) => x - y);
  const entry = performance.getEntriesByType('navigation')[0];
  await fetch('/measured', {method: 'POST', body: JSON.stringify({load: entry.loadEventStart, drawn,
    middle: took[STEPS >> 1], worst: took[STEPS - 1], points})});
});
"""


def report(n: int) -> str:
    """A page with a force, a model of it and a current, of n samples each."""
    rng, t = np.random.default_rng(0), np.arange(n) / 500.0
    y = 900 * np.sin(2 * np.pi * 1.3 * t) + 200 * np.sin(2 * np.pi * 17.0 * t) + 60 * rng.standard_normal(n)
    model = 0.97 * y + 20 * rng.standard_normal(n)
    current = np.repeat(np.arange(-(-n // 100)) % 3, 100)[:n].astype(float)
    force = Panel("force [N]", (Curve("measured", t, y), Curve("free run", t, model, "model")))
    drive = Panel("current [A]", (Curve("current", t, current, "input", stepped=True),))
    return render(Page("A long record", "Free run.", "good", (), (),
                       (Section("Over time", (Traces((force, drive), "A run."),)),)))


def clocked(html: str, folder: Path, width: int, limit: float = 180.0) -> dict[str, Any]:
    """What the script measured by the browser's own clock, sent to a server on this machine that has the page."""
    assert BROWSER is not None
    page = html.replace("</body>", f"<script>const STEPS = {STEPS};{SCRIPT}</script></body>").encode()
    measured: list[dict[str, Any]] = []
    done = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200 if self.path == "/" else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(page if self.path == "/" else b"")

        def do_POST(self) -> None:
            measured.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()
            done.set()

        def log_message(self, format: str, *args: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
                   f"--user-data-dir={folder / 'profile'}", f"--window-size={width},2000",
                   f"http://127.0.0.1:{server.server_port}/"]
        browser = subprocess.Popen([*command, "--remote-debugging-port=0"], stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL)
        try:
            done.wait(limit)
        finally:
            browser.terminate()
            browser.wait()
            server.shutdown()
    return measured[0] if measured else {}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="time to open and to zoom a report with a long record")
    parser.add_argument("--samples", type=int, default=150_000)
    parser.add_argument("--width", type=int, default=1200)
    parser.add_argument("--repeat", type=int, default=3)
    asked = parser.parse_args()
    html = report(asked.samples)
    print(f"{asked.samples} samples, 3 curves, {len(html.encode()) / 1e6:.2f} MB")
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        rows = [clocked(html, folder, asked.width) for _ in range(asked.repeat)]
        for name, text in (("load", "load event, clock, ms"), ("drawn", "drawn in full, clock, ms"),
                           ("middle", "one step of a zoom, median, ms"), ("worst", "one step of a zoom, worst, ms")):
            print(f"{text}: " + ", ".join(f"{row[name]:.1f}" for row in rows if row))
        print(f"points drawn in each panel at most: {rows[0].get('points', '–')}")
        full, empty = folder / "full.html", folder / "empty.html"
        full.write_text(html)
        empty.write_text("<!DOCTYPE html><html lang=en><title>x</title><body>x</body></html>")
        processor_time(empty, folder / "p")  # the profile is made once
        spent = np.array([[processor_time(f, folder / "p") for f in (empty, full)] for _ in range(asked.repeat)])
        print(f"processors beyond an empty page, s: {spent[:, 1].min() - spent[:, 0].min():.2f}")


if __name__ == "__main__":
    main()
