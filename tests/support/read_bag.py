#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Reads a sqlite3 bag of ROS 2 by Python's standard library alone and prints its messages as JSON lines: an independent reader for the
tests of the exports. It follows CDR (values aligned to their size behind four bytes) and the public message definitions."""
import json, sqlite3, struct, sys


class Cdr:
    def __init__(self, data):
        assert data[:4] == b"\x00\x01\x00\x00", data[:4]
        self.data, self.at = data[4:], 0

    def take(self, code, count=1):
        size = struct.calcsize("<" + code)
        self.at += -self.at % size
        values = struct.unpack_from("<%d%s" % (count, code), self.data, self.at)
        self.at += size * count
        return values if count > 1 else values[0] if count else ()

    def text(self):
        size = self.take("I")
        raw = self.data[self.at:self.at + size]
        self.at += size
        assert raw.endswith(b"\0"), raw
        return raw[:-1].decode()

    def many(self, code):
        values = [self.take(code) for _ in range(self.take("I"))]
        return values

    def header(self):
        return {"stamp_ns": self.take("i") * 10**9 + self.take("I"), "frame": self.text()}

    def end(self):
        assert self.at == len(self.data), (self.at, len(self.data))


def transforms(cdr):
    out = []
    for _ in range(cdr.take("I")):
        out.append({**cdr.header(), "child": cdr.text(), "translation": cdr.take("d", 3), "rotation": cdr.take("d", 4)})
    return out


def odometry(cdr):
    out = {**cdr.header(), "child": cdr.text(), "position": cdr.take("d", 3), "orientation": cdr.take("d", 4)}
    cdr.take("d", 36)
    out.update(linear=cdr.take("d", 3), angular=cdr.take("d", 3))
    cdr.take("d", 36)
    return out


def points(cdr):
    out = {**cdr.header(), "height": cdr.take("I"), "width": cdr.take("I")}
    fields = []
    for _ in range(cdr.take("I")):
        fields.append((cdr.text(), cdr.take("I"), cdr.take("B"), cdr.take("I")))
    big, step, row = cdr.take("B"), cdr.take("I"), cdr.take("I")
    size = cdr.take("I")
    raw = cdr.data[cdr.at:cdr.at + size]
    cdr.at += size
    dense = cdr.take("B")
    assert (big, row, size, dense) == (0, step * out["width"], step * out["width"], 1), (big, row, size, dense)
    assert all(field[2:] == (7, 1) for field in fields), fields
    out["fields"] = [field[0] for field in fields]
    out["points"] = [struct.unpack_from("<%df" % len(fields), raw, i * step) for i in range(out["width"])]
    return out


def scan(cdr):
    out = {**cdr.header(), "angles": cdr.take("f", 3)}
    cdr.take("f", 4)
    out["ranges"], out["intensities"] = cdr.many("f"), cdr.many("f")
    return out


def joints(cdr):
    out = cdr.header()
    out["name"] = [cdr.text() for _ in range(cdr.take("I"))]
    out["position"], out["velocity"], out["effort"] = cdr.many("d"), cdr.many("d"), cdr.many("d")
    return out


READ = {"tf2_msgs/msg/TFMessage": transforms, "nav_msgs/msg/Odometry": odometry, "sensor_msgs/msg/PointCloud2": points,
        "sensor_msgs/msg/LaserScan": scan, "sensor_msgs/msg/JointState": joints}

with sqlite3.connect("file:" + sys.argv[1] + "?mode=ro", uri=True) as bag:
    assert bag.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
    for topic, kind, stamp, data in bag.execute("SELECT name, type, timestamp, data FROM messages JOIN topics ON topics.id = topic_id "
                                                "WHERE serialization_format = 'cdr' ORDER BY timestamp, messages.id"):
        cdr = Cdr(data)
        message = READ[kind](cdr)
        cdr.end()
        text = json.dumps({"topic": topic, "time_ns": stamp, "message": message})
        print(text.replace("Infinity", "null").replace("NaN", "null"))
