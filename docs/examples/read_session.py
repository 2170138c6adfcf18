#!/usr/bin/env python3
"""Reads a session with nothing but Python's standard library: mean range of every beam of every capture."""
import array, sqlite3, sys

session = sqlite3.connect(f"file:{sys.argv[1]}?mode=ro", uri=True)
for capture, step, stage_deg, first_step in session.execute(
        "SELECT id, step, stage_deg, first_step FROM capture ORDER BY id"):
    sums, counts = [], []
    for (blob,) in session.execute("SELECT range_mm FROM scan WHERE capture = ? ORDER BY seq", (capture,)):
        ranges = array.array("H", blob)  # uint16, little-endian; 0 = no echo
        if sys.byteorder == "big":
            ranges.byteswap()
        sums += [0] * (len(ranges) - len(sums))
        counts += [0] * (len(ranges) - len(counts))
        for k, value in enumerate(ranges):
            sums[k] += value
            counts[k] += value > 0
    for k, count in enumerate(counts):
        if count:
            print(capture, step, f"{stage_deg:.2f}", first_step + k, f"{sums[k] / count:.3f}", count, sep="\t")
