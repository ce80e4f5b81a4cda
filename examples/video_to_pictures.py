#!/usr/bin/env python3
"""Turns video channels of an MCAP log into pictures, which unwater reads. All other messages are copied.

    pip install mcap mcap-ros2-support mcap-protobuf-support av
    python3 video_to_pictures.py IN.mcap OUT.mcap

Reads foxglove.CompressedVideo (protobuf, CDR) and ffmpeg_image_transport_msgs/FFMPEGPacket (CDR): H.264, H.265, VP9, AV1.
Each picture comes out as sensor_msgs/CompressedImage with a PNG, under the packet's stamp, log time and publish time, on the
video's topic with /compressed behind it.
"""

import io
import sys

import av
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2

CODECS = {"h264": "h264", "h265": "hevc", "hevc": "hevc", "vp9": "vp9", "av1": "av1"}
SCHEMA = """\
std_msgs/Header header
string format
uint8[] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def cdr(sec, nanosec, frame_id, picture):
    """sensor_msgs/CompressedImage."""
    out = bytearray(b"\0\1\0\0")

    def number(value):
        out.extend(b"\0" * (-len(out) % 4) + value.to_bytes(4, "little"))

    number(sec)
    number(nanosec)
    for text in (frame_id.encode() + b"\0", b"png\0", picture):
        number(len(text))
        out.extend(text)
    return bytes(out)


def main(source, target):
    pictures = 0
    with open(source, "rb") as f, open(target, "wb") as g:
        writer, schemas, channels, decoders, outputs, waiting = Writer(g), {}, {}, {}, {}, {}
        writer.start(profile="")
        image = writer.register_schema("sensor_msgs/msg/CompressedImage", "ros2msg", SCHEMA.encode())
        factories = [Protobuf(), Ros2()]
        for schema, channel, message in make_reader(f).iter_messages(log_time_order=False):
            name = schema.name if schema else ""
            if not name.endswith(("CompressedVideo", "FFMPEGPacket")):
                if schema and schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                if channel.id not in channels:
                    schema_id = schemas[schema.id] if schema else 0
                    channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id, channel.metadata)
                writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
                continue
            decode = next(d for d in (x.decoder_for(channel.message_encoding, schema) for x in factories) if d)
            packet = decode(message.data)
            word = getattr(packet, "format", None) or packet.encoding
            if channel.id not in decoders:
                decoders[channel.id] = av.CodecContext.create(CODECS[word.split(";")[0].strip().lower()], "r")
                outputs[channel.id] = writer.register_channel(channel.topic + "/compressed", "cdr", image)
            stamp = packet.timestamp if hasattr(packet, "timestamp") else packet.header.stamp
            sec = getattr(stamp, "seconds", None) if hasattr(stamp, "seconds") else stamp.sec
            nanosec = next(getattr(stamp, n) for n in ("nanos", "nanosec", "nsec") if hasattr(stamp, n))
            frame_id = packet.frame_id if hasattr(packet, "frame_id") else packet.header.frame_id
            # Without B frames every packet gives one picture, in order; a decoder may hold some back.
            queue = waiting.setdefault(channel.id, [])
            queue.append((sec, nanosec, frame_id, message.log_time, message.publish_time))
            for frame in decoders[channel.id].decode(av.Packet(bytes(packet.data))):
                pictures += write(writer, outputs[channel.id], frame, queue.pop(0))
        for channel_id, decoder in decoders.items():
            for frame in decoder.decode(None):
                pictures += write(writer, outputs[channel_id], frame, waiting[channel_id].pop(0))
        writer.finish()
    print(f"{pictures} pictures written to {target}")


def write(writer, channel_id, frame, place):
    sec, nanosec, frame_id, log_time, publish_time = place
    png = io.BytesIO()
    frame.to_image().save(png, "PNG")
    writer.add_message(channel_id, log_time, cdr(sec, nanosec, frame_id, png.getvalue()), publish_time)
    return 1


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
