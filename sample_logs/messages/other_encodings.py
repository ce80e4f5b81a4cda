"""Writers for the encodings beside ros2msg/CDR, and one log of each kind in each of them. Used by make.py.

ROS 1 through mcap-ros1-support (its own copy of genpy), protobuf through mcap-protobuf-support with classes built from the
tables below, JSON through Python's json, IDL with the CDR bytes that mcap-ros2-support writes.
"""

import base64
import io
import json

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType
from mcap.writer import Writer as RawWriter
from mcap_protobuf.schema import register_schema
from mcap_ros1._vendor.genpy.dynamic import generate_dynamic
from mcap_ros2.writer import Writer as Ros2Writer

# ---------------------------------------------------------------------------------------------------------------------
# ROS 1: `time` is a primitive, headers count, CameraInfo has capitals.

ROS1 = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "geometry_msgs/TransformStamped": "Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "sensor_msgs/Image": "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
    "sensor_msgs/CompressedImage": "Header header        # time of acquisition\nstring format\nuint8[] data\n",
    "sensor_msgs/RegionOfInterest": "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
    "sensor_msgs/CameraInfo": "Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] D\nfloat64[9]  K\n"
    "float64[9]  R\nfloat64[12] P\nuint32 binning_x\nuint32 binning_y\nRegionOfInterest roi\n",
    "waterlinked_a50_ros_driver/DVLBeam": "int64 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\nbool valid\n",
    "waterlinked_a50_ros_driver/DVL": "Header header\nfloat64 time\ngeometry_msgs/Vector3 velocity\nfloat64 fom\nfloat64 altitude\n"
    "DVLBeam[] beams\nbool velocity_valid\nint64 status\nstring form\n",
}


def header1(m, i, frame_id):
    secs, nsecs = divmod(m.stamp_ns(i), 1_000_000_000)
    return {"seq": i, "stamp": {"secs": secs, "nsecs": nsecs}, "frame_id": frame_id}


def ros1_text(root, definitions):
    order = [root]
    for name in order:
        for line in definitions[name].splitlines():
            kind = line.split()[0].split("[")[0]
            full = "std_msgs/Header" if kind == "Header" else kind if "/" in kind else f"{name.split('/')[0]}/{kind}"
            if full in definitions and full not in order:
                order.append(full)
    parts = [definitions[root]] + [f"{'=' * 80}\nMSG: {n}\n{definitions[n]}" for n in order[1:]]
    return "".join(parts)


def ros1_fill(classes, message, value):
    for name, kind in zip(message.__slots__, message._slot_types):
        v = value[name]
        kind, array = kind.split("[")[0], "[" in kind
        if isinstance(v, dict) and kind in ("time", "duration"):
            setattr(message, name, type(getattr(message, name))(v["secs"], v["nsecs"]))
        elif isinstance(v, dict):
            ros1_fill(classes, getattr(message, name), v)
        elif array and v and isinstance(v[0], dict):
            setattr(message, name, [ros1_fill(classes, classes[kind](), one) for one in v])
        else:
            setattr(message, name, v)
    return message


def write_ros1(m, file, topic, name, messages, kind, frame_id, readings, note=None, definitions=None):
    """messages: dicts with the fields of the ROS 1 type."""
    text = ros1_text(name, ROS1 | (definitions or {}))
    classes = generate_dynamic(name, text)
    payloads = []
    for message in messages:
        payload = io.BytesIO()
        ros1_fill(classes, classes[name](), message).serialize(payload)
        payloads.append(payload.getvalue())
    write_payloads(m, file, topic, (name, "ros1msg", text.encode()), "ros1", "ros1", payloads, kind, frame_id, readings, note)


