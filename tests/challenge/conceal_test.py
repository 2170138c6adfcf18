#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Conceals every kind once and checks the session against the contract of session files.

  conceal_test.py CONCEAL [EVERY]    EVERY: only every so-manieth kind
"""
import json, pathlib, sqlite3, statistics, struct, subprocess, sys, tempfile

conceal = sys.argv[1]
every = int(sys.argv[2]) if len(sys.argv) > 2 else 1
listing = subprocess.run([conceal, "--list"], check=True, capture_output=True, text=True).stdout
kinds = {}
for line in listing.splitlines():
    if line.startswith("  "):
        name, scenes = line.split(":")
        kinds[name.strip()] = scenes.split()
small = ["ladder", "reflectance-ladder", "boards", "two-sided", "edge", "panels", "box"]

lights = ["radiometry", "window-dirt", "specular", "unknown-stripe"]  # their benches claim to know the law of intensity


def check(kind, scene, folder):
    command = [conceal, "--scene", scene, "--snr", "20", "--seed", "11", "--no-rivals", "--out", folder, "--name", "case"]
    if kind:
        command += ["--kind", kind]
    subprocess.run(command, check=True, capture_output=True)
    truth = json.loads((pathlib.Path(folder) / "case.truth.json").read_text())
    if kind and kind not in ("mixed-pixel", "rounding"):
        reached = truth["snr"][kind]
        # the truth file says what was reached; jumps at the ends of boards keep some from being hit exactly
        assert 0 < reached < 25, (kind, scene, reached)
    database = sqlite3.connect(pathlib.Path(folder) / "case.rig")
    assert database.execute("PRAGMA application_id").fetchone()[0] == 0x52494731
    bench = json.loads(database.execute("SELECT value FROM session WHERE key='bench'").fetchone()[0])
    assert bench["schema"] == "bench/1" and [k["mechanism"] for k in bench["known"]] == ["range-noise"] + ["radiometry"] * (kind in lights)
    count = 0
    for first, last, blob, light in database.execute(
            "SELECT first_step, last_step, range_mm, intensity FROM scan JOIN capture ON capture.id = scan.capture"):
        assert len(blob) == len(light) == 2 * (last - first + 1)
        count += 1
    assert count > 0
    values = struct.unpack(f"<{len(blob) // 2}H", blob)
    assert any(values), (kind, scene)
    database.close()


def check_pair(folder):
    """A receiver that clips has steep pulses, which light's noise hardly moves: beside it, light is as strong as wanted all the same."""
    command = [conceal, "--kind", "saturation,sunlight", "--scene", "whole-bench", "--snr", "30", "--seed", "11", "--no-rivals", "--out", folder]
    subprocess.run(command + ["--name", "pair"], check=True, capture_output=True)
    truth = json.loads((pathlib.Path(folder) / "pair.truth.json").read_text())
    lit = [(x["from"], x["to"]) for x in truth["located"] if x["mechanism"] == "sunlight"]
    database = sqlite3.connect(pathlib.Path(folder) / "pair.rig")
    lidar = json.loads(database.execute("SELECT value FROM session WHERE key='bench'").fetchone()[0])["lidar"]
    scans = {}
    for capture, first, last, blob in database.execute(
            "SELECT capture, first_step, last_step, range_mm FROM scan JOIN capture ON capture.id = scan.capture"):
        for k, value in enumerate(struct.unpack(f"<{last - first + 1}H", blob)):
            scans.setdefault((capture, first + k), []).append(value)
    database.close()
    sums = {True: [0, 0], False: [0, 0]}  # variance times degrees of freedom, and these
    for (capture, step), ranges in scans.items():
        variance = statistics.variance(ranges)
        if 0 < variance < 100:  # no edge
            angle = (step - lidar["front_step"]) * lidar["step_deg"]
            of = sums[any(low <= angle <= high for low, high in lit)]
            of[0] += variance * (len(ranges) - 1)
            of[1] += len(ranges) - 1
    (noise, n), (plain, all_others) = sums[True], sums[False]
    pull = (noise / n / (plain / all_others) - 1) / (2 / n + 2 / all_others) ** 0.5
    assert pull > 10, (pull, truth["snr"])


with tempfile.TemporaryDirectory() as folder:
    if "world" in conceal:
        check_pair(folder)
    check(None, "room", folder)
    for kind, scenes in list(kinds.items())[::every]:
        check(kind, min(scenes, key=lambda s: small.index(s) if s in small else 99), folder)
    bad = subprocess.run([conceal, "--kind", "gremlins"], capture_output=True, text=True)
    assert bad.returncode == 2 and "gremlins" in bad.stderr
print(f"{len(kinds)} kinds, every {every}")
