#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""scripts/explain-archive without Slurm, and the commands about archives as a user calls them: a worker is killed in the middle, a
session fails, and in the end every result is there once.

    explain_archive_test.py BIN     BIN: folder of rig"""
import json, os, pathlib, shutil, sqlite3, subprocess, sys, tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
SEED = ROOT / "tests/fuzz/corpus/session/small.rig"

# Stands for rig: notes what is asked of it, and kills the worker that asks for the third report, once.
WRAPPER = """#!/bin/sh
if [ "$1" = report ]; then
  echo "$2" >>{folder}/calls
  if [ "$(wc -l <{folder}/calls)" -eq 3 ]; then kill -9 $PPID; exit 1; fi
fi
exec {rig} "$@"
"""


def main(programs):
    rig = programs / "rig"

    def run(*words, expected=0, rig=rig):
        done = subprocess.run([rig, *map(str, words)], capture_output=True, text=True, stdin=subprocess.DEVNULL)
        assert done.returncode == expected, f"rig {words}: {done.returncode}\n{done.stdout}{done.stderr}"
        return done

    with tempfile.TemporaryDirectory(prefix="rig-laboratory-") as folder:
        folder = pathlib.Path(folder)
        archive = folder / "archive"
        archive.mkdir()
        for i in range(8):
            session = archive / f"{i}.rig"
            shutil.copyfile(SEED, session)
            with sqlite3.connect(session) as database:
                database.execute("UPDATE scan SET host_us = host_us + ?", (i,))
                database.execute("INSERT OR REPLACE INTO session VALUES('lidar', ?)", (json.dumps({"PROD": "UST-10LX", "SERI": f"H{i % 2}"}),))
                database.execute("INSERT OR REPLACE INTO session VALUES('created_utc', ?)", (f"2026-0{i + 1}-01T00:00:00Z",))
                database.execute("INSERT INTO result VALUES('centre', '', ?)",
                                 (json.dumps({"values": [{"name": "centre_x_mm", "label": "Centre, x", "value": 1 + i % 3, "u": 0.5, "U": 1, "unit": "mm"}]}),))
                if i == 5:
                    database.execute("UPDATE session SET value = '{' WHERE key = 'bench'")  # No report can be made of it.
        before = {path: path.read_bytes() for path in archive.glob("*.rig")}
        assert "rig archive add" in run("history", "H0", "--archive", archive, expected=2).stderr
        run("archive", "add", archive)
        assert "is not a folder" in run("archive", "add", folder / "nowhere", expected=2).stderr
        assert len(json.loads(run("archive", "list", archive, "--json", "-").stdout)["sessions"]) == 8
        assert "8 good" in run("archive", "verify", archive).stderr

        wrapper = folder / "rig"
        wrapper.write_text(WRAPPER.format(folder=folder, rig=rig))
        wrapper.chmod(0o755)

        def campaign(*words, expected, program=wrapper):
            done = subprocess.run([sys.executable, ROOT / "scripts/explain-archive", archive, "--task", "report", "--local", "--rig", program, *words],
                                  capture_output=True, text=True)
            assert done.returncode == expected, f"{words}: {done.returncode}\n{done.stderr}"
            return done.stderr

        campaign("--jobs", "1", expected=3)  # The worker was killed.
        results = archive / "results/report"
        assert len(list(results.glob("*.html"))) == 2
        told = campaign("--jobs", "2", expected=1)
        assert "FAILED 5.rig" in told and "7 of 8 sessions have a result, 1 failed, 0 are to be done" in told, told
        assert len(list(results.glob("*.html"))) == 7 and not list(results.glob(".*.html")), list(results.iterdir())
        calls = [pathlib.Path(line).name for line in (folder / "calls").read_text().split()]
        assert sorted(set(calls)) == [f"{i}.rig" for i in range(8)]
        assert len(calls) == 9, calls  # Each once, and that of the killed worker again.
        log = next(log for log in results.glob("*.log") if log.read_text().startswith("5.rig"))
        assert "bench" in log.read_text()
        campaign(expected=1)
        campaign("--status", expected=1)
        assert len((folder / "calls").read_text().split()) == 9  # Nothing was made twice; what failed is not tried again unasked.
        campaign("--again", expected=1)
        assert len((folder / "calls").read_text().split()) == 10
        campaign("--jobs", "2", expected=1, program=rig)  # Another program: begun anew, the earlier results kept.
        assert len(list((archive / "results/earlier").glob("report-*/*.html"))) == 7
        assert len(list(results.glob("*.html"))) == 7

        assert before == {path: path.read_bytes() for path in archive.glob("*.rig")}, "a session was written"
        page = folder / "history.html"
        assert "Centre, x" in run("history", "H0", "--archive", archive, "-o", page).stderr and "Control limits" in page.read_text()
        assert json.loads(run("fleet", "--archive", archive, "--json", "-").stdout)["sessions"] == 8
        assert "Previous calibration" in (run("report", archive / "4.rig", "--no-store", "--archive", archive, "-o", folder / "4.html"),
                                          (folder / "4.html").read_text())[1]
        (archive / "0.rig").unlink()
        with sqlite3.connect(archive / "1.rig") as database:
            database.execute("UPDATE capture SET stage_deg = stage_deg + 1")
        told = run("archive", "verify", archive, expected=1).stderr
        assert "CHANGED      1.rig" in told and "MISSING      0.rig" in told, told


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]).resolve())
