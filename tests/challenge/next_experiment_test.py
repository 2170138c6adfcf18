#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""What `rig explain` cannot decide, the experiment that it plans decides: the procedure runs as it stands, on a
simulated bench with the same concealed causes, and both sessions together name the truth.

  next_experiment_test.py RIG_CONCEAL_WORLD RIG RIG_SIM  KIND SCENE SNR SEED  ...
"""
import json, pathlib, sqlite3, subprocess, sys, tempfile

conceal, rig, rig_sim, *cases = sys.argv[1:]
LIMIT_S = 240


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 0, f"{' '.join(done.args)}\n{done.stdout}{done.stderr}"


def explained(folder, sessions):
    """The explanation of these sessions together; the planned experiment is in next.yaml."""
    run(rig, "explain", *sessions, "--no-store", "--json", folder / "explanation.json", "--next", folder / "next.yaml")
    return json.loads((folder / "explanation.json").read_text())


def told(answer):
    return [found["mechanism"] for found in answer["mechanisms"]], answer["undecided_between"]


for kind, scene, snr, seed in zip(*[iter(cases)] * 4):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        run(conceal, "--kind", kind, "--scene", scene, "--snr", snr, "--seed", seed, "--out", folder, "--name", "first")
        first, second = folder / "first.rig", folder / "second.rig"
        with sqlite3.connect(first) as session:
            (bench,) = session.execute("SELECT value FROM session WHERE key = 'bench'").fetchone()
        (folder / "bench.json").write_text(bench)
        before = explained(folder, [first])
        mechanisms, sets = told(before)
        print(f"{kind}: first {mechanisms} {sets}", flush=True)
        assert kind not in mechanisms and any(kind in suspects for suspects in sets), "the first session should leave it open"
        assert before["next_experiment"], "an experiment should be planned"
        with subprocess.Popen([rig_sim, "--world", folder / "first.world.json", "--speed", "max", "--seed", "7", "--lidar-port", "0",
                               "--stage-link", folder / "stage"], stdout=subprocess.PIPE, text=True) as bench_process:
            try:
                devices = json.loads(bench_process.stdout.readline())
                run(rig, "run", folder / "next.yaml", "--bench", folder / "bench.json", "--lidar", devices["lidar"], "--stage", devices["stage"],
                    "--operator", devices["operator"], "--out", second)
            finally:
                bench_process.terminate()
        mechanisms, sets = told(explained(folder, [first, second]))
        print(f"{kind}: with the planned one {mechanisms} {sets}", flush=True)
        assert mechanisms == [kind], "both sessions together should name it, and nothing else"
        assert all("nothing-missing" in suspects for suspects in sets), "nothing else should be needed"
