#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""What the programs write is what docs/reference says: tables and keys of a session, results, explanations and corrections against
their schemas, which name every key; and the documents' examples against the same schemas.

    formats_test.py BIN     BIN: folder of rig"""
import json, math, os, random, re, sqlite3, subprocess, sys, tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import json_schema

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def read(*path):
    with open(os.path.join(ROOT, *path), encoding="utf-8") as file:
        return file.read()


def schema(name):
    return json.loads(read("procedures", f"{name}.schema.json"))


def demand(name, document, whose):
    problems = json_schema.complaints(schema(name), document, closed=True)
    assert not problems, f"{whose} is not as procedures/{name}.schema.json says:\n  " + "\n  ".join(problems)


def example(page):
    """The document in a page's first block of JSON with comments."""
    text = re.search(r"```jsonc\n(.*?)```", read("docs", "reference", page), re.S).group(1)
    return json.loads(re.sub(r"(?m)\s+//.*$", "", text))


def wall(folder, distance_mm, scans, rng):
    """A flat wall ahead as a table of scans: 61 beams, 1 deg apart, noise of 5 mm, steady counts that fall with the distance."""
    path = os.path.join(folder, f"wall_{distance_mm}mm.csv")
    with open(path, "w", encoding="utf-8") as out:
        for scan in range(scans):
            angles = [math.radians(beam - 30) for beam in range(61)]
            ranges = [f"{distance_mm / math.cos(a) + rng.gauss(0, 5):.0f}" for a in angles]
            counts = [f"{2e6 / distance_mm * math.cos(a) ** 0.5 + rng.gauss(0, 1):.0f}" for a in angles]
            out.write(",".join([f"{scan * 0.025:.3f}", *ranges, *counts]) + "\n")
    return path


def rig(programs, *words):
    run = subprocess.run([os.path.join(programs, "rig"), *words], capture_output=True, text=True, timeout=240)
    assert run.returncode == 0, f"rig {' '.join(words)}: exit status {run.returncode}\n{run.stdout}{run.stderr}"
    return run.stdout


def documented_tables():
    """{table: columns} of the first part of session.md, and its keys of `session`."""
    text = read("docs", "reference", "session.md")
    tables = {}
    for name, body in re.findall(r"^### `(\w+)`\n(.*?)(?=^###? |\Z)", text, re.S | re.M):
        first = body.split("| key | value |")[0]
        tables[name] = {column for row in re.findall(r"^\| (`[^|]*) \|", first, re.M) for column in re.findall(r"`(\w+)`", row)}
    keys = {key for row in re.findall(r"^\| (`[^|]*) \|", text.split("| key | value |")[1].split("\n## ")[0], re.M)
            for key in re.findall(r"`(\w+)`", row)}
    later = {name: set(re.findall(r"`(\w+)`", columns))
             for name, columns in re.findall(r"^\| `(\w+)` \| (`[^|]*?) \| `rig", text.split("## Tables of some sessions")[1], re.M)}
    return tables, keys, later


def check_session(path):
    tables, keys, later = documented_tables()
    database = sqlite3.connect(path)
    there = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    assert set(tables) <= there, f"session.md describes tables that a session lacks: {set(tables) - there}"
    assert there <= set(tables) | set(later), f"session.md does not describe {there - set(tables) - set(later)}"
    for name in there:
        columns = {row[1] for row in database.execute(f"PRAGMA table_info({name})")}
        assert columns == (tables | later)[name], f"table {name}: has {sorted(columns)}, session.md says {sorted((tables | later)[name])}"
    written = {key for (key,) in database.execute("SELECT key FROM session")}
    assert written <= keys, f"session.md does not describe the keys {written - keys}"
    # Keys that only runs write stand in the sources.
    sources = [os.path.join(folder, file) for folder, _, files in os.walk(os.path.join(ROOT, "rig")) for file in files if file.endswith(".cpp")]
    in_sources = {key for file in sources for key in re.findall(r'(?:session|store)\.set\("(\w+)"', open(file, encoding="utf-8").read())}
    assert in_sources <= keys, f"session.md does not describe the keys {in_sources - keys}"
    database.close()


def main(programs):
    for name in ("result", "correction"):
        document = example(f"{name}.md")
        if name == "correction":
            document["session_sha256"] = ["0" * 64]
        demand(name, document, f"the example of docs/reference/{name}.md")
    rng = random.Random(7)
    with tempfile.TemporaryDirectory(prefix="rig-formats-") as folder:
        session = os.path.join(folder, "walls.rig")
        distances = [400, 700, 1000, 1500, 2000, 2600]
        files = [wall(folder, distance, 60, rng) for distance in distances]
        rig(programs, "import", *files, "-o", session, "--true-mm", ",".join(map(str, distances)), "--columns", "time_s,range_mm*61,intensity*61",
            "--first-deg", "-30", "--step-deg", "1", "--target-width-mm", "4000")
        check_session(session)
        for kind in ("noise", "range"):
            demand("result", json.loads(rig(programs, "fit", kind, session, "--json", "-")), f"what rig fit {kind} writes")
        demand("correction", json.loads(rig(programs, "export", session, "--format", "correction", "-o", "-")), "the exported correction")
        demand("explanation", json.loads(rig(programs, "explain", session, "--json", "-", "--no-store")), "what rig explain writes")


if __name__ == "__main__":
    main(sys.argv[1])
