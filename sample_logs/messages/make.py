#!/usr/bin/env python3
"""Writes the sample logs of this folder, one tiny MCAP per message type, and `expected.json`.

    python3 make.py            # regenerate everything, here
    python3 make.py --out DIR  # ... elsewhere, to compare

The logs come from an independent writer (Python `mcap` and `mcap-ros2-support`), so that a mistake shared by our own
reader and writer cannot hide. `expected.json` holds what a reader must make of each log. It is computed from the scene
put into the log, never by decoding the log.

Every log: one zstd chunk, one channel; profile ros2, message encoding cdr, schema encoding ros2msg (self-contained), but for
those of other_encodings.py, which are in the others, and some of instruments.py and pictures.py.
Stamps start at 1750000000.0 s and step by 0.25 s; publish_time = stamp + 5 ms, log_time = stamp + 20 ms.

expected.json is {file: entry}. Each entry has
    topic, type    of the one channel
    kind           light | image | camera_info | transforms | attitude | dvl | altitude | depth | video
    frame_id       of every header (null: the message has no header)
    stamps_ns      one per message; the log time where the message has no stamp
    log_times_ns   one per message
    readings       one per message (transforms: one per transform)
    note           what is special about this log, if anything
    rig            what the [dvl] of a rig file must say for it, if anything
and the readings are
    image        {width, height, bands, bits, linear, full_scale, rgb_at, tolerance}: rgb_at is [[x, y, [values]], ...],
                 values as fraction of full_scale *of the stored code* (no transfer curve undone), red, green, blue
                 whatever the order in memory, one value when bands is 1. `linear`: the codes are linear in light;
                 else they are sRGB-coded
    camera_info  {width, height, model, k, d}, or null when not calibrated
    transforms   {parent, child, t, q}: pose of the child in the parent, q = x, y, z, w
    attitude     [x, y, z, w], or null when the message says it has none
    dvl          {stamp_ns, ranges_m, directions}, or null when the whole ping must be dropped. ranges_m: slant, one per
                 beam, null for a beam without an echo. directions: unit vectors (x fwd, y right, z down) of the message,
                 or null when it has none that are sane: the reader then needs the instrument's geometry
    altitude     metres, or null
    depth        {width, height, samples}: [column, row, metres] at the places of a 5×4 grid that have a depth
    video        the codec: such a channel is refused

The same versions of the packages give the same bytes: mcap 1.6.0, mcap-ros1-support 0.9.0, mcap-ros2-support 0.6.0,
mcap-protobuf-support 0.6.0, protobuf 7.36.2, zstandard 0.25.0, numpy 2.4.6, Pillow 13.0.0 (its JPEG and WebP coders). Other versions give the same content in other bytes.
"""

import argparse
import io
import json
import math
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as RawWriter
from mcap_ros2.writer import Writer as Ros2Writer
from PIL import Image

import instruments
import other_encodings
import pictures

# ---------------------------------------------------------------------------------------------------------------------
# Time

FIRST_STAMP_NS = 1_750_000_000_000_000_000
STEP_NS = 250_000_000
PUBLISH_DELAY_NS = 5_000_000
LOG_DELAY_NS = 20_000_000


def stamp_ns(i):
    return FIRST_STAMP_NS + i * STEP_NS


def header(i, frame_id):
    sec, nanosec = divmod(stamp_ns(i), 1_000_000_000)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame_id}


