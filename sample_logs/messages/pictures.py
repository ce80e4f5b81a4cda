"""Pictures and what is shaped like them: YUV, packed names, WebP, video, depth, clouds, cropped calibrations. Used by make.py."""

import io
import math
import struct
import zlib

import numpy as np
import other_encodings as other
from PIL import Image

DEFINITIONS = {
    "foxglove_msgs/CompressedImage": "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
    "foxglove_msgs/RawImage": "builtin_interfaces/Time timestamp\nstring frame_id\nuint32 width\nuint32 height\nstring encoding\nuint32 step\nuint8[] data\n",
    "ffmpeg_image_transport_msgs/FFMPEGPacket": "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
    "sensor_msgs/PointField": "uint8 INT8=1\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n",
    "sensor_msgs/PointCloud2": "std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\nuint32 point_step\n"
    "uint32 row_step\nuint8[] data\nbool is_dense\n",
}

PROTO = {
    "foxglove.CompressedVideo": {"timestamp": (1, "Timestamp"), "frame_id": (2, "string"), "data": (3, "bytes"), "format": (4, "string")},
    "foxglove.PackedElementField": {"name": (1, "string"), "offset": (2, "fixed32"), "type": (3, "int32")},
    "foxglove.PointCloud": {"timestamp": (1, "Timestamp"), "frame_id": (2, "string"), "point_stride": (4, "fixed32"),
                            "fields": (5, "repeated foxglove.PackedElementField"), "data": (6, "bytes")},
}


def to_yuv(rgb8):
    """BT.601, video levels."""
    r, g, b = (rgb8[..., n].astype(float) / 255 for n in range(3))
    luma = 0.299 * r + 0.587 * g + 0.114 * b
    return 16 + 219 * luma, 128 + 224 * (b - luma) / 1.772, 128 + 224 * (r - luma) / 1.402


