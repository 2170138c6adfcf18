#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The live page in a headless browser, end to end: a simulated run is started, a prompt confirmed, an answer typed, steps advance, the
run pauses, goes on and is aborted; the session keeps what was captured. `rig watch` then shows it.

    live_page_test.py BIN [PICTURES]     BIN: folder of rig and rig-sim; PICTURES: folder for screenshots, if wanted"""
import json, os, re, socket, sqlite3, subprocess, sys, tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from browser import Browser, environment, need, until

BENCH = """{
  "schema": "bench/1",
  "lidar": {"model": "UST-10LX", "mount": {"x_mm": {"value": 0, "u": 15}, "y_mm": {"value": 0, "u": 15}}},
  "stage": {"language": "zaber", "model": "X-RSW60A", "limits_deg": [-170, 170], "speed_deg_s": 20},
  "targets": [
    {"name": "board", "from_mm": [1400, -350], "to_mm": [1400, 350], "reflectance": 0.85},
    {"name": "wall", "from_mm": [2600, -2400], "to_mm": [2600, 2400], "reflectance": 0.6},
    {"name": "left", "from_mm": [-1500, 2400], "to_mm": [2600, 2400], "reflectance": 0.6},
    {"name": "right", "from_mm": [-1500, -2400], "to_mm": [2600, -2400], "reflectance": 0.6}],
  "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": 5}}]
}"""
PROCEDURE = """procedure: first-look
title: First look at a board
steps:
  - home
  - prompt:
      title: Place the white board
      text: Stand the board upright, 1.4 m before the stage, squarely to its zero direction.
      ask: {name: rail, unit: mm, min: 1300, max: 1500}
      until: {beams_deg: [-3, 3], within_mm: [1350, 1450]}
  - prompt:
      title: Board at 1.6 m
      picture: board.svg
      place: {target: board, at_mm: 1600}
  - sweep: {start_deg: -10, stop_deg: 10, step_deg: 5, samples: 40}
  - capture: {samples: 100000, target: board}
"""

PICTURE = '<svg xmlns="http://www.w3.org/2000/svg" width="320" height="160"><rect width="320" height="160" fill="#dde"/><path d="M60 20v120" stroke="#024" stroke-width="8"/></svg>'
SHORT = """procedure: noise
title: Noise of the bench
steps:
  - home
  - prompt: {title: "Is everything quiet?"}
  - capture: {samples: 60, target: board}
  - fit: {kind: noise}
  - report: {file: noise.html}
limits:
  - {name: Noise, of: noise.noise_median_mm, max: 30}
"""


def place(ready, **what):
    """Moves something on the simulated bench."""
    host, port = ready["operator"].rsplit(":", 1)
    with socket.create_connection((host, int(port)), timeout=20) as line:
        line.sendall((json.dumps({"place": what}) + "\n").encode())
        assert json.loads(line.makefile().readline())["ok"]


def lines_until(stream, pattern):
    """The first match of the pattern in a program's lines."""
    seen = []
    for line in stream:
        seen.append(line)
        match = re.search(pattern, line)
        if match:
            return match
    raise AssertionError(f"no line like {pattern} in:\n" + "".join(seen))


def state(page):
    return page.run("return state;")


