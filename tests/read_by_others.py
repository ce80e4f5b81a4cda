"""Reads a corrected log with readers that share nothing with unwater: mcap with its ROS 1, ROS 2 and protobuf helpers.

    python3 tests/read_by_others.py OUT.mcap ENCODING

Every message that unwater added must decode by its own schema; prints one line per topic, fails otherwise.
"""

import math
import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros1.decoder import DecoderFactory as Ros1
from mcap_ros2.decoder import DecoderFactory as Ros2

path, encoding = sys.argv[1:]
names = {
    "cdr": ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo", "rcl_interfaces/msg/Log", "unwater_msgs/msg/Frame"),
    "ros1": ("sensor_msgs/CompressedImage", "sensor_msgs/CameraInfo", "rosgraph_msgs/Log", "unwater_msgs/Frame"),
    "protobuf": ("foxglove.CompressedImage", "foxglove.CameraCalibration", "foxglove.Log", "unwater_msgs.Frame"),
}[encoding]
seen, stamps = {}, {}
with open(path, "rb") as file:
    reader = make_reader(file, decoder_factories=[Ros1(), Ros2(), Protobuf()])
    for schema, channel, message, said in reader.iter_decoded_messages(log_time_order=False):
        topic = channel.topic
        if not (topic.startswith("/unwater/") or "image_corrected" in topic):
            continue
        assert channel.message_encoding == encoding, f"{topic}: {channel.message_encoding}"
        seen.setdefault(topic, [schema.name, 0])[1] += 1
        if topic.endswith("/compressed"):
            assert schema.name == names[0] and said.format in ("jpeg", "png")
            assert bytes(said.data[:2]) in (b"\xff\xd8", b"\x89P"), "no picture"
        elif topic.endswith("camera_info"):
            k = said.k if encoding == "cdr" else said.K
            assert schema.name == names[1] and said.width > 0 and len(k) == 9 and k[0] > 0 and k[8] == 1
        elif topic == "/unwater/log":
            text = said.message if encoding == "protobuf" else said.msg
            assert schema.name == names[2] and said.name == "unwater" and text
        elif topic == "/unwater/frame":
            assert schema.name == names[3] and bool(said.corrected) and math.isfinite(said.camera_altitude_m) and said.mean_gain > 0
        elif topic == "/unwater/attenuation":
            assert len(said.attenuation_per_m) == 3 and all(0 < a < 3 for a in said.attenuation_per_m) and said.physical
        elif topic == "/unwater/seafloor":
            assert abs(said.normal_x**2 + said.normal_y**2 + said.normal_z**2 - 1) < 1e-9 and said.hits >= 3 and said.support
        elif topic == "/unwater/seafloor/cloud":
            points = len(said.data) // (said.point_stride if encoding == "protobuf" else said.point_step)
            x, y, z = struct.unpack("<3f", bytes(said.data[:12]))
            assert points > 1000 and [f.name for f in said.fields[:3]] == ["x", "y", "z"] and 0.2 < z < 20 and abs(x) < z and abs(y) < z
        elif topic == "/unwater/strobe/beam":
            assert len(said.data) > 0
        elif topic == "/unwater/seafloor/transform":
            (transform,) = [said] if encoding == "protobuf" else said.transforms
            assert transform.child_frame_id == "unwater/seafloor"
        elif topic == "/unwater/strobe":
            q = said.pose.orientation
            assert abs(q.x**2 + q.y**2 + q.z**2 + q.w**2 - 1) < 1e-9 and abs(said.pose.position.z) < 10
        elif topic == "/unwater/beam_pattern":
            assert len(said.log_gain) == len(said.theta_deg) * len(said.phi_deg)
        elif topic.startswith("/unwater/plot/"):
            assert len(said.data) >= 1 and all(map(math.isfinite, said.data))
        if hasattr(said, "header"):
            stamp = said.header.stamp
            stamps.setdefault(topic, set()).add((getattr(stamp, "sec", None) or stamp.secs) if encoding == "ros1" else stamp.sec)
        elif hasattr(said, "timestamp"):
            stamps.setdefault(topic, set()).add(said.timestamp.seconds)
        assert all(s > 0 for s in stamps.get(topic, ())), f"{topic}: no stamp"
for topic, (name, count) in sorted(seen.items()):
    print(f"{topic}  {name}  {count}")
assert len(seen) == 16, f"{len(seen)} topics"