def write_payloads(m, file, topic, schema, encoding, profile, payloads, kind, frame_id, readings, note=None):
    """One log from payloads in any encoding; `schema` is (name, encoding, data), or a name where there is none."""
    with open(m.OUT / f"{file}.mcap", "wb") as f:
        writer = RawWriter(f, compression=CompressionType.ZSTD)
        writer.start(profile=profile)
        schema_id = 0 if isinstance(schema, str) else writer.register_schema(*schema)
        channel_id = writer.register_channel(topic, encoding, schema_id)
        for i, payload in enumerate(payloads):
            log_time, publish_time = m.stamp_ns(i) + m.LOG_DELAY_NS, m.stamp_ns(i) + m.PUBLISH_DELAY_NS
            writer.add_message(channel_id, log_time=log_time, publish_time=publish_time, sequence=i, data=payload)
        writer.finish()
    name = schema if isinstance(schema, str) else schema[0]
    m.expect(file, topic, name, kind, frame_id, len(payloads), readings, note)


# ---------------------------------------------------------------------------------------------------------------------
# protobuf: {message: {field: (number, type)}}; a type may begin with `repeated`.

PROTO = {
    "foxglove.Vector3": {"x": (1, "double"), "y": (2, "double"), "z": (3, "double")},
    "foxglove.Quaternion": {"x": (1, "double"), "y": (2, "double"), "z": (3, "double"), "w": (4, "double")},
    "foxglove.CompressedImage": {"timestamp": (1, "Timestamp"), "frame_id": (4, "string"), "data": (2, "bytes"), "format": (3, "string")},
    "foxglove.RawImage": {
        "timestamp": (1, "Timestamp"), "frame_id": (7, "string"), "width": (2, "fixed32"), "height": (3, "fixed32"),
        "encoding": (4, "string"), "step": (5, "fixed32"), "data": (6, "bytes"),
    },
    "foxglove.CameraCalibration": {
        "timestamp": (1, "Timestamp"), "frame_id": (9, "string"), "width": (2, "fixed32"), "height": (3, "fixed32"),
        "distortion_model": (4, "string"), "D": (5, "repeated double"), "K": (6, "repeated double"),
        "R": (7, "repeated double"), "P": (8, "repeated double"),
    },
    "foxglove.FrameTransform": {
        "timestamp": (1, "Timestamp"), "parent_frame_id": (2, "string"), "child_frame_id": (3, "string"),
        "translation": (4, "foxglove.Vector3"), "rotation": (5, "foxglove.Quaternion"),
    },
    "foxglove.FrameTransforms": {"transforms": (1, "repeated foxglove.FrameTransform")},
}


def proto_class(name, definitions):
    """The class of a message, from a table of definitions, each message in a file of its own."""
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(Timestamp.DESCRIPTOR.file.serialized_pb)
    scalar = descriptor_pb2.FieldDescriptorProto
    done = set()

    def add(full):
        if full in done:
            return
        done.add(full)
        package, short = full.rsplit(".", 1)
        file = descriptor_pb2.FileDescriptorProto(name=f"{full}.proto", package=package, syntax="proto3")
        message = file.message_type.add(name=short)
        for field_name, (number, kind) in definitions[full].items():
            field = message.field.add(name=field_name, number=number)
            repeated, kind = kind.startswith("repeated "), kind.removeprefix("repeated ")
            field.label = scalar.LABEL_REPEATED if repeated else scalar.LABEL_OPTIONAL
            if kind == "Timestamp":
                field.type, field.type_name = scalar.TYPE_MESSAGE, ".google.protobuf.Timestamp"
                dependency = "google/protobuf/timestamp.proto"
            elif kind in definitions:
                add(kind)
                field.type, field.type_name, dependency = scalar.TYPE_MESSAGE, f".{kind}", f"{kind}.proto"
            else:
                field.type, dependency = getattr(scalar, f"TYPE_{kind.upper()}"), None
            if dependency and dependency not in file.dependency:
                file.dependency.append(dependency)
        pool.AddSerializedFile(file.SerializeToString())

    add(name)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def proto_fill(message, value):
    for name, v in value.items():
        field = getattr(message, name)
        if isinstance(v, dict):
            field.SetInParent()
            proto_fill(field, v)
        elif isinstance(v, list) and v and isinstance(v[0], dict):
            for one in v:
                proto_fill(field.add(), one)
        elif isinstance(v, list):
            field.extend(v)
        else:
            setattr(message, name, v)
    return message