def main(programs, pictures):
    need("chromium", "chromedriver")
    folder = tempfile.TemporaryDirectory(prefix="rig-live-")
    at = lambda name: os.path.join(folder.name, name)
    for name, text in ("bench.json", BENCH), ("look.yaml", PROCEDURE), ("board.svg", PICTURE), ("noise.yaml", SHORT):
        with open(at(name), "w") as out:
            out.write(text)
    keep = lambda page, name: pictures and page.picture(os.path.join(pictures, name))
    sim = subprocess.Popen([os.path.join(programs, "rig-sim"), "--bench", at("bench.json"), "--lidar-port", "0", "--stage-link", at("stage"),
                            "--speed", "4"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment())
    run = watch = None
    try:
        ready = json.loads(sim.stdout.readline())
        run = subprocess.Popen([os.path.join(programs, "rig"), "run", at("look.yaml"), "--bench", at("bench.json"), "--lidar", ready["lidar"],
                                "--stage", ready["stage"], "--out", at("look.rig"), "--live"],
                               stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment())
        url = lines_until(run.stderr, r"(http://\S+)").group(1)
        with Browser() as page:
            page.open(url)
            # The prompt waits for the operator, who types what the rail reads.
            until("the prompt", lambda: page.text("#title") == "Place the white board")
            until("what the rig itself sees", lambda: "✓" in (page.text("#check") or ""))
            assert "1.4 m before the stage" in page.text("#text"), page.text("#text")
            keep(page, "live-prompt.png")
            page.click("#confirm")  # Without an answer the prompt stays.
            assert state(page)["prompt"]["title"] == "Place the white board"
            assert "left" not in page.text("#left") and "waiting for you" in page.text("#left"), page.text("#left")
            # From here on the page lies in the background: what it would play and show is counted.
            page.run("sound = {currentTime: 0, state: 'running', createOscillator() { window.tones = (window.tones || 0) + 1;"
                     " return {frequency: {}, connect() {}, start() {}, stop() {}}; }, createGain() { return {gain: {}, connect() {}}; }};"
                     "window.Notification = class { constructor(title, more) { window.shown = (window.shown || []).concat(more.body); } };"
                     "Notification.permission = 'granted'; Object.defineProperty(document, 'hidden', {get: () => true, configurable: true});")
            page.type("#value", "900")
            page.click("#confirm")
            until("the answer refused beside it", lambda: "900 mm is outside 1300 to 1500 mm" in (page.text("#refusal") or ""))
            page.run("document.querySelector('#value').value = '';")
            page.type("#value", "1402")
            page.click("#confirm")
            # A target that is to be moved: its picture, where it should stand, and how far it is from there.
            until("the second prompt", lambda: page.text("#title") == "Board at 1.6 m")
            until("the way to go", lambda: re.fullmatch(r"Move it (19|20)\d mm farther away", page.text("#goal") or ""))
            until("the picture", lambda: page.run("return document.querySelector('#picture').naturalWidth;") == 320)
            ghost = state(page)["prompt"]["ghost"]
            assert [abs(x - 1600) < 2 for x, y in ghost] == [True, True], ghost
            assert "Board at 1.6 m" in page.run("return calls;")
            assert page.run("return [window.tones, window.shown];") == [2, ["Board at 1.6 m"]]  # Two tones, one notification.
            page.run("delete document.hidden; sound = null;")
            keep(page, "live-ghost.png")
            page.click("#confirm")
            until("what is seen instead", lambda: "not in its place" in (page.text("#refusal") or ""))
            place(ready, target="board", shift_mm=200)
            until("the board in place", lambda: (page.text("#goal") or "").startswith("In place"))
            page.click("#confirm")
            # The step advances; the page follows.
            until("a capture under way", lambda: "step 5 (5 of 5)" in page.text("#phase") and state(page)["progress"]["unit"] == "scans"
                  and state(page)["progress"]["done"] > 100)
            assert page.run("return [...document.querySelectorAll('#steps li')].map(e => e.className);") == ["recorded"] * 4 + ["running"]
            assert re.search(r"^[\d,]+ of 100,000 scans · .* left$", page.text("#left")), page.text("#left")
            ranges = state(page)["scan"]["range_mm"]
            ahead = [r for r in ranges[len(ranges) // 2 - 4:len(ranges) // 2 + 5] if r > 0]
            assert ahead and all(1590 < r < 1660 for r in ahead), ahead  # 1600 mm / cos(10 deg), noise of 5 mm.
            drawn = page.run("const c = document.querySelector('#scan'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
                             "let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n;")
            assert drawn > 1000, f"the scan's picture has {drawn} pixels"
            keep(page, "live-run.png")
            # Pause takes hold when the capture is done, and can be taken back; abort asks first.
            page.click("#pause")
            until("the pause", lambda: page.text("#pause").startswith("Pausing"))
            page.click("#pause")
            until("the pause taken back", lambda: page.text("#pause") == "Pause")
            page.click("#abort")
            assert "everything captured so far is kept" in page.accept_dialog()
            until("the end", lambda: page.text("#phase").startswith("Aborted"))
            assert "rig resume" in page.text("#goon") and "look.rig" in page.text("#goon"), page.text("#goon")
            keep(page, "live-aborted.png")
            errors = [error for error in page.errors() if "ERR_CONNECTION_REFUSED" not in error]  # The run has ended.
            assert errors == [], errors
            said = run.stderr.read()
            assert run.wait(timeout=60) == 1, said
        with sqlite3.connect(at("look.rig")) as session:
            assert session.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
            counts = [row[0] for row in session.execute("SELECT count(*) FROM scan GROUP BY capture ORDER BY capture")]
        assert counts[:5] == [40] * 5, counts
        # A run to its end, on a screen as narrow as a phone's: the verdict, and a link that works when the program has ended.
        place(ready, target="board", shift_mm=0)
        run = subprocess.Popen([os.path.join(programs, "rig"), "run", at("noise.yaml"), "--bench", at("bench.json"), "--lidar", ready["lidar"],
                                "--stage", ready["stage"], "--out", at("noise.rig"), "--live"],
                               stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment())
        url = lines_until(run.stderr, r"(http://\S+)").group(1)
        with Browser(390, 800) as page:
            page.open(url)
            until("the prompt", lambda: page.text("#title") == "Is everything quiet?")
            assert page.run("return document.documentElement.scrollWidth <= window.innerWidth;"), "the page is wider than the screen"
            keep(page, "live-phone.png")
            page.click("#confirm")
            until("the verdict", lambda: page.text("#verdict") == "PASS")
            said = run.stderr.read()
            assert run.wait(timeout=60) == 0, said
            assert "noise.html" in page.text("#report"), page.text("#report")
            assert "Noise" in page.run("return state.end.html;")
            assert page.run("return document.querySelector('#report').href;").startswith("blob:")
            keep(page, "live-done.png")
        # The same page for a session on disk.
        watch = subprocess.Popen([os.path.join(programs, "rig"), "watch", at("look.rig")], stdin=subprocess.DEVNULL,
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment())
        url = lines_until(watch.stdout, r"(http://\S+)").group(1)
        with Browser() as page:
            page.open(url)
            until("the session", lambda: page.run("return !!(state.scan && state.scan.range_mm);"))
            keep(page, "watch.png")
            assert page.errors() == []
    finally:
        for process in (run, watch, sim):
            if process and process.poll() is None:
                process.kill()
                process.wait()
        folder.cleanup()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None)
