#!/usr/bin/env python3
"""How `rendered_clear.mcap` was cut: a stretch of a longer dive, with its truth.

    cut_rendered_clear.py DIVE_FOLDER FIRST_FRAME FRAMES

DIVE_FOLDER holds the log, truth.json, beam_pattern.csv and reflectance/ as the renderer (Mitsuba 3, a path tracer) wrote
them. Needs the Python package mcap. Messages keep their bytes, times and order; those of the latched /tf_static come along.
"""
import json
import pathlib
import shutil
import sys

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

folder, first, count = pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
here = pathlib.Path(__file__).parent
truth = json.loads((folder / "truth.json").read_text())
frames = truth["frames"][first:first + count]
begin, end = frames[0]["stamp_ns"] - 1_600_000_000, frames[-1]["stamp_ns"] + 1_600_000_000

with open(folder / truth["mcap"], "rb") as source, open(here / "rendered_clear.mcap", "wb") as target:
    writer = Writer(target, compression=CompressionType.ZSTD, chunk_size=4 << 20)
    writer.start(profile="ros2", library="mcap-python")
    schemas, channels = {}, {}
    for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
        is_frame = channel.topic in ("/camera/image_raw", "/camera/camera_info")
        inside = frames[0]["stamp_ns"] <= message.log_time <= frames[-1]["stamp_ns"] + 100_000_000 if is_frame else begin <= message.log_time <= end
        if not inside and channel.topic != "/tf_static":
            continue
        if schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
        if channel.id not in channels:
            channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata)
        writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
    writer.finish()

out = here / "rendered_clear"
(out / "reflectance").mkdir(parents=True, exist_ok=True)
shutil.copy(folder / "beam_pattern.csv", out / "beam_pattern.csv")
for index, frame in enumerate(frames):
    shutil.copy(folder / frame["reflectance"], out / "reflectance" / f"{index:03}.png")
    frame.update(index=index, reflectance=f"reflectance/{index:03}.png")
truth.update(frames=frames, mcap="../rendered_clear.mcap")
truth["dvl"].pop("data", None)
(out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
