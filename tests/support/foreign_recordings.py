#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Writes one made-up drive in the formats of other tools, by Python's standard library alone.

An independent writer for the tests of the importers: it shares no code with them and follows the formats'
own documents (wiki.ros.org/Bags/Format/2.0, the LZ4 frame and block formats, the CARMEN logger's messages).
usage: foreign_recordings.py FOLDER    writes the files there, and expected.json with what they say.
"""
import bz2
import json
import math
import os
import struct
import sys

SCANS, BEAMS, HZ = 20, 37, 10.0
FIRST_DEG, STEP_DEG = -90.0, 5.0
EPOCH_S = 1_600_000_000
TICKS_A_TURN = 2796.8


def range_mm(scan, beam):
    """Whole millimetres; some beams see nothing."""
    return 0 if (scan + beam) % 11 == 0 else 800 + 37 * beam + 5 * scan


def stamp_s(scan):
    return scan / HZ


def pose(scan):
    """x m, y m, heading rad: a robot that stands for three scans and then drives a curve."""
    t = max(0, scan - 2)
    return 0.05 * t, 0.002 * t * t, 0.01 * t


def wheels_rad(scan):
    t = max(0, scan - 2)
    return 1.5 * t, 1.75 * t


# --- ROS 1 ------------------------------------------------------------------------------------------------

def text(value):
    raw = value.encode()
    return struct.pack("<I", len(raw)) + raw


def header(number, seconds, frame):
    whole = int(math.floor(seconds + 1e-9))
    return struct.pack("<III", number, EPOCH_S + whole, round((seconds - whole) * 1e9)) + text(frame)


def quaternion(yaw):
    return struct.pack("<4d", 0, 0, math.sin(yaw / 2), math.cos(yaw / 2))


def laser_scan(i):
    first, step = math.radians(FIRST_DEG), math.radians(STEP_DEG)
    ranges = [range_mm(i, k) / 1000 or math.inf for k in range(BEAMS)]
    body = header(i, stamp_s(i), "/laser")
    body += struct.pack("<7f", first, first + step * (BEAMS - 1), step, 0, 1 / HZ, 0.1, 30)
    body += struct.pack("<I%df" % BEAMS, BEAMS, *ranges)
    return body + struct.pack("<I%df" % BEAMS, BEAMS, *[100 + k for k in range(BEAMS)])


def odometry(i):
    x, y, heading = pose(i)
    return (header(i, stamp_s(i), "odom") + text("base_link") + struct.pack("<3d", x, y, 0) + quaternion(heading) +
            bytes(8 * (36 + 6 + 36)))


def joint_state(i):
    left, right = wheels_rad(i)
    return (header(i, stamp_s(i), "") + struct.pack("<I", 2) + text("wheel_left") + text("wheel_right") +
            struct.pack("<I2d", 2, left, right) + struct.pack("<II", 0, 0))


def imu(i):
    return header(i, stamp_s(i), "imu") + quaternion(pose(i)[2]) + bytes(8 * 9) + struct.pack("<3d", 0, 0, 0.1) + bytes(
        8 * (9 + 3 + 9))


def transform(i, parent, child, x, y, yaw):
    return header(i, stamp_s(i), parent) + text(child) + struct.pack("<3d", x, y, 0.2) + quaternion(yaw)


def tf(i):
    """As ROS 1 publishes it: the robot's build again and again beside the odometry's transform."""
    return struct.pack("<I", 2) + transform(i, "/base_link", "/laser", 0.12, -0.01, math.pi / 2) + transform(
        i, "/odom", "/base_link", *pose(i))


def field(name, value):
    raw = name.encode() + b"=" + value
    return struct.pack("<I", len(raw)) + raw


def record(fields, data):
    head = b"".join(field(name, value) for name, value in fields)
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def xxh32(data):
    """xxHash with seed 0, by its own specification."""
    p1, p2, p3, p4, p5, mask = 2654435761, 2246822519, 3266489917, 668265263, 374761393, 0xFFFFFFFF
    rotl = lambda v, n: ((v << n) | (v >> (32 - n))) & mask
    size, lanes = len(data), [(p1 + p2) & mask, p2, 0, -p1 & mask]
    if size >= 16:
        while len(data) >= 16:
            for k, word in enumerate(struct.unpack("<4I", data[:16])):
                lanes[k] = rotl((lanes[k] + word * p2) & mask, 13) * p1 & mask
            data = data[16:]
        h = sum(rotl(lane, n) for lane, n in zip(lanes, (1, 7, 12, 18)))
    else:
        h = p5
    h = (h + size) & mask
    while len(data) >= 4:
        h = (rotl((h + struct.unpack("<I", data[:4])[0] * p3) & mask, 17) * p4) & mask
        data = data[4:]
    for byte in data:
        h = (rotl((h + byte * p5) & mask, 11) * p1) & mask
    h = ((h ^ (h >> 15)) * p2) & mask
    h = ((h ^ (h >> 13)) * p3) & mask
    return h ^ (h >> 16)


def lz4_length(value):
    out = b""
    while value >= 255:
        out, value = out + b"\xff", value - 255
    return out + bytes([value])


def lz4_block(data):
    """Literals and matches; the last twelve bytes are literals, as the format demands."""
    out, anchor, at, seen = b"", 0, 0, {}
    while at < len(data) - 12:
        key = data[at:at + 4]
        before, seen[key] = seen.get(key), at
        if before is None or at - before > 65535:
            at += 1
            continue
        size = 4
        while at + size < len(data) - 5 and data[before + size] == data[at + size]:
            size += 1
        literals = data[anchor:at]
        token = (min(15, len(literals)) << 4) | min(15, size - 4)
        out += bytes([token]) + (lz4_length(len(literals) - 15) if len(literals) >= 15 else b"") + literals
        out += struct.pack("<H", at - before) + (lz4_length(size - 4 - 15) if size - 4 >= 15 else b"")
        at += size
        anchor = at
    literals = data[anchor:]
    out += bytes([min(15, len(literals)) << 4])
    return out + (lz4_length(len(literals) - 15) if len(literals) >= 15 else b"") + literals


def lz4_frame(data):
    """With the checksum of the content, without which ROS takes no frame."""
    descriptor = bytes([0x64, 0x60])
    block = lz4_block(data)
    return (b"\x04\x22\x4d\x18" + descriptor + bytes([(xxh32(descriptor) >> 8) & 0xFF]) +
            struct.pack("<I", len(block)) + block + struct.pack("<II", 0, xxh32(data)))


PACK = {"none": lambda data: data, "bz2": bz2.compress, "lz4": lz4_frame}


def ros1_bag(compression, messages, messages_a_chunk=15):
    """messages: (topic, type, scan number, body), in order."""
    connections, info = {}, b""

    def connection(topic, kind):
        about = field("topic", topic.encode()) + field("type", kind.encode()) + field("md5sum", b"*" * 32) + field(
            "message_definition", b"# left out\n")
        return record([("op", b"\x07"), ("conn", struct.pack("<I", connections[topic])), ("topic", topic.encode())],
                      about)

    bag_header_size, first_chunk = 4096, 13 + 4096
    body, chunks = b"", 0
    for start in range(0, len(messages), messages_a_chunk):
        inside, index = b"", {}
        for topic, kind, i, content in messages[start:start + messages_a_chunk]:
            if topic not in connections:
                connections[topic] = len(connections)
                inside += connection(topic, kind)
            time = struct.pack("<II", EPOCH_S + int(stamp_s(i)), round(stamp_s(i) % 1 * 1e9))
            index.setdefault(topic, []).append((time, len(inside)))
            inside += record([("op", b"\x02"), ("conn", struct.pack("<I", connections[topic])), ("time", time)], content)
        times = sorted(time for entries in index.values() for time, _ in entries)
        info += record([("op", b"\x06"), ("ver", struct.pack("<I", 1)),
                        ("chunk_pos", struct.pack("<Q", first_chunk + len(body))), ("start_time", times[0]),
                        ("end_time", times[-1]), ("count", struct.pack("<I", len(index)))],
                       b"".join(struct.pack("<II", connections[topic], len(entries))
                                for topic, entries in index.items()))
        chunks += 1
        body += record([("op", b"\x05"), ("compression", compression.encode()),
                              ("size", struct.pack("<I", len(inside)))], PACK[compression](inside))
        for topic, entries in index.items():
            data = b"".join(time + struct.pack("<I", offset) for time, offset in entries)
            body += record([("op", b"\x04"), ("ver", struct.pack("<I", 1)),
                            ("conn", struct.pack("<I", connections[topic])),
                            ("count", struct.pack("<I", len(entries)))], data)
    fields = [("op", b"\x03"), ("index_pos", struct.pack("<Q", first_chunk + len(body))),
              ("conn_count", struct.pack("<I", len(connections))), ("chunk_count", struct.pack("<I", chunks))]
    head = b"".join(field(name, value) for name, value in fields)
    padding = bag_header_size - 8 - len(head)
    out = b"#ROSBAG V2.0\n" + struct.pack("<I", len(head)) + head + struct.pack("<I", padding) + b" " * padding + body
    kinds = {topic: kind for topic, kind, _, _ in messages}
    for topic in connections:
        out += connection(topic, kinds[topic])
    return out + info


def robot_messages(with_odometry=True):
    messages = []
    for i in range(SCANS):
        messages.append(("/tf", "tf2_msgs/TFMessage", i, tf(i)))
        if with_odometry:
            messages.append(("/odom", "nav_msgs/Odometry", i, odometry(i)))
        messages.append(("/joint_states", "sensor_msgs/JointState", i, joint_state(i)))
        messages.append(("/imu", "sensor_msgs/Imu", i, imu(i)))
        messages.append(("/chatter", "std_msgs/String", i, text("hello")))
        messages.append(("/scan", "sensor_msgs/LaserScan", i, laser_scan(i)))
    return messages


# --- tables -----------------------------------------------------------------------------------------------

def angle_deg(k):
    return FIRST_DEG + STEP_DEG * k


def tables():
    rows = {}
    wide = ["stamp_s," + ",".join("range%d_m" % k for k in range(BEAMS))]
    points, cartesian, degrees = ["scan,time_s,angle_rad,range_m,quality"], ["scan\tx_m\ty_m"], ["angle_deg;range_mm"]
    echo = ["%time," + ",".join(["field.header.seq", "field.header.stamp", "field.header.frame_id", "field.angle_min",
                                  "field.angle_max", "field.angle_increment", "field.time_increment",
                                  "field.scan_time", "field.range_min", "field.range_max"] +
                                 ["field.ranges%d" % k for k in range(BEAMS)] +
                                 ["field.intensities%d" % k for k in range(BEAMS)])]
    bare = []
    for i in range(SCANS):
        mm = [range_mm(i, k) for k in range(BEAMS)]
        wide.append("%.3f," % (EPOCH_S + stamp_s(i)) + ",".join("%.3f" % (r / 1000) if r else "nan" for r in mm))
        bare.append("%d " % round(1000 * stamp_s(i)) + " ".join("%.3f" % (r / 1000) for r in mm))
        stamp_ns = EPOCH_S * 10**9 + round(stamp_s(i) * 1e9)
        echo.append("%d,%d,%d,laser,%.9f,%.9f,%.9f,0.0,%.3f,0.1,30.0," %
                    (stamp_ns, i, stamp_ns, math.radians(FIRST_DEG), math.radians(angle_deg(BEAMS - 1)),
                     math.radians(STEP_DEG), 1 / HZ) + ",".join("%.3f" % (r / 1000) if r else "inf" for r in mm) +
                    "," + ",".join(str(100 + k) for k in range(BEAMS)))
        for k in range(BEAMS):
            a, r = math.radians(angle_deg(k)), mm[k] / 1000
            degrees.append("%g;%d" % (angle_deg(k), mm[k]))
            points.append("%d,%.3f,%.6f,%.3f,%d" % (i, EPOCH_S + stamp_s(i), a, r, 100 + k))
            if r:  # as point clouds are: without the beams that saw nothing
                cartesian.append("%d\t%.5f\t%.5f" % (i, r * math.cos(a), r * math.sin(a)))
    ticks, steps = ["time;left_ticks;right_ticks"], []
    previous = (0, 0)
    for i in range(SCANS):
        counts = [round(w / (2 * math.pi) * TICKS_A_TURN) for w in wheels_rad(i)]
        wrapped = [(c + 28000 + 32768) % 65536 - 32768 for c in counts]  # of 16 bits, from some count on
        ticks.append("%.3f;%d;%d" % (EPOCH_S + stamp_s(i), *wrapped))
        x, y, heading = pose(i)
        steps.append("%.3f,%.6f,%.6f,%.6f,%d,%d" % (stamp_s(i), x, y, heading, counts[1] - previous[1],
                                                    counts[0] - previous[0]))
        previous = counts
    return {"wide.csv": wide, "points.csv": points, "cartesian.tsv": cartesian, "degrees.csv": degrees,
            "echo.csv": echo, "bare.txt": bare, "ticks.csv": ticks, "steps.csv": steps}


# --- logs -------------------------------------------------------------------------------------------------

def carmen(variant):
    lines = ["# CARMEN Logfile", "PARAM laser_front_laser_resolution %g nohost 0" % STEP_DEG]
    for i in range(SCANS):
        x, y, heading = pose(i)
        ranges = " ".join("%.3f" % (range_mm(i, k) / 1000 or 81.91) for k in range(BEAMS))
        robot = "%.6f %.6f %.6f" % (x, y, heading)
        lidar = "%.6f %.6f %.6f" % (x + 0.1 * math.cos(heading), y + 0.1 * math.sin(heading), heading)
        if variant == "old":
            lines.append("ODOM %s 0.5 0.1 0 0 host %.3f" % (robot, EPOCH_S + stamp_s(i)))
            lines.append("FLASER %d %s %s %s 0 nohost %.3f" % (BEAMS, ranges, lidar, robot, EPOCH_S + stamp_s(i)))
            lines.append("RLASER %d %s %s %s 0 nohost %.3f" % (BEAMS, ranges, lidar, robot, EPOCH_S + stamp_s(i)))
        else:
            first, step = math.radians(FIRST_DEG), math.radians(STEP_DEG)
            lines.append("ROBOTLASER2 99 %.6f %.6f %.6f 81.9 0.01 0 %d %s 0 %s %s 0 0 0.3 0.5 1 %.3f host %.3f" %
                         (first, step * (BEAMS - 1), step, BEAMS, ranges, lidar, robot, EPOCH_S + stamp_s(i),
                          stamp_s(i)))
    return lines


def rover():
    lines = []
    for i in range(SCANS):
        left, right = [round(w / (2 * math.pi) * 2000) for w in wheels_rad(i)]
        others = " ".join("7" for _ in range(20))
        ranges = " ".join(str(0 if (i + k) % 11 == 0 else 600 + k + i) for k in range(682))
        lines.append("%d %d %d %d %s  %s 0 " % (212387282 + 98000 * i, 14710, left, right, others, ranges))
    return lines


def main(folder):
    os.makedirs(folder, exist_ok=True)
    path = lambda name: os.path.join(folder, name)
    for compression in PACK:
        with open(path("robot-%s.bag" % compression), "wb") as out:
            out.write(ros1_bag(compression, robot_messages()))
    with open(path("tf-only.bag"), "wb") as out:
        out.write(ros1_bag("none", [m for m in robot_messages(False) if m[0] in ("/tf", "/scan")]))
    files = dict(tables())
    files.update({"old.clf": carmen("old"), "new.log": carmen("new"), "rover.dat": rover()})
    for name, lines in files.items():
        with open(path(name), "w", newline="\r\n" if name == "points.csv" else "\n") as out:
            out.write("\n".join(lines) + "\n")
    expected = {
        "hz": HZ, "first_deg": FIRST_DEG, "step_deg": STEP_DEG, "ticks_a_turn": TICKS_A_TURN,
        "range_mm": [[range_mm(i, k) for k in range(BEAMS)] for i in range(SCANS)],
        "time_us": [round(1e6 * stamp_s(i)) for i in range(SCANS)],
        "pose": [pose(i) for i in range(SCANS)], "wheels_rad": [wheels_rad(i) for i in range(SCANS)],
    }
    with open(path("expected.json"), "w") as out:
        json.dump(expected, out)


if __name__ == "__main__":
    main(sys.argv[1])