# ---------------------------------------------------------------------------------------------------------------------
# Schemas: fields only, in the order of the ROS 2 packages. Some dependencies are named without their package, some
# fields carry defaults, constants or comments, as in the originals: a reader has to cope with all of that.

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/Float64": "float64 data\n",
    "flir_camera_msgs/ImageMetaData": (
        "std_msgs/Header header\n"
        "uint64 camera_time\n"
        "int16 brightness\n"
        "uint32 exposure_time\n"
        "uint32 max_exposure_time\n"
        "float32 gain\n"
    ),
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/Twist": "Vector3 linear\nVector3 angular\n",
    "geometry_msgs/TwistWithCovariance": "Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation\n",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\nTransform transform\n",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\n"
        "string child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist\n"
    ),
    "sensor_msgs/Image": (
        "std_msgs/Header header # stamp: acquisition\n"
        "uint32 height          # rows\n"
        "uint32 width           # columns\n"
        "string encoding\n"
        "uint8 is_bigendian\n"
        "uint32 step            # bytes per row\n"
        "uint8[] data\n"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data\n",
    "sensor_msgs/RegionOfInterest": (
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
    ),
    "sensor_msgs/CameraInfo": (
        "std_msgs/Header header\n"
        "\n"
        "uint32 height\n"
        "uint32 width\n"
        "string distortion_model\n"
        "float64[] d\n"
        "float64[9]  k # row-major\n"
        "float64[9]  r # row-major\n"
        "float64[12] p # row-major\n"
        "\n"
        "uint32 binning_x\n"
        "uint32 binning_y\n"
        "RegionOfInterest roi\n"
    ),
    "sensor_msgs/Imu": (
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\n"
        "float64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\n"
        "float64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\n"
        "float64[9] linear_acceleration_covariance\n"
    ),
    "sensor_msgs/Range": (
        "std_msgs/Header header\n"
        "uint8 ULTRASOUND=0\n"
        "uint8 INFRARED=1\n"
        "uint8 radiation_type\n"
        "float32 field_of_view # [rad]\n"
        "float32 min_range     # [m]\n"
        "float32 max_range     # [m]\n"
        "float32 range         # [m]\n"
        "float32 variance\n"
    ),
    "dvl_msgs/DVLBeam": (
        "int64 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\nbool valid\n"
    ),
    "dvl_msgs/DVL": (
        "std_msgs/Header header\n"
        "float64 time\n"
        "geometry_msgs/Vector3 velocity\n"
        "float64 fom\n"
        "float64[] covariance\n"
        "float64 altitude\n"
        "DVLBeam[] beams\n"
        "bool velocity_valid\n"
        "int64 status\n"
        "int64 time_of_validity\n"
        "int64 time_of_transmission\n"
        "string form\n"
    ),
    "marine_acoustic_msgs/Dvl": (
        "uint8 DVL_MODE_BOTTOM=1\n"
        "uint8 DVL_MODE_WATER=2\n"
        "uint8 DVL_TYPE_PISTON=0\n"
        "uint8 DVL_TYPE_PHASED_ARRAY=1\n"
        "std_msgs/Header header\n"
        "uint8 velocity_mode\n"
        "uint8 dvl_type\n"
        "geometry_msgs/Vector3 velocity\n"
        "float64[9] velocity_covar\n"
        "float64 altitude\n"
        "float64 course_gnd\n"
        "float64 speed_gnd\n"
        "uint8 num_good_beams\n"
        "float32 sound_speed\n"
        "bool beam_ranges_valid\n"
        "bool beam_velocities_valid\n"
        "geometry_msgs/Vector3[4] beam_unit_vec\n"
        "float64[4] range\n"
        "float32[4] range_covar\n"
        "float32[4] beam_quality\n"
        "float32[4] beam_velocity\n"
        "float32[4] beam_velocity_covar\n"
    ),
}


def dependencies(name, definition):
    """The non-primitive types a definition names, as pkg/Type."""
    found = []
    for line in definition.splitlines():
        words = line.split("#")[0].split()
        if not words or "=" in line.split("#")[0]:
            continue
        bare = words[0].split("[")[0]
        full = bare if "/" in bare else f"{name.split('/')[0]}/{bare}"
        if full in DEFINITIONS:
            found.append(full)
    return found


def schema_text(schema_name, overrides=None):
    """The self-contained ros2msg text of `pkg/msg/Type`."""
    root = schema_name.replace("/msg/", "/")
    definitions = DEFINITIONS | (overrides or {})
    order = [root]
    for name in order:  # grows while it is walked
        order += [d for d in dict.fromkeys(dependencies(name, definitions[name])) if d not in order]
    parts = [definitions[root]]
    parts += [f"{'=' * 80}\nMSG: {name}\n{definitions[name]}" for name in order[1:]]
    return "".join(parts)


# ---------------------------------------------------------------------------------------------------------------------
# Logs

OUT = Path(__file__).resolve().parent
EXPECTED = {}


def expect(file, topic, schema_name, kind, frame_id, count, readings, note):
    log_times = [stamp_ns(i) + LOG_DELAY_NS for i in range(count)]
    entry = {
        "topic": topic,
        "type": schema_name,
        "kind": kind,
        "frame_id": frame_id,
        "stamps_ns": [stamp_ns(i) for i in range(count)] if frame_id is not None else log_times,
        "log_times_ns": log_times,
        "readings": readings,
    }
    if note:
        entry["note"] = note
    EXPECTED[f"{file}.mcap"] = entry