def write_proto(m, file, topic, name, messages, kind, frame_id, readings, note=None, definitions=None):
    made = proto_class(name, PROTO | (definitions or {}))
    sink = RawWriter(io.BytesIO())
    sink.start()
    register_schema(sink, made)
    schema = sink._Writer__schemas[1] if hasattr(sink, "_Writer__schemas") else sink._schemas[1]
    payloads = [proto_fill(made(), message).SerializeToString(deterministic=True) for message in messages]
    write_payloads(m, file, topic, (name, "protobuf", schema.data), "protobuf", "", payloads, kind, frame_id, readings, note)


def timestamp(m, i):
    seconds, nanos = divmod(m.stamp_ns(i), 1_000_000_000)
    return {"seconds": seconds, "nanos": nanos}


# ---------------------------------------------------------------------------------------------------------------------
# JSON


def write_json(m, file, topic, name, schema, messages, kind, frame_id, readings, note=None):
    """`schema` is None for a channel without one."""
    full = name if schema is None else (name, "jsonschema", json.dumps(schema).encode())
    payloads = [json.dumps(message, allow_nan=False).encode() for message in messages]
    write_payloads(m, file, topic, full, "json", "", payloads, kind, frame_id, readings, note)


def time_schema():
    return {"type": "object", "title": "time", "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer"}}}


def json_object(**properties):
    return {"type": "object", "properties": properties}


NUMBER, INTEGER, STRING, BOOLEAN = {"type": "number"}, {"type": "integer"}, {"type": "string"}, {"type": "boolean"}
BASE64 = {"type": "string", "contentEncoding": "base64"}

IDL = """\
================================================================================
IDL: dvl_msgs/msg/DVL
// generated from rosidl_adapter/resource/msg.idl.em
// with input from dvl_msgs/msg/DVL.msg

#include "dvl_msgs/msg/DVLBeam.idl"
#include "geometry_msgs/msg/Vector3.idl"
#include "std_msgs/msg/Header.idl"

module dvl_msgs {
  module msg {
    @verbatim (language="comment", text=
      "A50 report" "\\n"
      "json_v3")
    struct DVL {
      std_msgs::msg::Header header;

      @unit (value="ms")
      double time;
      geometry_msgs::msg::Vector3 velocity;
      double fom;
      sequence<double> covariance;
      double altitude;
      sequence<dvl_msgs::msg::DVLBeam> beams;
      boolean velocity_valid;
      int64 status;
      int64 time_of_validity;
      int64 time_of_transmission;
      string form;
    };
  };
};
================================================================================
IDL: dvl_msgs/msg/DVLBeam
module dvl_msgs {
  module msg {
    struct DVLBeam {
      int64 id;
      double velocity;
      double distance;
      double rssi;
      double nsd;
      boolean valid;
    };
  };
};
================================================================================
IDL: geometry_msgs/msg/Vector3
module geometry_msgs { module msg { struct Vector3 { double x, y, z; }; }; };
================================================================================
IDL: std_msgs/msg/Header
#include "builtin_interfaces/msg/Time.idl"
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
================================================================================
IDL: builtin_interfaces/msg/Time
module builtin_interfaces { module msg { struct Time { int32 sec; uint32 nanosec; }; }; };
"""


def cdr_payloads(m, schema_name, messages):
    """What mcap-ros2-support makes of the messages."""
    out = io.BytesIO()
    writer = Ros2Writer(out, compression=CompressionType.NONE)
    schema = writer.register_msgdef(schema_name, m.schema_text(schema_name))
    for i, message in enumerate(messages):
        writer.write_message("/x", schema, message, log_time=i, publish_time=i, sequence=i)
    writer.finish()
    from mcap.reader import make_reader

    return [found.data for _, _, found in make_reader(io.BytesIO(out.getvalue())).iter_messages()]


