#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Benches that state their law of intensity: silence where nothing is missing, a name where something is, and no word
about intensity where the bench claims nothing.

  intensity_test.py CONCEAL_WORLD CONCEAL_EFFECTS RIG [KIND SCENE SNR SEED]..."""
import json, pathlib, sqlite3, subprocess, sys, tempfile

world, effects, rig, *cases = sys.argv[1:]
lights = {"radiometry", "window-dirt", "specular"}


def explained(folder, conceal, *arguments):
    subprocess.run([conceal, *arguments, "--out", folder, "--name", "case", "--no-rivals"], check=True, capture_output=True)
    subprocess.run([rig, "explain", folder / "case.rig", "--json", folder / "why.json", "--no-store"], check=True, capture_output=True)
    return json.loads((folder / "why.json").read_text())


def named(why):
    return [m["mechanism"] for m in why["mechanisms"]]


with tempfile.TemporaryDirectory() as temporary:
    folder = pathlib.Path(temporary)
    for seed in ("1", "2"):
        why = explained(folder, world, "--radiometry", "--scene", "ladder", "--seed", seed)
        assert not lights & set(named(why)) and "unknown" not in why, (seed, named(why), why.get("unknown"))
        assert any("radiometry" in note for note in why["notes"])
    # A board whose grey is written wrong is told by its name; it is no law, nor light.
    explained(folder, world, "--radiometry", "--scene", "boards", "--seed", "3")
    bench = json.loads(sqlite3.connect(folder / "case.rig").execute("SELECT value FROM session WHERE key='bench'").fetchone()[0])
    board = max(bench["targets"], key=lambda t: t["reflectance"])
    board["reflectance"] /= 2
    (folder / "wrong.bench.json").write_text(json.dumps(bench))
    subprocess.run([rig, "explain", folder / "case.rig", "--bench", folder / "wrong.bench.json", "--json", folder / "why.json",
                    "--no-store"], check=True, capture_output=True)
    why = json.loads((folder / "why.json").read_text())
    assert not lights & set(named(why)), named(why)
    assert any(f"Target '{board['name']}' returns 1." in note for note in why["notes"]), why["notes"]
    # This device's receiver bends in another way than any law that a bench can state.
    why = explained(folder, effects, "--radiometry", "--scene", "ladder", "--seed", "111")
    assert lights & set(named(why)) == {"radiometry"}, named(why)
    for kind, scene, snr, seed in zip(*[iter(cases)] * 4):
        why = explained(folder, world, "--kind", kind, "--scene", scene, "--snr", snr, "--seed", seed)
        print(kind, scene, "->", why["verdict"], named(why), why.get("unknown"))
        if kind.startswith("unknown"):
            assert why["unknown"]["observable"] == "intensity"
            continue
        assert named(why) == [kind], named(why)
        assert any(l["observable"] == "intensity" for l in why["located"])
        truth = json.loads((folder / "case.truth.json").read_text())["parameters"][kind]
        for name, found in why["mechanisms"][0]["parameters"].items():
            if not isinstance(found, dict) or not isinstance(truth.get(name), float):
                continue
            off = (found["value"] - truth[name]) / found["u"]
            print("  ", name, truth[name], found, "off by", round(off, 1))
            assert abs(off) < 6, (name, truth[name], found)
        law = next(k for k in why["bench"]["known"] if k["mechanism"] == "radiometry")
        assert law["parameters"]["relative_noise"] > 0 if isinstance(law["parameters"]["relative_noise"], float) else True
        # The same recording under a bench that claims nothing: intensity is a covariate, whatever it does.
        bench = json.loads(sqlite3.connect(folder / "case.rig").execute("SELECT value FROM session WHERE key='bench'").fetchone()[0])
        bench["known"] = [k for k in bench["known"] if k["mechanism"] != "radiometry"]
        (folder / "plain.bench.json").write_text(json.dumps(bench))
        subprocess.run([rig, "explain", folder / "case.rig", "--bench", folder / "plain.bench.json", "--json", folder / "why.json",
                        "--no-store"], check=True, capture_output=True)
        why = json.loads((folder / "why.json").read_text())
        assert not lights & set(named(why)) and why["verdict"] != "unknown-physics", named(why)
print("intensity: ok")