def write_log(file, topic, schema_name, messages, kind, frame_id, readings, note=None):
    """One log from messages given as dicts, and its entry in expected.json."""
    with open(OUT / f"{file}.mcap", "wb") as f:
        writer = Ros2Writer(f, compression=CompressionType.ZSTD)
        schema = writer.register_msgdef(schema_name, schema_text(schema_name))
        for i, message in enumerate(messages):
            writer.write_message(
                topic,
                schema,
                message,
                log_time=stamp_ns(i) + LOG_DELAY_NS,
                publish_time=stamp_ns(i) + PUBLISH_DELAY_NS,
                sequence=i,
            )
        writer.finish()
    expect(file, topic, schema_name, kind, frame_id, len(messages), readings, note)


def write_raw_log(file, topic, schema_name, text, payloads, kind, frame_id, readings, note=None):
    """The same from payloads already in CDR."""
    with open(OUT / f"{file}.mcap", "wb") as f:
        writer = RawWriter(f, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schema_id = writer.register_schema(schema_name, "ros2msg", text.encode())
        channel_id = writer.register_channel(topic, "cdr", schema_id)
        for i, payload in enumerate(payloads):
            writer.add_message(
                channel_id,
                log_time=stamp_ns(i) + LOG_DELAY_NS,
                publish_time=stamp_ns(i) + PUBLISH_DELAY_NS,
                sequence=i,
                data=payload,
            )
        writer.finish()
    expect(file, topic, schema_name, kind, frame_id, len(payloads), readings, note)


# ---------------------------------------------------------------------------------------------------------------------
# The scene of all images: planes over x and y, so that every demosaicing that is exact on planes gives them back away
# from the border. Red rises to the right, green falls downwards, and the bands are at least 0.1 apart everywhere, so
# that swapped bands, swapped axes and a wrong mosaic phase show. Each frame is a little brighter than the one before.

WIDTH, HEIGHT, FRAMES = 16, 12, 3
IMAGE_TOPIC = "/camera/image_raw"
CAMERA_FRAME = "camera_optical_frame"


def scene(frame):
    """Height × width × (red, green, blue), 0..1."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    x, y = x / (WIDTH - 1), y / (HEIGHT - 1)
    rgb = np.stack([0.20 + 0.35 * x, 0.90 - 0.25 * y, 0.05 + 0.15 * x + 0.05 * y], axis=-1) + 0.03 * frame
    assert np.diff(np.sort(rgb, axis=-1), axis=-1).min() > 0.099 and rgb.max() < 0.97
    return rgb


def grey(frame):
    return scene(frame).mean(axis=-1, keepdims=True)


def quantise(image, full_scale):
    return np.round(image * full_scale).astype(np.uint16 if full_scale > 255 else np.uint8)


def mosaic(rgb, pattern):
    """One value per pixel; `pattern` names the colours of the top left 2×2 pixels, row by row."""
    out = np.empty(rgb.shape[:2])
    for k, colour in enumerate(pattern):
        out[k // 2 :: 2, k % 2 :: 2] = rgb[k // 2 :: 2, k % 2 :: 2, "rgb".index(colour)]
    return out[..., np.newaxis]


def corner_points(_frame):
    """For lossless images."""
    return [(0, 0), (9, 4), (WIDTH - 1, HEIGHT - 1)]


def inner_points(frame):
    """For lossy or interpolated ones: off the border, moving so that all four phases of a mosaic occur."""
    return [(4 + frame, 4), (9 + frame, 5), (10 + frame, 7)]


def image_reading(frame, image, bits, linear, full_scale, points, tolerance, decimals):
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "bands": image.shape[-1],
        "bits": bits,
        "linear": linear,
        "full_scale": full_scale,
        "rgb_at": [[x, y, [round(float(v), decimals) for v in image[y, x]]] for x, y in points(frame)],
        "tolerance": tolerance,
    }


def exact_reading(frame, code, linear, full_scale=None):
    """Of a lossless image, from its codes."""
    bits = 8 * code.dtype.itemsize
    full_scale = full_scale or 2**bits - 1
    tolerance, decimals = (0.001, 6) if bits == 8 else (0.00001, 8)
    return image_reading(frame, code / full_scale, bits, linear, full_scale, corner_points, tolerance, decimals)


def mosaic_reading(frame, bits, full_scale=None):
    """Of a mosaic: three bands after demosaicing, linear."""
    full_scale = full_scale or 2**bits - 1
    return image_reading(frame, scene(frame), bits, True, full_scale, inner_points, 0.02, 6)


def image_message(frame, encoding, code, big_endian=False, padding=0):
    """sensor_msgs/Image; `padding` bytes of rubbish end each row."""
    rows = code.astype(code.dtype.newbyteorder(">" if big_endian else "<")).reshape(HEIGHT, -1)
    return {
        "header": header(frame, CAMERA_FRAME),
        "height": HEIGHT,
        "width": WIDTH,
        "encoding": encoding,
        "is_bigendian": int(big_endian),
        "step": rows.nbytes // HEIGHT + padding,
        "data": b"".join(row.tobytes() + b"\xa5" * padding for row in rows),
    }


def image_log(file, encoding, codes, readings, note=None, **layout):
    messages = [image_message(i, encoding, code, **layout) for i, code in enumerate(codes)]
    write_log(file, IMAGE_TOPIC, "sensor_msgs/msg/Image", messages, "image", CAMERA_FRAME, readings, note)


def raw_images():
    frames = range(FRAMES)

    def colour(file, encoding, order, full_scale, note=None, **layout):
        codes = [quantise(scene(i), full_scale) for i in frames]
        readings = [exact_reading(i, c, linear=full_scale > 255) for i, c in zip(frames, codes)]
        alpha = np.full((HEIGHT, WIDTH, 1), 200, dtype=np.uint8)  # neither 0 nor opaque: it must be ignored
        stored = [np.concatenate([c, alpha], axis=-1) if "a" in order else c for c in codes]
        stored = [c[..., ["rgba".index(b) for b in order]] for c in stored]
        image_log(file, encoding, stored, readings, note, **layout)

    def mono(file, encoding, full_scale, note=None, **layout):
        codes = [quantise(grey(i), full_scale) for i in frames]
        readings = [exact_reading(i, c, linear=full_scale > 255) for i, c in zip(frames, codes)]
        image_log(file, encoding, codes, readings, note, **layout)

    def bayer(file, encoding, pattern, bits, full_scale=None, note=None):
        codes = [quantise(mosaic(scene(i), pattern), full_scale or 2**bits - 1) for i in frames]
        readings = [mosaic_reading(i, bits, full_scale) for i in frames]
        image_log(file, encoding, codes, readings, note)

    colour("image_rgb8", "rgb8", "rgb", 255)
    colour("image_bgr8", "bgr8", "bgr", 255)
    colour("image_rgba8", "rgba8", "rgba", 255, "alpha is 200 everywhere and means nothing")
    colour("image_bgra8", "bgra8", "bgra", 255, "alpha is 200 everywhere and means nothing")
    colour("image_rgb16", "rgb16", "rgb", 65535)
    colour("image_bgr16", "bgr16", "bgr", 65535)
    colour("image_8UC3", "8UC3", "bgr", 255, "an OpenCV type: no order stated, blue first by custom")
    colour("image_rgb8_padded_step", "rgb8", "rgb", 255, "step is 64 for 48 bytes of pixels", padding=16)
    colour("image_rgb16_bigendian", "rgb16", "rgb", 65535, "is_bigendian is 1 and true", big_endian=True)
    mono("image_mono8", "mono8", 255)
    mono("image_mono16", "mono16", 65535)
    mono("image_mono16_bigendian", "mono16", 65535, "is_bigendian is 1 and true", big_endian=True)
    for pattern in ("rggb", "bggr", "gbrg", "grbg"):
        bayer(f"image_bayer_{pattern}8", f"bayer_{pattern}8", pattern, 8)
        bayer(f"image_bayer_{pattern}16", f"bayer_{pattern}16", pattern, 16)
    bayer("image_BayerRG8", "BayerRG8", "rggb", 8, note="the GenICam name of bayer_rggb8")
    bayer(
        "image_bayer_rggb16_low12", "bayer_rggb16", "rggb", 16, 4095,
        note="12 bits at the bottom of 16: the largest code is below 4096, and nothing in the message says so",
    )


# ---------------------------------------------------------------------------------------------------------------------
# Compressed images


def jpeg(code, quality, subsampling):
    """JFIF from 8-bit codes of one or three bands. subsampling: "4:4:4", "4:2:0"."""
    out = io.BytesIO()
    image = Image.fromarray(code[..., 0]) if code.shape[-1] == 1 else Image.fromarray(code)
    image.save(out, "JPEG", quality=quality, subsampling=subsampling)
    return out.getvalue()


def png(code):
    """RGB PNG of 8 or 16 bits, written here because Pillow has no 16-bit colour."""

    def chunk(tag, body):
        return struct.pack(">I", len(body)) + tag + body + struct.pack(">I", zlib.crc32(tag + body))

    rows = code.astype(code.dtype.newbyteorder(">"))
    ihdr = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8 * code.dtype.itemsize, 2, 0, 0, 0)
    idat = zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", ihdr) + chunk(b"IDAT", idat) + chunk(b"IEND", b"")


def compressed_images():
    frames = range(FRAMES)

    def log(file, format, pictures, readings, note=None):
        messages = [
            {"header": header(i, CAMERA_FRAME), "format": format, "data": data} for i, data in enumerate(pictures)
        ]
        topic = f"{IMAGE_TOPIC}/compressed"
        write_log(file, topic, "sensor_msgs/msg/CompressedImage", messages, "image", CAMERA_FRAME, readings, note)

    def lossy_reading(frame, image):
        return image_reading(frame, image, 8, False, 255, inner_points, 0.02, 6)

    colour = [quantise(scene(i), 255) for i in frames]
    colour_readings = [lossy_reading(i, scene(i)) for i in frames]
    log("compressed_jpeg", "jpeg", [jpeg(c, 95, "4:2:0") for c in colour], colour_readings, "4:2:0")
    log(
        "compressed_jpeg_rosformat", "rgb8; jpeg compressed bgr8", [jpeg(c, 95, "4:4:4") for c in colour],
        colour_readings, "4:4:4; an ordinary colour JPEG, whatever orders the format names",
    )
    log(
        "compressed_wrong_format", "png", [jpeg(c, 95, "4:4:4") for c in colour],
        colour_readings, "the format says png, the bytes are JPEG",
    )

    log(
        "compressed_jpeg_grey", "mono8; jpeg compressed ",
        [jpeg(quantise(grey(i), 255), 95, "4:4:4") for i in frames],
        [lossy_reading(i, grey(i)) for i in frames], "one component",
    )
    log(
        "compressed_bayer_mosaic_jpeg", "bayer_rggb8; jpeg compressed ",
        [jpeg(quantise(mosaic(scene(i), "rggb"), 255), 98, "4:4:4") for i in frames],
        [mosaic_reading(i, 8) for i in frames], "a one-component JPEG that holds the mosaic itself",
    )

    deep = [quantise(scene(i), 65535) for i in frames]
    log("compressed_png8", "png", [png(c) for c in colour],
        [exact_reading(i, c, linear=False) for i, c in zip(frames, colour)])
    log("compressed_png16", "rgb16; png compressed bgr16", [png(c) for c in deep],
        [exact_reading(i, c, linear=True) for i, c in zip(frames, deep)])


# ---------------------------------------------------------------------------------------------------------------------
# Camera, frames, attitude


def camera_infos():
    width, height = 1920, 1200

    def log(file, model, k, d, note=None):
        calibrated = k[0] != 0
        p = [k[0], k[1], k[2], 0.0, k[3], k[4], k[5], 0.0, k[6], k[7], k[8], 0.0]
        messages = [
            {
                "header": header(i, CAMERA_FRAME),
                "height": height,
                "width": width,
                "distortion_model": model,
                "d": d,
                "k": k,
                "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] if calibrated else [0.0] * 9,
                "p": p,
                "binning_x": 0,
                "binning_y": 0,
                "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
            }
            for i in range(2)
        ]
        reading = {"width": width, "height": height, "model": model, "k": k, "d": d} if calibrated else None
        write_log(file, "/camera/camera_info", "sensor_msgs/msg/CameraInfo", messages, "camera_info", CAMERA_FRAME,
                  [reading] * 2, note)

    k = [1450.25, 0.0, 951.5, 0.0, 1448.75, 602.125, 0.0, 0.0, 1.0]
    log("camera_info_plumb_bob", "plumb_bob", k, [0.215, 0.148, -0.0012, 0.0007, 0.031])
    log("camera_info_rational", "rational_polynomial", k, [0.412, 0.105, 0.0004, -0.0003, 0.017, 0.193, -0.054, 0.008])
    log("camera_info_equidistant", "equidistant", k, [-0.021, 0.0065, -0.0048, 0.0011])
    log("camera_info_uncalibrated", "", [0.0] * 9, [], "k is all 0; width and height are filled in none the less")


def vector(v):
    return dict(zip("xyz", v))


def quaternion(q):
    return dict(zip("xyzw", q))


def rotation(roll_deg, pitch_deg, yaw_deg):
    """The quaternion x, y, z, w of Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(math.radians(a) / 2), math.sin(math.radians(a) / 2)) for a in (roll_deg, pitch_deg, yaw_deg)
    )
    return [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]


