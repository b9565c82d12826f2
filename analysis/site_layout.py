"""Which pages of a built site scroll sideways, at the widths of phones, tablets and screens.

Run as ``python analysis/site_layout.py docs/_build/html``, with Chromium in the path. It exits with
code 1 if a page is wider than its window, and names the elements that stick out.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

WIDTHS = (360, 768, 1366, 1440, 1920)
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--mute-audio"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-dev-shm-usage", "--hide-scrollbars", "--window-size=2000,1000"),
)
SCRIPT = r"""<!doctype html><iframe style="border:0;height:900px"></iframe><script>
const frame = document.querySelector("iframe"), wide = [];
const loaded = () => new Promise(done => { frame.onload = done; });
const bodies = "html, body, .page, .main, .content, article";  // what must not scroll sideways
function scrolls(element) {  // inside of a table or a block of code that scrolls by itself?
  for (let up = element.parentElement; up && !up.matches(bodies); up = up.parentElement)
    if (getComputedStyle(up).overflowX !== "visible") return true;
  return false;
}
function culprits(page, width) {
  const out = [...page.body.querySelectorAll(".content *")].filter(e => {
    const box = e.getBoundingClientRect();
    return box.width > 0 && box.right > width + 0.5 && !scrolls(e);
  });
  return out.slice(0, 3).map(e => `${e.tagName.toLowerCase()}.${e.className}: ` +
    (e.textContent || "").replace(/\s+/g, " ").slice(0, 40));
}
async function measure() {
  for (const name of PAGES) {
    const ready = loaded();
    frame.src = name;
    await ready;
    for (const width of WIDTHS) {
      frame.style.width = width + "px";
      const page = frame.contentDocument;
      const needed = [...page.querySelectorAll(bodies)].filter(e =>
        e.matches("html") || getComputedStyle(e).overflowX !== "visible"
      ).map(e => e.scrollWidth - e.clientWidth);
      const beyond = Math.max(...needed);
      if (beyond > 0) wide.push([name, width, beyond, culprits(page, width)]);
    }
  }
  await fetch("/", {method: "POST", body: JSON.stringify(wide)});
}
measure();
</script>"""


class Site(SimpleHTTPRequestHandler):
    """The built site, a page that measures all others, and what it sends back."""

    def __init__(self, *args: Any, measuring: str, results: list[Any], **kwargs: Any) -> None:
        self.measuring, self.results = measuring, results
        super().__init__(*args, **kwargs)

    def do_GET(self) -> None:
        """Send the page that measures, or one of the site."""
        if self.path != "/measuring":
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        self.wfile.write(self.measuring.encode())

    def do_POST(self) -> None:
        """Keep what was measured."""
        self.results.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()
        threading.Thread(target=self.server.shutdown).start()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Say nothing about requests."""


def too_wide(site: Path, timeout_s: float = 600.0) -> list[tuple[str, int, int, list[str]]]:
    """Return page, width of the window, pixels beyond it and what sticks out, for each wide page.

    Raises:
        FileNotFoundError: there is no Chromium, or the folder has no pages.
        TimeoutError: the browser has not measured all pages in this time.
    """
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    pages = sorted(str(page.relative_to(site)) for page in site.rglob("*.html"))
    pages = [page for page in pages if not page.startswith(("_static/", "_sources/"))]
    if not chromium or not pages:
        raise FileNotFoundError("no chromium in the path" if pages else f"no pages in {site}")
    script = SCRIPT.replace("PAGES", json.dumps(pages)).replace("WIDTHS", json.dumps(WIDTHS))
    results: list[Any] = []
    handler = partial(Site, directory=str(site), measuring=script, results=results)
    with (
        ThreadingHTTPServer(("127.0.0.1", 0), handler) as server,
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
    ):
        url = f"http://127.0.0.1:{server.server_address[1]}/measuring"
        browser = subprocess.Popen(
            [chromium, *FLAGS, f"--user-data-dir={profile}", "--remote-debugging-port=0", url],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        timer = threading.Timer(timeout_s, server.shutdown)
        timer.start()
        try:
            server.serve_forever(poll_interval=0.1)
        finally:
            timer.cancel()
            browser.terminate()
            browser.wait()
    if not results:
        raise TimeoutError(f"the pages were not measured in {timeout_s:.0f} s")
    return [tuple(row) for row in results[0]]


def main() -> int:
    """Print the pages that are too wide."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("site", type=Path, help="the folder of the built site")
    wide = too_wide(parser.parse_args().site)
    for page, width, beyond, out in wide:
        print(f"{page} at {width} px is {beyond} px too wide: {'; '.join(out)}")
    print(f"{len(wide)} pages and widths scroll sideways")
    return 1 if wide else 0


if __name__ == "__main__":
    sys.exit(main())
