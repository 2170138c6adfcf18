#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""`rig run --foxglove` read by Foxglove's own client (@foxglove/ws-protocol, with ws, from npm): scan, followed beam, stage, step and
messages of a simulated run. Skipped (77) where node or npm is not there, or npm cannot fetch the two packages.

    foxglove_test.py BIN WORK     BIN: folder of rig and rig-sim; WORK: where npm keeps the packages"""
import json, os, re, shutil, subprocess, sys, tempfile

VERSIONS = ["@foxglove/ws-protocol@0.8.0", "ws@8"]
BENCH = """{
  "schema": "bench/1",
  "lidar": {"model": "UST-10LX", "mount": {"x_mm": {"value": 30, "u": 15}, "y_mm": {"value": 0, "u": 15}}},
  "stage": {"language": "zaber", "model": "X-RSW60A", "limits_deg": [-170, 170], "speed_deg_s": 20},
  "targets": [{"name": "board", "from_mm": [1400, -350], "to_mm": [1400, 350], "reflectance": 0.85},
              {"name": "wall", "from_mm": [2600, -2400], "to_mm": [2600, 2400], "reflectance": 0.6}],
  "known": [{"mechanism": "range-noise", "parameters": {"sigma_mm": 5}}]
}"""
PROCEDURE = """procedure: first-look
title: First look at a board
steps:
  - home
  - sweep: {start_deg: -10, stop_deg: 10, step_deg: 5, samples: 40}
  - capture: {samples: 60, target: board}
"""


def skip(why):
    print(f"skipped: {why}")
    sys.exit(77)


def packages(work):
    """The folder of Foxglove's client and ws, fetched once."""
    for program in ("node", "npm"):
        if not shutil.which(program):
            skip(f"{program} is not installed")
    modules = os.path.join(work, "node_modules")
    if not os.path.exists(os.path.join(modules, "@foxglove", "ws-protocol")) or not os.path.exists(os.path.join(modules, "ws")):
        os.makedirs(work, exist_ok=True)
        fetched = subprocess.run(["npm", "install", "--prefix", work, "--no-audit", "--no-fund", "--no-save", *VERSIONS],
                                 stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
        if fetched.returncode:
            skip("npm cannot fetch " + " and ".join(VERSIONS) + ":\n" + fetched.stderr[-500:])
    return modules


def main(programs, work):
    modules = packages(work)
    folder = tempfile.TemporaryDirectory(prefix="rig-foxglove-")
    at = lambda name: os.path.join(folder.name, name)
    for name, text in ("bench.json", BENCH), ("look.yaml", PROCEDURE):
        with open(at(name), "w") as out:
            out.write(text)
    sim = subprocess.Popen([os.path.join(programs, "rig-sim"), "--bench", at("bench.json"), "--lidar-port", "0", "--stage-link", at("stage"),
                            "--speed", "2"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    run = client = None
    try:
        ready = json.loads(sim.stdout.readline())
        run = subprocess.Popen([os.path.join(programs, "rig"), "run", at("look.yaml"), "--bench", at("bench.json"), "--lidar", ready["lidar"],
                                "--stage", ready["stage"], "--out", at("look.rig"), "--yes", "--foxglove", "0"],
                               stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        url = None
        for line in run.stderr:
            found = re.search(r"foxglove: (ws://\S+)", line)
            if found:
                url = found.group(1)
                break
        assert url, "rig did not say where it serves"
        client = subprocess.Popen(["node", os.path.join(os.path.dirname(os.path.abspath(__file__)), "foxglove_client.cjs"), url],
                                  stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, env={**os.environ, "NODE_PATH": modules})
        said, _ = client.communicate(timeout=150)
        rest = run.stderr.read()
        assert run.wait(timeout=60) == 0, rest
    finally:
        for process in (run, client, sim):
            if process and process.poll() is None:
                process.kill()
                process.wait()
        folder.cleanup()
    seen = json.loads(said)
    assert seen["errors"] == [], seen["errors"]
    assert seen["protocol"] == "foxglove.websocket.v1" and seen["info"]["capabilities"] == [], seen["info"]
    wanted = {"/scan": "foxglove.LaserScan", "/tf": "foxglove.FrameTransform", "/messages": "foxglove.Log", "/beam": "rig.Beam",
              "/stage": "rig.Stage", "/step": "rig.Step", "/results": "rig.Results"}
    assert {topic: about[0] for topic, about in seen["schemas"].items()} == wanted, seen["schemas"]
    assert all(about[1:] == ["json", "object"] for about in seen["schemas"].values()), seen["schemas"]
    assert set(seen["counts"]) >= set(wanted) - {"/messages"}, seen["counts"]
    scan = seen["lasts"]["/scan"]
    assert len(scan["ranges"]) == 1081 and len(scan["intensities"]) == 1081
    assert abs(scan["start_angle"] + 2.35619) < 1e-4 and abs(scan["end_angle"] - 2.35619) < 1e-4, scan["start_angle"]
    ahead = [r for r in scan["ranges"][536:545] if r > 0]
    assert ahead and all(1.33 < r < 1.42 for r in ahead), ahead  # the board, 1.4 m from the axis, seen from 30 mm before it
    assert 1330 < seen["lasts"]["/beam"]["range_mm"] < 1420, seen["lasts"]["/beam"]
    assert seen["counts"]["/stage"] > 3 and abs(seen["lasts"]["/tf"]["translation"]["x"]) <= 0.0301, seen["lasts"]["/tf"]
    assert seen["steps"][-1] == "done" and seen["lasts"]["/step"]["of"] >= 3, (seen["steps"], seen["lasts"]["/step"])
    assert any("not served" in status for status in seen["statuses"]), seen["statuses"]
    print(f"Foxglove's client got {seen['counts']}")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
