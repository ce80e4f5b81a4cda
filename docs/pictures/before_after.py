#!/usr/bin/env python3
"""Makes before_after.jpg: two frames of the bundled log, raw (brightened 2.2 times) and corrected.

    unwater correct sample_logs/rendered_clear.mcap -o /tmp/clear.mcap
    python3 docs/pictures/before_after.py /tmp/clear.mcap

Needs the Python packages mcap, mcap-ros2-support, numpy and opencv-python-headless.
"""
import pathlib
import sys

import cv2
import numpy as np
from mcap_ros2.reader import read_ros2_messages


def srgb(v):
    v = np.clip(v, 0, 1)
    return np.where(v <= 0.0031308, v * 12.92, 1.055 * v ** (1 / 2.4) - 0.055)


raw, corrected = {}, {}
for m in read_ros2_messages(sys.argv[1], topics=["/camera/image_raw", "/camera/image_corrected/compressed"]):
    message, at = m.ros_msg, m.log_time_ns
    if m.channel.topic == "/camera/image_raw":
        mosaic = np.frombuffer(message.data, "<u2").reshape(message.height, message.width)
        raw[at] = srgb(cv2.cvtColor(mosaic, cv2.COLOR_BayerRGGB2BGR) / 65520 * 2.2)
    else:
        corrected[at] = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR) / 255
stamps = sorted(corrected)
rows = [np.hstack([raw[stamps[i]], corrected[stamps[i]]]) for i in (2, 13)]
sheet = cv2.resize((np.vstack(rows) * 255).astype(np.uint8), None, fx=0.75, fy=0.75, interpolation=cv2.INTER_AREA)
cv2.imwrite(str(pathlib.Path(__file__).parent / "before_after.jpg"), sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])