def transforms():
    mounts = [
        # A camera that looks down from a body with x forward, y left, z up: image right is body right.
        ("base_link", CAMERA_FRAME, [0.35, 0.0, -0.12], [math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0]),
        # A strobe behind it, the same way up, tilted 15° forward.
        ("base_link", "strobe_optical_frame", [-0.25, 0.08, -0.1], rotation(195.0, 0.0, -90.0)),
    ]
    message = {
        "transforms": [
            {
                "header": header(0, parent),
                "child_frame_id": child,
                "transform": {"translation": vector(t), "rotation": quaternion(q)},
            }
            for parent, child, t, q in mounts
        ]
    }
    readings = [{"parent": parent, "child": child, "t": t, "q": q} for parent, child, t, q in mounts]
    write_log("tf_static", "/tf_static", "tf2_msgs/msg/TFMessage", [message], "transforms", "base_link", readings,
              "one message with two transforms")


def attitudes():
    attitudes = [rotation(2.0, -1.5, 90.0 + 5.0 * i) for i in range(FRAMES)]

    def imu(i, q, covariance):
        return {
            "header": header(i, "imu_link"),
            "orientation": quaternion(q),
            "orientation_covariance": covariance,
            "angular_velocity": vector([0.01, -0.02, 0.35]),
            "angular_velocity_covariance": [1e-6, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0, 0.0, 1e-6],
            "linear_acceleration": vector([0.1, -0.05, 9.8]),
            "linear_acceleration_covariance": [1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4],
        }

    good = [imu(i, q, [1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-3]) for i, q in enumerate(attitudes)]
    write_log("imu", "/imu/data", "sensor_msgs/msg/Imu", good, "attitude", "imu_link", attitudes)

    none = [imu(i, q, [-1.0] + [0.0] * 8) for i, q in enumerate([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]])]
    write_log("imu_no_attitude", "/imu/data_raw", "sensor_msgs/msg/Imu", none, "attitude", "imu_link", [None, None],
              "orientation_covariance[0] is -1; the orientation is the identity, then all 0")

    messages = [
        {
            "header": header(i, "odom"),
            "child_frame_id": "base_link",
            "pose": {
                "pose": {"position": vector([0.1 * i, 0.02 * i, -18.5]), "orientation": quaternion(q)},
                "covariance": [0.01 if k % 7 == 0 else 0.0 for k in range(36)],
            },
            "twist": {
                "twist": {"linear": vector([0.4, 0.08, 0.0]), "angular": vector([0.0, 0.0, 0.35])},
                "covariance": [0.001 if k % 7 == 0 else 0.0 for k in range(36)],
            },
        }
        for i, q in enumerate(attitudes)
    ]
    write_log("odometry", "/odometry/filtered", "nav_msgs/msg/Odometry", messages, "attitude", "odom", attitudes,
              "pose of base_link in odom; the position's z is a depth of 18.5 m, not an altitude")


