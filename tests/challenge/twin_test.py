#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Closes the loop: a concealed session of the causal engine is explained, its bench file is loaded into the model
engine, the session is recorded again from that twin, and the two are compared as two recordings of one device would be.

  twin_test.py CONCEAL RIG TWIN [KIND SCENE SNR SEED]...

A KIND with a tilde before it need not be named: its twin must be like the device all the same.
"""
import json, math, pathlib, sqlite3, struct, subprocess, sys, tempfile


LAGS = 6


class Cell:
    """One beam of one capture: its clear samples' mean and variance, and where the others lie."""

    def __init__(self, column):
        echoes = [v for v in column if v > 0]
        self.lost, self.good, self.all = len(column) - len(echoes), False, len(column)
        if len(echoes) < 5:
            return
        ordered = sorted(echoes)
        middle = ordered[len(ordered) // 2]
        spread = sorted(abs(v - middle) for v in echoes)[len(echoes) // 2]
        clear = [v for v in echoes if abs(v - middle) <= max(60, 12 * spread)]
        self.good, self.n = len(clear) >= 5, len(clear)
        self.strays = [v / middle for v in echoes if abs(v - middle) > max(60, 12 * spread)]
        self.mean = sum(clear) / self.n
        d = [v - self.mean for v in clear]
        self.squares = sum(v * v for v in d)
        self.variance = self.squares / (self.n - 1)
        self.lagged = [sum(a * b for a, b in zip(d, d[k:])) for k in range(1, LAGS + 1)] if self.n == len(column) else None


def cells(path):
    """(capture, beam) -> Cell."""
    database = sqlite3.connect(path)
    table = {}
    for capture, first in database.execute("SELECT id, first_step FROM capture"):
        rows = [struct.unpack(f"<{len(b) // 2}H", b) for (b,) in
                database.execute("SELECT range_mm FROM scan WHERE capture = ? ORDER BY seq", (capture,))]
        for k, column in enumerate(zip(*rows)):
            table[capture, first + k] = Cell(column)
    return table


def turning_differences(original, twin):
    """(capture, beam) -> differences of samples at the same stage angle, of captures in which the stage turned."""
    databases = [sqlite3.connect(path) for path in (original, twin)]
    table = {}
    for capture, first in databases[0].execute("SELECT id, first_step FROM capture WHERE abs(stage_rate_deg_s) > 1e-9"):
        rows = [[struct.unpack(f"<{len(b) // 2}H", b) for (b,) in
                 database.execute("SELECT range_mm FROM scan WHERE capture = ? ORDER BY seq", (capture,))] for database in databases]
        for k, (a, b) in enumerate(zip(zip(*rows[0]), zip(*rows[1]))):
            table[capture, first + k] = [x - y for x, y in zip(a, b) if x > 0 and y > 0]
    return table


def memory_factor(*tables):
    """By how much noise that remembers makes the variance of a mean larger than its samples say."""
    sums, squares, degrees = [0.0] * LAGS, 0.0, 0.0
    for table in tables:
        for cell in table.values():
            if cell.good and cell.lagged and cell.n > 2 * LAGS:
                squares += cell.squares
                degrees += 1 / cell.n * cell.squares
                for k in range(LAGS):
                    sums[k] += cell.lagged[k] * cell.n / (cell.n - k - 1)
    if squares == 0:
        return 1.0
    # A mean that is taken off makes every lag look smaller by one over the number of samples.
    lags = [s / squares + degrees / squares for s in sums]
    if lags[0] < 0.03:
        return 1.0
    known = next((k for k, r in enumerate(lags) if r < 0.01), LAGS)
    return 1 + 2 * sum(lags[:known])


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
    turning = turning_differences(original, twin)
    for key in turning:
        del a[key]
    both = sorted(key for key in set(a) & set(b) if a[key].good and b[key].good)
    # A handful of samples knows its own variance badly: beams beside it, in both recordings, know more.
    pooled = {}
    for key in both:
        squares = degrees = 0
        for beam in range(key[1] - 4, key[1] + 5):
            for table in (a, b):
                cell = table.get((key[0], beam))
                if cell and cell.good:
                    squares, degrees = squares + cell.squares, degrees + cell.n - 1
        pooled[key] = squares / degrees
    factor = memory_factor(a, b)
    z, wild, blocks = [], 0, {}

    def count(key, value):
        nonlocal wild
        if abs(value) > 6:
            wild += 1  # at an edge or a corner a beam sees the other surface
            return
        z.append(value)
        for name, place in (("beam", key[1] // 36), ("capture", key[0])):
            blocks.setdefault((name, place), []).append(value)

    # Near a corner or an edge a sample may be anywhere.
    spreads = sorted(abs(d) for values in turning.values() for d in values)
    clear = [d for d in spreads if d < 5 * spreads[len(spreads) // 2]]
    usual = math.sqrt(sum(d * d for d in clear) / len(clear)) if clear else 1
    for key, values in turning.items():
        clear = [d for d in values if abs(d) < 5 * usual]
        if len(clear) > 2:
            count(key, sum(clear) / len(clear) / (usual / math.sqrt(len(clear))))
    for key in both:
        one, other = a[key], b[key]
        own = (one.squares + other.squares + 20 * pooled[key]) / (one.n + other.n + 18)
        count(key, (one.mean - other.mean) / math.sqrt(factor * own * (1 / one.n + 1 / other.n)))
    number = len(z) + wild
    result = {"cells": number, "rms_z": math.sqrt(sum(v * v for v in z) / len(z)), "wild": wild / number}
    for name in ("beam", "capture"):
        sums = [sum(v) ** 2 / len(v) for (kind, _), v in blocks.items() if kind == name and len(v) > 5]
        if not sums:
            continue
        result[f"chi2_by_{name}"] = sum(sums) / len(sums)
        result[f"blocks_by_{name}"] = len(sums)
    of_samples = lambda table: sum(table[key].squares for key in both) / sum(table[key].n - 1 for key in both)
    result["variance_ratio"] = of_samples(a) / of_samples(b)
    lag_one = lambda table: sum(table[key].lagged[0] for key in both if table[key].lagged) / max(
        1, sum(table[key].squares for key in both if table[key].lagged))
    result["lag_one"] = lag_one(a) - lag_one(b)
    samples = sum(cell.all for cell in a.values())
    result["lost"] = sum(cell.lost for cell in a.values()) / samples - sum(cell.lost for cell in b.values()) / samples
    strays = [sorted(v for key in both for v in table[key].strays) for table in (a, b)]
    result["strays"] = (len(strays[0]) - len(strays[1])) / samples
    if min(map(len, strays)) > 30:
        result["strays_apart"] = farthest(*strays) * math.sqrt(len(strays[0]) * len(strays[1]) / (len(strays[0]) + len(strays[1])))
    if with_light:
        light, other = lights(original), lights(twin)
        cells_of_both = [key for key in light if key in other]
        ratios = sorted(math.log(light[key][0] / other[key][0]) for key in cells_of_both)
        noises = [sorted(t[key][1] for key in cells_of_both)[len(cells_of_both) // 2] for t in (light, other)]
        result["light"], result["light_noise"] = ratios[len(ratios) // 2], noises[0] / noises[1]
    return result


def farthest(a, b):
    """Largest distance of two distributions (Kolmogorov and Smirnov)."""
    i = j = 0
    far = 0
    while i < len(a) and j < len(b):
        x = min(a[i], b[j])
        while i < len(a) and a[i] <= x:
            i += 1
        while j < len(b) and b[j] <= x:
            j += 1
        far = max(far, abs(i / len(a) - j / len(b)))
    return far


def check(conceal, rig, twin, kind, scene, snr, seed):
    must_be_named, kind = not kind.startswith("~"), kind.lstrip("~")
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
        subprocess.run([rig, "explain", folder / "twin.rig", "--bench", folder / "twin.bench.json", "--json", folder / "again.json",
                        "--no-store"], check=True, capture_output=True)
        again = json.loads((folder / "again.json").read_text())
        claims = any(known["mechanism"] == "radiometry" for known in json.loads(bench)["known"])
        after, before = (compare(folder / "device.rig", folder / name, claims) for name in ("twin.rig", "before.rig"))
    found = [m["mechanism"] for m in why["mechanisms"]]
    print(kind, scene, "found", found, "\n  before", before, "\n  twin  ", after)
    assert kind in found or not must_be_named, found
    assert again["verdict"] == "nothing-missing", "the twin's own recording shows more than its bench: " + again["verdict"]
    assert not differences(after), differences(after)
    assert differences(before), "the bench without what was found is as good"


def differences(d):
    """Observables in which two recordings differ by more than one device does from itself. The fit's own uncertainty adds to the
    blocks' chi-square, hence not 1 but below 1.5 and chance."""
    chance = 3 / math.sqrt(2 * d["cells"])
    limits = {"rms_z": (0.95 - chance, 1.05 + chance), "wild": (-1, 0.005), "variance_ratio": (0.95, 1.05), "lag_one": (-0.02, 0.02),
              "lost": (-0.002, 0.002), "strays": (-0.001, 0.001), "strays_apart": (0, 1.95)}
    for name in ("beam", "capture"):
        if f"chi2_by_{name}" not in d:
            continue
        limits[f"chi2_by_{name}"] = (0, 1.5 + 3 * math.sqrt(2 / d[f"blocks_by_{name}"]))
    if "light" in d:
        limits["light"], limits["light_noise"] = (-0.01, 0.01), (0.8, 1.25)
    return {name: d[name] for name, (low, high) in limits.items() if name in d and not low < d[name] < high}


if __name__ == "__main__":
    conceal, rig, twin, *cases = sys.argv[1:]
    for i in range(0, len(cases), 4):
        check(conceal, rig, twin, *cases[i:i + 4])