def logs(m):
    m.DEFINITIONS.update(DEFINITIONS)
    frames, camera = range(m.FRAMES), m.CAMERA_FRAME
    colour = [m.quantise(m.scene(i), 255) for i in frames]

    # ---- YUV: chroma is halved, so the readings are those of a lossy picture
    def rounded(plane):
        return np.clip(np.round(plane), 0, 255).astype(np.uint8)

    def halved(plane, rows):
        plane = (plane[:, 0::2] + plane[:, 1::2]) / 2
        return (plane[0::2] + plane[1::2]) / 2 if rows else plane

    def yuv_log(file, encoding, pack, note):
        readings = [m.image_reading(i, m.scene(i), 8, False, 255, m.inner_points, 0.03, 6) for i in frames]
        messages = []
        for i, c in enumerate(colour):
            data, step = pack(*to_yuv(c))
            messages.append({"header": m.header(i, camera), "height": m.HEIGHT, "width": m.WIDTH, "encoding": encoding, "is_bigendian": 0,
                             "step": step, "data": data})
        m.write_log(file, m.IMAGE_TOPIC, "sensor_msgs/msg/Image", messages, "image", camera, readings, note)

    def packed(order):
        def pack(y, u, v):
            planes = {"y": rounded(y)[:, 0::2], "z": rounded(y)[:, 1::2], "u": rounded(halved(u, False)), "v": rounded(halved(v, False))}
            return np.stack([planes[o] for o in order], axis=-1).tobytes(), 2 * m.WIDTH

        return pack

    def planar(order):
        def pack(y, u, v):
            chroma = {"u": rounded(halved(u, True)), "v": rounded(halved(v, True))}
            return rounded(y).tobytes() + np.stack([chroma[o] for o in order], axis=-1).tobytes(), m.WIDTH

        return pack

    yuv_log("image_yuv422", "yuv422", packed("uyvz"), "the old name of uyvy")
    yuv_log("image_yuv422_yuy2", "yuv422_yuy2", packed("yuzv"), "the old name of yuyv")
    yuv_log("image_nv12", "nv12", planar("uv"), "a plane of Y, then U and V in pairs, halved")
    yuv_log("image_nv21", "nv21", planar("vu"), "as nv12 with V first")

    # ---- names of other worlds
    codes = [m.quantise(m.mosaic(m.scene(i), "rggb"), 4095) for i in frames]
    m.image_log("image_bayer_rggb12", "bayer_rggb12", codes, [m.mosaic_reading(i, 16, 4095) for i in frames], "12 bits at the bottom of 16")
    codes = [m.quantise(m.grey(i), 4095) * 16 for i in frames]
    readings = [m.image_reading(i, c / 65520, 16, True, 65520, m.corner_points, 0.00001, 8) for i, c in zip(frames, codes)]
    m.image_log("image_mono12_high", "mono12", codes, readings, "12 bits at the top of 16")
    m.image_log("image_BGR8", "BGR8", [c[..., ::-1] for c in colour], [m.exact_reading(i, c, linear=False) for i, c in zip(frames, colour)],
                "the GenICam name of bgr8")

    # ---- bits without gaps, as GenICam cameras send them
    def bits_in_a_row(code, bits):
        """`…p`: every sample's lowest bit first, one after the other."""
        planes = (code.reshape(m.HEIGHT, -1, 1).astype(np.uint16) >> np.arange(bits)) & 1
        return np.packbits(planes.reshape(m.HEIGHT, -1).astype(np.uint8), axis=1, bitorder="little")

    def gige(code, bits):
        """`…Packed`: the high bytes of two samples, and between them their low bits in a nibble each."""
        low = (1 << (bits - 8)) - 1
        a, b = code[:, 0::2].astype(np.uint16), code[:, 1::2].astype(np.uint16)
        return np.stack([a >> (bits - 8), (a & low) | (b & low) << 4, b >> (bits - 8)], axis=-1).reshape(m.HEIGHT, -1).astype(np.uint8)

    def bit_log(file, encoding, pack, codes, readings, note):
        messages = []
        for i, code in enumerate(codes):
            rows = pack(code)
            messages.append({"header": m.header(i, camera), "height": m.HEIGHT, "width": m.WIDTH, "encoding": encoding, "is_bigendian": 0,
                             "step": rows.shape[1], "data": rows.tobytes()})
        m.write_log(file, m.IMAGE_TOPIC, "sensor_msgs/msg/Image", messages, "image", camera, readings, note)

    codes = [m.quantise(m.mosaic(m.scene(i), "rggb"), 4095) for i in frames]
    readings = [m.mosaic_reading(i, 16, 4095) for i in frames]
    bit_log("image_bayer_rggb12p", "bayer_rggb12p", lambda c: bits_in_a_row(c, 12), codes, readings, "12 bits in a row, lowest first")
    bit_log("image_BayerRG12Packed", "BayerRG12Packed", lambda c: gige(c, 12), codes, readings, "two samples of 12 bits in three bytes")
    codes = [m.quantise(m.grey(i), 1023) for i in frames]
    readings = [m.image_reading(i, c / 1023, 16, True, 1023, m.corner_points, 0.00001, 8) for i, c in zip(frames, codes)]
    bit_log("image_mono10p", "mono10p", lambda c: bits_in_a_row(c, 10), codes, readings, "10 bits in a row, lowest first")

    # ---- WebP
    def webp(code, lossless):
        out = io.BytesIO()
        Image.fromarray(code).save(out, "WEBP", lossless=lossless, quality=95, exact=True)
        return out.getvalue()

    for file, lossless, tolerance in (("compressed_webp", False, 0.03), ("compressed_webp_lossless", True, 0.001)):
        messages = [{"header": m.header(i, camera), "format": "webp", "data": webp(c, lossless)} for i, c in enumerate(colour)]
        readings = [m.image_reading(i, c / 255, 8, False, 255, m.inner_points, tolerance, 6) for i, c in zip(frames, colour)]
        m.write_log(file, f"{m.IMAGE_TOPIC}/compressed", "sensor_msgs/msg/CompressedImage", messages, "image", camera, readings)

    # ---- Foxglove's messages in ROS 2
    stamps = [{"timestamp": m.header(i, "")["stamp"], "frame_id": camera} for i in frames]
    readings = [m.exact_reading(i, c, linear=False) for i, c in zip(frames, colour)]
    m.write_log("foxglove_msgs_compressed_image", f"{m.IMAGE_TOPIC}/compressed", "foxglove_msgs/msg/CompressedImage",
                [stamp | {"data": m.png(c), "format": "png"} for stamp, c in zip(stamps, colour)], "image", camera, readings, "foxglove.CompressedImage in CDR")
    m.write_log("foxglove_msgs_raw_image", m.IMAGE_TOPIC, "foxglove_msgs/msg/RawImage",
                [stamp | {"width": m.WIDTH, "height": m.HEIGHT, "encoding": "rgb8", "step": 3 * m.WIDTH, "data": c.tobytes()}
                 for stamp, c in zip(stamps, colour)], "image", camera, readings, "foxglove.RawImage in CDR")

    # ---- video: packets that are never decoded
    start = b"\0\0\0\1\x67\x42\0\x0a"
    other.write_proto(m, "foxglove_compressed_video", "/camera/video", "foxglove.CompressedVideo",
                      [{"timestamp": other.timestamp(m, 0), "frame_id": camera, "data": start, "format": "h264"}], "video", camera, ["h264"],
                      "refused, with the remedy", definitions=PROTO)
    m.write_log("ffmpeg_packet", "/camera/image_raw/ffmpeg", "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
                [{"header": m.header(0, camera), "width": m.WIDTH, "height": m.HEIGHT, "encoding": "hevc", "pts": 0, "flags": 1, "is_bigendian": False,
                  "data": start}], "video", camera, ["hevc"], "refused, with the remedy")

    # ---- depth: a tilted plane; some of it missing
    width, height = 40, 24
    y, x = np.mgrid[0:height, 0:width].astype(float)
    depth = 2.0 + 0.01 * x - 0.005 * y
    hole = (x < 8) & (y < 6)
    places = [((2 * i + 1) * width // 10, (2 * j + 1) * height // 8) for j in range(4) for i in range(5)]
    reading = {"width": width, "height": height, "samples": [[u, v, round(2.0 + 0.01 * u - 0.005 * v, 6)] for u, v in places if not (u < 8 and v < 6)]}

    def depth_message(encoding, code):
        return {"header": m.header(0, camera), "height": height, "width": width, "encoding": encoding, "is_bigendian": 0,
                "step": code.nbytes // height, "data": code.tobytes()}

    millimetres = np.where(hole, 0, np.round(depth * 1000)).astype("<u2")
    metres = np.where(hole, math.nan, depth).astype("<f4")
    m.write_log("depth_16UC1", "/stereo/depth/image_rect", "sensor_msgs/msg/Image", [depth_message("16UC1", millimetres)], "depth", camera, [reading],
                "millimetres; 0 is none; the topic says depth")
    m.write_log("depth_32FC1", "/stereo/depth/image_rect", "sensor_msgs/msg/Image", [depth_message("32FC1", metres)], "depth", camera, [reading],
                "metres; NaN is none")

    def png16(code):
        def chunk(tag, body):
            return struct.pack(">I", len(body)) + tag + body + struct.pack(">I", zlib.crc32(tag + body))

        rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in code)
        ihdr = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
        return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", ihdr) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")

    a, b = 100000.0, 100.0
    inverse = np.where(hole, 0, np.round(a / depth + b)).astype(np.uint16)
    for file, word, header, code in (("depth_compressed_16UC1", "16UC1", struct.pack("<iff", 0, 0.0, 0.0), millimetres),
                                     ("depth_compressed_32FC1", "32FC1", struct.pack("<iff", 0, a, b), inverse)):
        m.write_log(file, "/stereo/depth/image_rect/compressedDepth", "sensor_msgs/msg/CompressedImage",
                    [{"header": m.header(0, camera), "format": f"{word}; compressedDepth png", "data": header + png16(code)}], "depth", camera, [reading],
                    "12 bytes of parameters, then a PNG" + ("; inverse depth, quantised" if word == "32FC1" else ""))

    # ---- clouds
    points = [(0.5, 0.25, 2.0), (math.nan,) * 3, (-0.5, 0.25, 2.0625), (0.0, -0.5, 1.9375)]
    found = [p for p in points if not math.isnan(p[0])]
    norms = [math.sqrt(sum(c * c for c in p)) for p in found]
    readings = [m.ping(0, norms, [[c / n for c in p] for p, n in zip(found, norms)])]
    fields = [{"name": n, "offset": 4 * k, "datatype": 7, "count": 1} for k, n in enumerate("xyz")]
    data = b"".join(struct.pack("<ffff", *p, 1.0) for p in points)
    m.write_log("point_cloud2", "/stereo/points", "sensor_msgs/msg/PointCloud2",
                [{"header": m.header(0, camera), "height": 1, "width": len(points), "fields": fields, "is_bigendian": False, "point_step": 16,
                  "row_step": len(data), "data": data, "is_dense": False}], "dvl", camera, readings, "one point is NaN; four bytes of padding")
    data = b"".join(struct.pack("<ddd", *p) for p in points)
    other.write_proto(m, "foxglove_point_cloud", "/stereo/points", "foxglove.PointCloud",
                      [{"timestamp": other.timestamp(m, 0), "frame_id": camera, "point_stride": 24, "data": data,
                        "fields": [{"name": n, "offset": 8 * k, "type": 8} for k, n in enumerate("xyz")]}], "dvl", camera, readings,
                      "64-bit coordinates", definitions=PROTO)

    # ---- calibrations
    k, d = [1450.25, 0.0, 951.5, 0.0, 1448.75, 602.125, 0.0, 0.0, 1.0], [0.215, 0.148, -0.0012, 0.0007, 0.031]
    message = {"header": m.header(0, camera), "height": 1200, "width": 1920, "distortion_model": "plumb_bob", "d": d, "k": k, "r": [0.0] * 9,
               "p": [0.0] * 12, "binning_x": 2, "binning_y": 2,
               "roi": {"x_offset": 320, "y_offset": 200, "height": 800, "width": 1280, "do_rectify": False}}
    cropped = [k[0] / 2, 0.0, (k[2] + 0.5 - 320) / 2 - 0.5, 0.0, k[4] / 2, (k[5] + 0.5 - 200) / 2 - 0.5, 0.0, 0.0, 1.0]
    m.write_log("camera_info_cropped", "/camera/camera_info", "sensor_msgs/msg/CameraInfo", [message], "camera_info", camera,
                [{"width": 640, "height": 400, "model": "plumb_bob", "k": cropped, "d": d}], "a region of interest, binned 2×2: K is the whole sensor's")
    d = [-0.021, 0.0065, -0.0048, 0.0011, 0.0004, -0.0002]
    other.write_proto(m, "foxglove_fisheye62", "/camera/calibration", "foxglove.CameraCalibration",
                      [{"timestamp": other.timestamp(m, 0), "frame_id": camera, "width": 1920, "height": 1200, "distortion_model": "fisheye62",
                        "D": d, "K": k, "R": [], "P": []}], "camera_info", camera, [{"width": 1920, "height": 1200, "model": "fisheye62", "k": k, "d": d}])