# ---------------------------------------------------------------------------------------------------------------------
# DVL and altimeters


def x_layout(janus_deg, azimuths_deg):
    """Unit vectors of the beams: x forward, y right, z down, azimuth from x towards y."""
    theta = math.radians(janus_deg)
    return [
        [
            round(math.sin(theta) * math.cos(math.radians(a)), 6),
            round(math.sin(theta) * math.sin(math.radians(a)), 6),
            round(math.cos(theta), 6),
        ]
        for a in azimuths_deg
    ]


NORTEK_DVL500 = x_layout(25.0, [45.0, -45.0, -135.0, 135.0])
# Water Linked A50 as two public drivers publish it: right azimuths, sine and cosine of 22.5° swapped.
SWAPPED_A50 = [[x, y, 0.3827] for x, y in ((-0.6533, 0.6533), (-0.6533, -0.6533), (0.6533, -0.6533), (0.6533, 0.6533))]


def marine_dvl(i, frame_id, directions, ranges, altitude, water=False, ranges_valid=True):
    good = sum(r > 0 for r in ranges) if ranges_valid else 0
    return {
        "header": header(i, frame_id),
        "velocity_mode": 2 if water else 1,
        "dvl_type": 0,
        "velocity": vector([0.4, 0.02, 0.01]),
        "velocity_covar": [1e-5, 0.0, 0.0, 0.0, 1e-5, 0.0, 0.0, 0.0, 1e-5],
        "altitude": altitude,
        "course_gnd": math.atan2(0.02, 0.4),
        "speed_gnd": math.hypot(0.4, 0.02),
        "num_good_beams": good,
        "sound_speed": 1500.0,
        "beam_ranges_valid": ranges_valid,
        "beam_velocities_valid": True,
        "beam_unit_vec": [vector(v) for v in directions],
        "range": ranges,
        "range_covar": [-1.0] * 4,
        "beam_quality": [90.0, 88.0, 91.0, 87.0],
        "beam_velocity": [0.12, -0.11, 0.13, -0.12],
        "beam_velocity_covar": [-1.0] * 4,
    }


