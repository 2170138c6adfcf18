#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Closes the loop: a concealed session of the causal engine is explained, its bench file is loaded into the model
engine, the session is recorded again from that twin, and the two are compared as two recordings of one device would be.

  twin_test.py CONCEAL RIG TWIN [KIND SCENE SNR SEED]...
"""
import json, math, pathlib, sqlite3, struct, subprocess, sys, tempfile


def cells(path):
    """(capture, beam) -> (mean, variance, count, lost, lag-one product) of clear samples."""
    database = sqlite3.connect(path)
    table = {}
    for capture, first in database.execute("SELECT id, first_step FROM capture"):
        rows = [struct.unpack(f"<{len(b) // 2}H", b) for (b,) in
                database.execute("SELECT range_mm FROM scan WHERE capture = ? ORDER BY seq", (capture,))]
        for k, column in enumerate(zip(*rows)):
            x = [v for v in column if v > 0]
            if len(x) < 5:
                continue
            mean = sum(x) / len(x)
            d = [v - mean for v in x]
            table[capture, first + k] = (mean, sum(v * v for v in d) / (len(x) - 1), len(x), len(column) - len(x),
                                         sum(a * b for a, b in zip(d, d[1:])) / (len(x) - 1))
    return table


def lights(path):
    """(capture, beam) -> mean intensity and its relative noise, of clear samples."""
    database = sqlite3.connect(path)
    table = {}
    for capture, first in database.execute("SELECT id, first_step FROM capture"):
        rows = [struct.unpack(f"<{len(b) // 2}H", b) for (b,) in
                database.execute("SELECT intensity FROM scan WHERE capture = ? AND intensity IS NOT NULL ORDER BY seq", (capture,))]
        for k, x in enumerate(zip(*rows)):
            if min(x) < 5 or len(x) < 5:
                continue
            mean = sum(x) / len(x)
            table[capture, first + k] = (mean, math.sqrt(sum((v - mean) ** 2 for v in x) / (len(x) - 1)) / mean)
    return table


def compare(original, twin, with_light=False):
    """How far two recordings differ, in units of what chance does."""
    a, b = cells(original), cells(twin)
    both = sorted(set(a) & set(b))
    pooled = sorted(a[key][1] for key in both)[len(both) // 2]
    z, wild, blocks = [], 0, {}
    for key in both:
        (ma, va, na, _, _), (mb, vb, nb, _, _) = a[key], b[key]
        # A handful of samples knows its own variance badly; the session's is blended in.
        variance = ((na - 1) * va + (nb - 1) * vb + 20 * pooled) / (na + nb + 18)
        value = (ma - mb) / math.sqrt(variance / na + variance / nb)
        if abs(value) > 6:
            wild += 1  # at an edge or a corner a beam sees the other surface
            continue
        z.append(value)
        for name, place in (("beam", key[1] // 36), ("capture", key[0])):
            blocks.setdefault((name, place), []).append(value)
    result = {"cells": len(both), "rms_z": math.sqrt(sum(v * v for v in z) / len(z)), "wild": wild / len(both)}
    for name in ("beam", "capture"):
        sums = [sum(v) ** 2 / len(v) for (kind, _), v in blocks.items() if kind == name and len(v) > 5]
        result[f"chi2_by_{name}"] = sum(sums) / len(sums)
        result[f"blocks_by_{name}"] = len(sums)
    total = lambda table, i: sum(table[key][i] for key in both)
    result["variance_ratio"] = total(a, 1) / total(b, 1)
    result["lag_one"] = total(a, 4) / total(a, 1) - total(b, 4) / total(b, 1)
    if with_light:
        light, other = lights(original), lights(twin)
        cells_of_both = [key for key in light if key in other]
        ratios = sorted(math.log(light[key][0] / other[key][0]) for key in cells_of_both)
        noises = [sorted(t[key][1] for key in cells_of_both)[len(cells_of_both) // 2] for t in (light, other)]
        result["light"], result["light_noise"] = ratios[len(ratios) // 2], noises[0] / noises[1]
    result["lost"] = (total(a, 3) - total(b, 3)) / max(1, total(a, 2))
    return result


def check(conceal, rig, twin, kind, scene, snr, seed):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        subprocess.run([conceal, "--kind", kind, "--scene", scene, "--snr", snr, "--seed", seed, "--out", folder,
                        "--name", "device", "--no-rivals"], check=True, capture_output=True)
        subprocess.run([rig, "explain", folder / "device.rig", "--json", folder / "why.json"], check=True, capture_output=True)
        why = json.loads((folder / "why.json").read_text())
        (folder / "twin.bench.json").write_text(json.dumps(why["bench"]))
        bench = sqlite3.connect(folder / "device.rig").execute("SELECT value FROM session WHERE key='bench'").fetchone()[0]
        (folder / "before.bench.json").write_text(bench)
        subprocess.run([twin, folder / "device.rig", folder / "twin.bench.json", folder / "twin.rig", "5"], check=True)
        subprocess.run([twin, folder / "device.rig", folder / "before.bench.json", folder / "before.rig", "6"], check=True)
        claims = any(known["mechanism"] == "radiometry" for known in json.loads(bench)["known"])
        after, before = (compare(folder / "device.rig", folder / name, claims) for name in ("twin.rig", "before.rig"))
    found = [m["mechanism"] for m in why["mechanisms"]]
    print(kind, scene, "found", found, "\n  before", before, "\n  twin  ", after)
    assert kind in found, found
    assert not differences(after), differences(after)
    assert differences(before), "the bench without what was found is as good"


def differences(d):
    """Observables in which two recordings differ by more than one device does from itself. The fit's own uncertainty adds to the
    blocks' chi-square, hence not 1 but below 1.5 and chance."""
    limits = {"rms_z": (0.95, 1.05), "wild": (-1, 0.005), "variance_ratio": (0.95, 1.05), "lag_one": (-0.02, 0.02), "lost": (-0.002, 0.002)}
    for name in ("beam", "capture"):
        limits[f"chi2_by_{name}"] = (0, 1.5 + 3 * math.sqrt(2 / d[f"blocks_by_{name}"]))
    if "light" in d:
        limits["light"], limits["light_noise"] = (-0.01, 0.01), (0.8, 1.25)
    return {name: d[name] for name, (low, high) in limits.items() if not low < d[name] < high}


if __name__ == "__main__":
    conceal, rig, twin, *cases = sys.argv[1:]
    for i in range(0, len(cases), 4):
        check(conceal, rig, twin, *cases[i:i + 4])
