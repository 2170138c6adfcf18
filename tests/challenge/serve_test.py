#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""rig-sim serves a world, its concealed bench and a twin over the same socket; ranges fit the room, and only the
world with the cause shows the effect.

  serve_test.py RIG_SIM WORLDS
"""
import json, math, pathlib, socket, subprocess, sys, tempfile

rig_sim, worlds = sys.argv[1], pathlib.Path(sys.argv[2])


def scans(arguments, count=40):
    """Mean range of every beam in `count` ME scans; None where an echo was lost."""
    with subprocess.Popen([rig_sim, *map(str, arguments), "--speed", "max", "--lidar-port", "0"], stdout=subprocess.PIPE, text=True) as sim:
        try:
            port = json.loads(sim.stdout.readline())["lidar_port"]
            with socket.create_connection(("127.0.0.1", port), timeout=30) as lidar:
                lidar.sendall(f"ME00001080000{count:02d}\n".encode())
                stream = lidar.makefile("r")
                stream.readline(), stream.readline(), stream.readline()  # the command is answered
                sums, got = [0] * 1081, [0] * 1081
                for _ in range(count):
                    stream.readline(), stream.readline(), stream.readline()  # echo, status, stamp
                    data = ""
                    while (line := stream.readline()) != "\n":
                        data += line[:-2]  # without its checksum
                    for k in range(1081):
                        value = 0
                        for letter in data[6 * k:6 * k + 3]:
                            value = 64 * value + ord(letter) - 0x30
                        if 4 < value < 65000:
                            sums[k] += value
                            got[k] += 1
        finally:
            sim.terminate()
    return [s / g if g == count else None for s, g in zip(sums, got)]


def largest(one, other):
    """95th percentile of the difference of two means, mm."""
    differences = sorted(abs(a - b) for a, b in zip(one, other) if a and b)
    assert len(differences) > 1000, len(differences)
    return differences[len(differences) * 95 // 100]


with tempfile.TemporaryDirectory() as folder:
    bench = pathlib.Path(folder) / "bench.json"
    world = worlds / "encoder-eccentricity.world.json"
    subprocess.run([rig_sim, "--world", world, "--conceal", bench], check=True)
    told = json.loads(bench.read_text())
    assert [known["mechanism"] for known in told["known"]] == ["range-noise"], told["known"]
    twin = pathlib.Path(folder) / "twin.json"
    told["known"].append({"mechanism": "encoder-eccentricity",
                          "parameters": {"amplitude_deg": 0.002 * 180 / math.pi, "phase_deg": 60}})
    twin.write_text(json.dumps(told))
    device, plain, known = scans(["--world", world]), scans(["--bench", bench]), scans(["--bench", twin])
    again = scans(["--world", world])
    everything = scans(["--world", worlds / "everything-at-once.world.json"])
print("device - operator's bench", largest(device, plain), "device - twin", largest(device, known), "mm")
assert device == again, "the same seed gives the same scans"
assert largest(device, known) < 6
assert largest(device, plain) > largest(device, known) + 0.5
assert sum(r is not None for r in everything) > 900