# ---------------------------------------------------------------------------------------------------------------------


def logs(m):
    """`m` is make.py: its scene, its stamps, its expectations."""
    frames = range(m.FRAMES)
    camera, topic = m.CAMERA_FRAME, f"{m.IMAGE_TOPIC}/compressed"
    colour = [m.quantise(m.scene(i), 255) for i in frames]
    raw_readings = [m.exact_reading(i, c, linear=False) for i, c in zip(frames, colour)]
    pngs = [m.png(c) for c in colour]
    k = [1450.25, 0.0, 951.5, 0.0, 1448.75, 602.125, 0.0, 0.0, 1.0]
    d = [-0.021, 0.0065, -0.0048, 0.0011]
    calibration = {"width": 1920, "height": 1200, "model": "equidistant", "k": k, "d": d}
    p = [k[0], 0.0, k[2], 0.0, 0.0, k[4], k[5], 0.0, 0.0, 0.0, 1.0, 0.0]
    mounts = [
        ("base_link", camera, [0.35, 0.0, -0.12], m.rotation(180.0, 0.0, -90.0)),
        ("base_link", "strobe_optical_frame", [-0.25, 0.0, -0.1], m.rotation(195.0, 0.0, -90.0)),
    ]
    edges = [{"parent": parent, "child": child, "t": t, "q": q} for parent, child, t, q in mounts]
    note = "ROS 1 serialisation: no alignment, no NUL; headers with seq"

    # ROS 1
    write_ros1(m, "ros1_image", m.IMAGE_TOPIC, "sensor_msgs/Image",
               [m.image_message(i, "rgb8", c) | {"header": header1(m, i, camera)} for i, c in enumerate(colour)],
               "image", camera, raw_readings, note)
    write_ros1(m, "ros1_compressed_image", topic, "sensor_msgs/CompressedImage",
               [{"header": header1(m, i, camera), "format": "png", "data": data} for i, data in enumerate(pngs)],
               "image", camera, raw_readings, note)
    roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    info = {"height": 1200, "width": 1920, "distortion_model": "equidistant", "D": d, "K": k,
            "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "P": p, "binning_x": 0, "binning_y": 0, "roi": roi}
    write_ros1(m, "ros1_camera_info", "/camera/camera_info", "sensor_msgs/CameraInfo",
               [info | {"header": header1(m, i, f"/{camera}")} for i in range(2)], "camera_info", camera, [calibration] * 2,
               "capital D, K, R, P; the frame id begins with a slash, as ROS 1 allowed")
    message = {"transforms": [
        {"header": header1(m, 0, f"/{parent}"), "child_frame_id": f"/{child}",
         "transform": {"translation": m.vector(t), "rotation": m.quaternion(q)}} for parent, child, t, q in mounts]}
    write_ros1(m, "ros1_tf_static", "/tf_static", "tf2_msgs/TFMessage", [message], "transforms", "base_link", edges)
    distances = [[1.9375, 2.0, 2.0625, 2.03125], [1.9375, -1.0, 2.0625, 2.015625]]

    def beams(i):
        return [{"id": n, "velocity": 0.1, "distance": r, "rssi": -32.5, "nsd": -92.25, "valid": r > 0}
                for n, r in enumerate(distances[i])]

    readings = [m.ping(0, [1.9375, 2.0, 2.0625, 2.03125], None), m.ping(1, [1.9375, None, 2.0625, 2.015625], None)]
    report = {"time": 250.0, "velocity": m.vector([0.4, 0.02, 0.01]), "fom": 0.002, "altitude": 1.852, "velocity_valid": True,
              "status": 0, "form": "json_v3"}
    write_ros1(m, "ros1_dvl_waterlinked", "/dvl/data", "waterlinked_a50_ros_driver/DVL",
               [report | {"header": header1(m, i, "dvl_link"), "beams": beams(i)} for i in range(2)], "dvl", "dvl_link", readings)

    # IDL
    extra = {"covariance": [4e-6, 0.0], "time_of_validity": 0, "time_of_transmission": 0}
    messages = [report | extra | {"header": m.header(i, "dvl_link"), "beams": beams(i)} for i in range(2)]
    write_payloads(m, "idl_dvl_waterlinked", "/dvl/data", ("dvl_msgs/msg/DVL", "ros2idl", IDL.encode()), "cdr", "ros2",
                   cdr_payloads(m, "dvl_msgs/msg/DVL", messages), "dvl", "dvl_link", readings,
                   "schema encoding ros2idl; time_of_validity is 0, as older drivers leave it")

    # protobuf
    write_proto(m, "foxglove_compressed_image", topic, "foxglove.CompressedImage",
                [{"timestamp": timestamp(m, i), "frame_id": camera, "data": data, "format": "png"} for i, data in enumerate(pngs)],
                "image", camera, raw_readings)
    write_proto(m, "foxglove_raw_image", m.IMAGE_TOPIC, "foxglove.RawImage",
                [{"timestamp": timestamp(m, i), "frame_id": camera, "width": m.WIDTH, "height": m.HEIGHT, "encoding": "rgb8",
                  "step": 3 * m.WIDTH, "data": c.tobytes()} for i, c in enumerate(colour)], "image", camera, raw_readings)
    write_proto(m, "foxglove_camera_calibration", "/camera/calibration", "foxglove.CameraCalibration",
                [{"timestamp": timestamp(m, i), "frame_id": camera, "width": 1920, "height": 1200, "distortion_model": "kannala_brandt",
                  "D": d, "K": k, "R": [], "P": p} for i in range(2)], "camera_info", camera, [calibration] * 2,
                "kannala_brandt is what ROS calls equidistant")
    transforms = [{"timestamp": timestamp(m, 0), "parent_frame_id": parent, "child_frame_id": child, "translation": m.vector(t),
                   "rotation": m.quaternion(q)} for parent, child, t, q in mounts]
    write_proto(m, "foxglove_frame_transforms", "/tf_static", "foxglove.FrameTransforms", [{"transforms": transforms}],
                "transforms", "base_link", edges, "a translation of 0 is not on the wire: proto3's default")
    write_proto(m, "foxglove_frame_transform", "/tf_static", "foxglove.FrameTransform", transforms[:1],
                "transforms", "base_link", edges[:1])

    # JSON
    def now(i):
        sec, nsec = divmod(m.stamp_ns(i), 1_000_000_000)
        return {"sec": sec, "nsec": nsec}

    schema = json_object(timestamp=time_schema(), frame_id=STRING, data=BASE64, format=STRING)
    write_json(m, "json_compressed_image", topic, "foxglove.CompressedImage", schema,
               [{"timestamp": now(i), "frame_id": camera, "data": base64.b64encode(data).decode(), "format": "png"}
                for i, data in enumerate(pngs)], "image", camera, raw_readings, "base64 by the schema's contentEncoding")
    schema = json_object(timestamp=time_schema(), frame_id=STRING, width=INTEGER, height=INTEGER, encoding=STRING, step=INTEGER, data=BASE64)
    write_json(m, "json_raw_image", m.IMAGE_TOPIC, "foxglove.RawImage", schema,
               [{"timestamp": now(i), "frame_id": camera, "width": m.WIDTH, "height": m.HEIGHT, "encoding": "rgb8", "step": 3 * m.WIDTH,
                 "data": base64.b64encode(c.tobytes()).decode()} for i, c in enumerate(colour)], "image", camera, raw_readings)
    write_json(m, "json_schemaless_dvl", "/dvl/data", "dvl_msgs/msg/DVL", None,
               [report | {"header": m.header(i, "dvl_link"), "beams": beams(i)} for i in range(2)], "dvl", "dvl_link", readings,
               "schema id 0: the first message says what shape the channel has")