def ping(i, ranges, directions):
    return {"stamp_ns": stamp_ns(i), "ranges_m": ranges, "directions": directions}


def marine_dvls():
    schema_name, topic = "marine_acoustic_msgs/msg/Dvl", "/dvl"
    v, frame_id = NORTEK_DVL500, "dvl_link"
    messages = [
        marine_dvl(0, frame_id, v, [2.125, 2.25, 2.375, 2.1875], 2.025),
        marine_dvl(1, frame_id, v, [2.1875, math.nan, 2.4375, -1.0], 2.096),
        marine_dvl(2, frame_id, v, [2.0625, 2.1875, 2.3125, 2.125], -1.0, ranges_valid=False),
        marine_dvl(3, frame_id, v, [6.5, 6.5, 6.5, 6.5], -1.0, water=True),
    ]
    readings = [
        ping(0, [2.125, 2.25, 2.375, 2.1875], v),
        ping(1, [2.1875, None, 2.4375, None], v),
        None,
        None,
    ]
    write_log("dvl_marine_acoustic", topic, schema_name, messages, "dvl", frame_id, readings,
              "25° X layout; good, one beam NaN and one -1, beam_ranges_valid false (plausible ranges left in), "
              "water track (ranges to a water layer)")

    swapped = [[2.0, 2.125, 2.25, 2.0625], [2.0625, 2.1875, 2.3125, 2.125]]
    messages = [marine_dvl(i, frame_id, SWAPPED_A50, r, round(0.92388 * sum(r) / 4, 3)) for i, r in enumerate(swapped)]
    write_log("dvl_marine_acoustic_swapped_vectors", topic, schema_name, messages, "dvl", frame_id,
              [ping(i, r, None) for i, r in enumerate(swapped)],
              "the vectors point 67.5° off the axis: not sane, so none; the ranges and their order are good")


