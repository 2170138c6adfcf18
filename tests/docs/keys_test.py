#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""docs/reference/procedure.md and docs/reference/bench.md: their tables are what the schemas say, every key stands in one, and their examples run (dry).

    keys_test.py BIN     BIN: folder of rig"""
import json, os, re, subprocess, sys, tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
# What the fragments of docs/reference/procedure.md use.
HEAD = "procedure: example\nvariables: {samples: 50, span_deg: 4}\nsteps:\n  - home\n"


def blocks(page, language):
    with open(os.path.join(ROOT, "docs", "reference", page), encoding="utf-8") as file:
        return re.findall(rf"```{language}\n(.*?)```", file.read(), re.S)


def whole(fragment):
    if not fragment.startswith("- "):
        return fragment
    return HEAD + "".join("  " + line + "\n" for line in fragment.splitlines())


def main(programs):
    subprocess.run([os.path.join(ROOT, "scripts", "document-keys")], check=True)
    (bench,) = blocks("bench.md", "jsonc")
    fragments = blocks("procedure.md", "yaml")
    shown = set(re.findall(r"- ([a-z-]+)(?::|\n)", "\n".join(fragments)))
    with open(os.path.join(ROOT, "procedures", "procedure.schema.json"), encoding="utf-8") as file:
        kinds = json.load(file)["definitions"]["steps"]["items"]["anyOf"]
    steps = {name for kind in kinds for name in kind.get("properties", {}) if name not in ("name", "steps")}
    assert len(fragments) > len(steps) and steps <= shown, f"no example of {steps - shown}"
    with tempfile.TemporaryDirectory(prefix="rig-docs-") as folder:
        bench_file = os.path.join(folder, "bench.json")
        with open(bench_file, "w", encoding="utf-8") as out:
            out.write(bench)
        for number, fragment in enumerate(fragments):
            procedure = os.path.join(folder, f"example-{number}.yaml")
            with open(procedure, "w", encoding="utf-8") as out:
                out.write(whole(fragment))
            run = subprocess.run([os.path.join(programs, "rig"), "run", procedure, "--bench", bench_file, "--dry-run"],
                                 capture_output=True, text=True, cwd=folder)
            assert run.returncode == 0, f"this example does not run:\n{whole(fragment)}\n{run.stderr}"


if __name__ == "__main__":
    main(sys.argv[1])
