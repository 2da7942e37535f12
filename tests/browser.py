"""Pages in a real browser without a network: their picture, and what they complain of or ask for."""

import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

FLAGS = (
    *("--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--hide-scrollbars", "--window-size=800,600", "--virtual-time-budget=6000", "--enable-logging=stderr"),
    "--host-resolver-rules=MAP * ~NOTFOUND",
)
# The browser's log has errors and remarks on one level: the page itself says what went wrong in it.
WATCH = """<script>
const complaints = [];
console.error = (...words) => complaints.push(words.join(" "));
addEventListener("error", e => complaints.push(e.message || "cannot load " + (e.target.src || e.target.href)), true);
addEventListener("unhandledrejection", e => complaints.push(String(e.reason)));
new PerformanceObserver(list => list.getEntries().forEach(e => {
  if (!/^(data|blob|file):/.test(e.name)) complaints.push("asks for " + e.name);
})).observe({type: "resource", buffered: true});
const Socket = WebSocket;
WebSocket = function (address) { complaints.push("connects to " + address); return new Socket(address); };
setTimeout(() => console.log("COMPLAINTS" + JSON.stringify(complaints) + "END"), 5000);
</script>"""


@dataclass(frozen=True)
class Seen:
    """A page as it was seen."""

    picture: bytes
    complaints: list[str]


def open_page(page: Path, script: str = "") -> Seen:
    """Open a copy of the page, run `script` in it after two seconds, and look at it after six.

    Without a browser the test is skipped and says so.
    """
    names = ("chromium", "chromium-browser", "google-chrome")
    browser = next((found for found in map(shutil.which, names) if found), None)
    if browser is None:
        pytest.skip("there is no Chromium on this machine to open the page in")
    text = page.read_text(encoding="utf-8")
    watched, picture = page.with_name(f"watched-{page.name}"), page.with_suffix(".png")
    later = f"<script>setTimeout(() => {{ {script} }}, 2000);</script>"
    watched.write_text(re.sub(r"<head>|<body>", lambda tag: tag[0] + WATCH + later, text, count=1), encoding="utf-8")
    command = [browser, *FLAGS, f"--screenshot={picture}", watched.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True)
    told = re.search(r"COMPLAINTS(.*?)END", done.stderr)
    assert told is not None, f"the page never came to its end:\n{done.stderr}"
    return Seen(picture.read_bytes(), json.loads(told[1]))