def waterlinked_dvl():
    frame_id, frozen = "dvl_A50_report_link", 1.852

    def message(i, distances, altitude, velocity_valid):
        return {
            "header": header(i, frame_id),
            "time": 250.0,
            "velocity": vector([0.4, 0.02, 0.01] if velocity_valid else [0.0, 0.0, 0.0]),
            "fom": 0.002 if velocity_valid else 2.0,
            "covariance": [4e-6, 0.0, 0.0, 0.0, 4e-6, 0.0, 0.0, 0.0, 4e-6],
            "altitude": altitude,
            "beams": [
                {
                    "id": k,
                    "velocity": 0.1 + 0.01 * k if d > 0 else 0.0,
                    "distance": d,
                    "rssi": -32.5 - k,
                    "nsd": -92.25,
                    "valid": d > 0,
                }
                for k, d in enumerate(distances)
            ],
            "velocity_valid": velocity_valid,
            "status": 0,
            "time_of_validity": stamp_ns(i) // 1000,
            "time_of_transmission": stamp_ns(i) // 1000 + 4000,
            "form": "json_v3",
        }

    messages = [
        message(0, [1.9375, 2.0, 2.0625, 2.03125], round(0.92388 * 2.0078125, 3), True),
        message(1, [1.9375, -1.0, 2.0625, 2.015625], frozen, True),
        message(2, [-1.0] * 4, frozen, False),
    ]
    readings = [
        ping(0, [1.9375, 2.0, 2.0625, 2.03125], None),
        ping(1, [1.9375, None, 2.0625, 2.015625], None),
        None,
    ]
    write_log("dvl_waterlinked", "/dvl/data", "dvl_msgs/msg/DVL", messages, "dvl", frame_id, readings,
              "four good beams; beam 1 invalid; all invalid, with the altitude frozen at the last good value. "
              "The type has no directions: Water Linked's geometry, by beam id")


def altimeters():
    frame_id = "altimeter"  # of a length that leaves a byte of padding before the floats
    field_of_view, min_range, max_range = 0.4375, 0.25, 50.0

    ranges = [1.8125, math.inf, 60.0]
    messages = [
        {
            "header": header(i, frame_id),
            "radiation_type": 0,
            "field_of_view": field_of_view,
            "min_range": min_range,
            "max_range": max_range,
            "range": r,
            "variance": 0.0,
        }
        for i, r in enumerate(ranges)
    ]
    write_log("range", "/altimeter/range", "sensor_msgs/msg/Range", messages, "altitude", frame_id,
              [1.8125, None, None], "good; +Inf (nothing seen); 60 m with max_range 50 m")

    messages = [{"data": a} for a in [1.8125, 0.0, -1.0]]
    write_log("altitude_float64", "/dvl/altitude", "std_msgs/msg/Float64", messages, "altitude", None,
              [1.8125, None, None], "no header: the stamp is the log time")

    messages = [{"data": g} for g in [1.0, 0.5, 0.125]]
    write_log("light_setting_float64", "/camera/gain", "std_msgs/msg/Float64", messages, "light", None,
              [{"value": 1.0}, {"value": 0.5}, {"value": 0.125}], "no header: the stamp is the log time")
    messages = [
        {"header": header(i, CAMERA_FRAME), "camera_time": 0, "brightness": 12, "exposure_time": e, "max_exposure_time": 20000, "gain": g}
        for i, (e, g) in enumerate([(8000, 0.0), (4000, 6.0), (4000, 12.0)])
    ]
    write_log("image_meta_data", "/camera/meta", "flir_camera_msgs/msg/ImageMetaData", messages, "light", CAMERA_FRAME,
              [{"exposure": 8000.0, "gain": 0.0}, {"exposure": 4000.0, "gain": 6.0}, {"exposure": 4000.0, "gain": 12.0}],
              "microseconds and decibels")

    def big_endian_range(i, r):
        sec, nanosec = divmod(stamp_ns(i), 1_000_000_000)
        name = frame_id.encode() + b"\0"
        body = struct.pack(">iII", sec, nanosec, len(name)) + name
        body += struct.pack(">B", 0)  # radiation_type
        body += b"\0" * (-len(body) % 4)  # floats are aligned to 4, counted from after the encapsulation
        body += struct.pack(">ffff", field_of_view, min_range, max_range, r)
        return b"\x00\x00\x00\x00" + body  # CDR_BE, no options

    ranges = [1.8125, 1.875, 1.9375]
    definition = DEFINITIONS["sensor_msgs/Range"].replace("float32 variance\n", "")
    text = schema_text("sensor_msgs/msg/Range", {"sensor_msgs/Range": definition})
    write_raw_log("big_endian_cdr", "/altimeter/range", "sensor_msgs/msg/Range", text,
                  [big_endian_range(i, r) for i, r in enumerate(ranges)], "altitude", frame_id, ranges,
                  "CDR encapsulation 00 00, packed by hand; the older Range without `variance`")


# ---------------------------------------------------------------------------------------------------------------------


def write_expected():
    """JSON with one line per reading: a change shows as one line of a diff."""

    def dump(value):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)

    files = []
    for file in sorted(EXPECTED):
        fields = []
        for key, value in EXPECTED[file].items():
            if key == "readings":
                lines = ",\n".join(f"   {dump(reading)}" for reading in value)
                fields.append(f'  "readings": [\n{lines}\n  ]')
            else:
                fields.append(f"  {dump(key)}: {dump(value)}")
        files.append(f" {dump(file)}: {{\n" + ",\n".join(fields) + "\n }")
    (OUT / "expected.json").write_text("{\n" + ",\n".join(files) + "\n}\n", encoding="utf-8")


def main():
    global OUT
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=OUT, help="folder to write to (default: this one)")
    OUT = parser.parse_args().out
    OUT.mkdir(parents=True, exist_ok=True)

    raw_images()
    compressed_images()
    camera_infos()
    transforms()
    attitudes()
    marine_dvls()
    waterlinked_dvl()
    altimeters()
    other_encodings.logs(sys.modules[__name__])
    instruments.logs(sys.modules[__name__])
    pictures.logs(sys.modules[__name__])
    write_expected()


if __name__ == "__main__":
    main()
