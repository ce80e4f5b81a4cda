"""Range instruments as their drivers publish them: one log per shape. Used by make.py.

Field lists follow the drivers' own definitions; what no reader of ranges looks at is cut short. Readings are stated here, never
decoded: slant ranges, so a vertical one is divided by the cosine of the beam's angle.
"""

import math

import other_encodings as other

HEADER, VECTOR = "std_msgs/Header header\n", "geometry_msgs/Vector3"
A50 = (22.5, [135.0, -135.0, -45.0, 45.0])
LINKQUEST = (22.0, [45.0, -45.0, -135.0, 135.0])
NORTEK = (25.0, [45.0, -45.0, -135.0, 135.0])
NUCLEUS = (20.0, [0.0, 120.0, -120.0])
TELEDYNE = (30.0, [180.0, 0.0, 90.0, -90.0])

DEFINITIONS = {
    "geometry_msgs/PoseStamped": HEADER + "Pose pose\n",
    "geometry_msgs/PointStamped": HEADER + "Point point\n",
    "uuv_sensor_ros_plugins_msgs/DVLBeam": "float64 range\nfloat64 range_covariance\nfloat64 velocity\nfloat64 velocity_covariance\n"
    "geometry_msgs/PoseStamped pose\n",
    "uuv_sensor_ros_plugins_msgs/DVL": HEADER + "geometry_msgs/Vector3 velocity\nfloat64[9] velocity_covariance\nfloat64 altitude\nDVLBeam[] beams\n",
    "dave_interfaces/DVLBeam": "int64 id\nstring reference\nfloat64 range\nbool locked\n",
    "dave_interfaces/DVL": HEADER + "string type\nfloat64 target\nDVLBeam[] beams\n",
    "marine_conventions/DVLBeam": "string frame_id\nfloat64 range\nfloat64 range_covariance\nfloat64 velocity\nfloat32 field_of_view\n",
    "marine_conventions/DVL": HEADER + "uint8 velocity_reference\ngeometry_msgs/Vector3 velocity\nfloat64 range\nDVLBeam[] beams\n",
    "coug_interfaces/DvlBeamList": HEADER + "sensor_msgs/Range[] beams\n",
    "ds_sensor_msgs/Range3D": "geometry_msgs/PointStamped range\nfloat32 range_quality\nuint8 range_validity\n",
    "ds_sensor_msgs/Ranges3D": HEADER + "Range3D[] ranges\nuint8 soundspeed_correction_type\n",
    "ds_sensor_msgs/RdiPD0": HEADER + "float32[4] range\nfloat32[4] correlation\nfloat32[4] percent_good\nfloat32 config_beamangle\n",
    "cirs_girona_cala_viuda/LinkquestDvl": HEADER + "string errcode\nint32[4] datagood\nfloat64[4] altitudebeam\nfloat64[4] bottomvelocitybeam\n"
    "float64[3] velocityinst\nint32 velocityinstflag\nfloat64 altitude\nfloat64 soundspeed\n",
    "nortek_dvl333/BottomTrack": HEADER + "".join(f"float32 {f}_beam{n}\n" for f in ("vel", "dist", "fom") for n in range(4)) + "uint32 status\n",
    "interfaces/BottomTrack": "builtin_interfaces/Time system_timestamp\nuint32 posix_time\n"
    + "".join(f"bool beam_{n}_distance_valid\n" for n in (1, 2, 3)) + "".join(f"float32 distance_beam_{n}\n" for n in (1, 2, 3)),
    "interfaces/Altimeter": "builtin_interfaces/Time system_timestamp\nbool altimeter_distance_valid\nfloat32 altimeter_distance\n"
    "uint16 altimeter_quality\n",
    "osu_dvl/Dvl": HEADER + "".join(f"float32 b{n}_dist\nbool b{n}_dist_valid\n" for n in (1, 2, 3, 4)),
    "holoocean_interfaces/DVLSensorRange": HEADER + "float32[4] range\n",
    "five_beam/Profile": HEADER + "float64[5] beam_ranges\nfloat64 altitude\n",
    "ping_msgs/Ping1D": HEADER + "uint32 distance\nuint16 confidence\nuint16 transmit_duration\nuint32 ping_number\nuint32 scan_start\nuint32 scan_length\n",
    "cola2_msgs/NavSts": HEADER + "float64 latitude_of_origin\nfloat32 depth\nfloat32 altitude\n",
    "acme_msgs/Cell": "uint16 depth_mm\nbool ok\n",
    "acme_msgs/Sounder": HEADER + "Cell[] cells\n",
}

# ROS 1 types
ROS1 = {
    "uri/Transducer": "int32 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\nbool beam_valid\n",
    "uri/TransducerReport": "float64 vx\nfloat64 altitude\nTransducer[] transducers\nbool velocity_valid\nint32 status\ntime time_of_validity\n",
    "uri/TransducerReportStamped": "Header header\nTransducerReport report\n",
    "ds_core_msgs/DsHeader": "time io_time\nuint8[16] source_uuid\n",
    "ds_sensor_msgs/Dvl": "Header header\nds_core_msgs/DsHeader ds_header\nfloat64 dvl_time\ngeometry_msgs/Vector3 velocity\nfloat64 altitude\n"
    "uint8 num_good_beams\ngeometry_msgs/Vector3[4] beam_unit_vec\nfloat64[4] range\nfloat32[4] beam_quality\nuint8 velocity_mode\n",
    "ds_sensor_msgs/NortekDF21": "Header header\nfloat32[4] velBeam\nfloat32[4] distBeam\nfloat32[4] fomBeam\nfloat32[4] timeDiff1Beam\n",
    "nortek_dvl/ButtomTrack": "Header header\nfloat64 dvl_time\nfloat32 speed\nfloat32[4] vertical_distance\nfloat32 figure_of_merit\n",
    "cola2_msgs/LinkquestDvl": "Header header\nstring errcode\nint32[4] dataGood\nfloat64[4] altitudeBeam\nfloat64[4] bottomVelocityBeam\n"
    "float64 altitude\nfloat64 soundSpeed\n",
    "navquest_dvl/Altitudes": "Header header\n" + "".join(f"float64 Altitude{n}\nbool Beam{n}Valid\n" for n in (1, 2, 3, 4)),
    "sensors/Nucleus1000_bottomtrack": "Header header\nfloat64[] beam_distance\nbool data_valid\nfloat64[] dvl_velocity_xyz\n",
    "rti_dvl/DVL": "Header header\ngeometry_msgs/Vector3 velocity\nfloat64 altitude\nfloat64 time\n",
    "gso/Dvl": "Header header\ngeometry_msgs/Vector3 velocity\ngeometry_msgs/Vector3 quality\nfloat64 avg_altitude\nfloat64 temperature\n",
}

PROTO = {
    "gz.msgs.Time": {"sec": (1, "int64"), "nsec": (2, "int32")},
    "gz.msgs.Map": {"key": (1, "string"), "value": (2, "repeated string")},
    "gz.msgs.Header": {"stamp": (1, "gz.msgs.Time"), "data": (2, "repeated gz.msgs.Map")},
    "gz.msgs.DVLRangeEstimate": {"mean": (1, "double"), "variance": (2, "double")},
    "gz.msgs.DVLTrackingTarget": {"type": (1, "int32"), "range": (2, "gz.msgs.DVLRangeEstimate")},
    "gz.msgs.DVLBeamState": {"id": (1, "int32"), "range": (3, "gz.msgs.DVLRangeEstimate"), "rssi": (4, "double"), "nsd": (5, "double"), "locked": (6, "bool")},
    "gz.msgs.DVLVelocityTracking": {
        "header": (1, "gz.msgs.Header"), "type": (2, "int32"), "target": (3, "gz.msgs.DVLTrackingTarget"),
        "beams": (5, "repeated gz.msgs.DVLBeamState"), "status": (6, "int32"),
    },
    "blueye.protocol.DvlTransducer": {
        "id": (1, "sint32"), "velocity": (2, "float"), "distance": (3, "float"), "beam_valid": (4, "bool"), "rssi": (5, "float"), "nsd": (6, "float"),
    },
    "blueye.protocol.DvlVelocity": {
        "sensor_id": (1, "uint32"), "fom": (4, "float"), "is_water_tracking": (6, "bool"),
        "transducers": (7, "repeated blueye.protocol.DvlTransducer"),
    },
    "blueye.protocol.DvlVelocityTel": {"dvl_velocity": (1, "blueye.protocol.DvlVelocity")},
    "blueye.protocol.Altitude": {"value": (1, "float"), "is_valid": (2, "bool")},
    "blueye.protocol.AltitudeTel": {"altitude": (1, "blueye.protocol.Altitude")},
}


def logs(m):
    """`m` is make.py."""
    m.DEFINITIONS.update(DEFINITIONS)

    def directions(instrument, extra=0):
        return m.x_layout(*instrument) + [[0.0, 0.0, 1.0]] * extra

    def slant(values, instrument):
        return [None if v is None else v / math.cos(math.radians(instrument[0])) for v in values]

    def pings(instrument, *ranges, vertical=False, extra=0):
        made = [None if r is None else slant(r, instrument) if vertical else list(r) for r in ranges]
        return [None if r is None else m.ping(i, r, directions(instrument, extra)) for i, r in enumerate(made)]

    def ros2(file, topic, name, messages, readings, note=None, rig=None, kind="dvl", stamped="header"):
        frame = "dvl_link"
        heads = {"header": lambda i: {"header": m.header(i, frame)}, None: lambda i: {},
                 "system": lambda i: {"system_timestamp": m.header(i, "")["stamp"]}}[stamped]
        package, short = name.split("/")
        m.write_log(file, topic, f"{package}/msg/{short}", [heads(i) | message for i, message in enumerate(messages)], kind,
                    frame if stamped == "header" else "", readings, note)
        if rig:
            m.EXPECTED[f"{file}.mcap"]["rig"] = rig

    def ros1(file, topic, name, messages, readings, note=None, kind="dvl"):
        messages = [{"header": other.header1(m, i, "dvl_link")} | message for i, message in enumerate(messages)]
        other.write_ros1(m, file, topic, name, messages, kind, "dvl_link", readings, note, definitions=ROS1)

    still = {"velocity": m.vector([0.4, 0.02, 0.01])}
    a50, janus = {"beams": "waterlinked-a50"}, A50[0]
    good, more = [1.9375, 2.0, 2.0625, 2.03125], [1.875, 1.9375, 2.0, 1.96875]

    # ---- lists of beams
    def posed(i, ranges, covariances, scale=1.0):
        beams = []
        for azimuth, r, covariance in zip(A50[1], ranges, covariances):
            q = [scale * v for v in m.rotation(0.0, janus - 90.0, azimuth)]
            pose = {"header": m.header(i, "dvl_link"), "pose": {"position": m.vector([0.0] * 3), "orientation": m.quaternion(q)}}
            beams.append({"range": r, "range_covariance": covariance, "velocity": 0.1, "velocity_covariance": 1e-4, "pose": pose})
        return still | {"velocity_covariance": [0.0] * 9, "altitude": 1.9, "beams": beams}

    ros2("dvl_uuv_simulator", "/dvl", "uuv_sensor_ros_plugins_msgs/DVL",
         [posed(0, good, [1e-4] * 4), posed(1, [1.875, -1.0, 81.0, 1.96875], [1e-4] * 4, 2.0), posed(2, more, [1e-4, -1.0, -1.0, 1e-4])],
         pings(A50, good, [1.875, None, None, 1.96875], [1.875, None, None, 1.96875]),
         "beams along the poses' x axes; -1 and the simulator's limit 81 m; quaternions of length 2; covariance -1")
    vertical = [1.8125, 1.875, 1.9375, 1.84375]
    ros2("dvl_navquest_vertical", "/dvl", "uuv_sensor_ros_plugins_msgs/DVL", [posed(0, vertical, [1e-4] * 4)],
         pings(A50, vertical, vertical=True), "the same type from a driver that writes vertical ranges: the rig file says so", rig={"ranges": "vertical"})
    empty = still | {"velocity_covariance": [0.0] * 9, "beams": []}
    ros2("dvl_stonefish_no_beams", "/dvl", "uuv_sensor_ros_plugins_msgs/DVL", [empty | {"altitude": a} for a in (1.8125, -1.0)],
         [1.8125, None], "no beams: the altitude; -1 when lost", kind="altitude")
    ros2("dvl_dave", "/dvl", "dave_interfaces/DVL",
         [{"type": "piston", "target": 0.0, "beams": [{"id": n, "reference": "bottom", "range": r, "locked": locked} for n, r, locked in
                                                      zip((1, 3, 2, 4), (1.9375, 2.0625, 2.0, 2.03125), (True, True, True, False))]}],
         pings(A50, [1.9375, 2.0, 2.0625, None]), "ids from 1 and out of order; one not locked", rig=a50)
    beam = {"frame_id": "beam", "range_covariance": 0.0, "velocity": 0.1, "field_of_view": 0.07}
    ros2("dvl_marine_conventions", "/dvl", "marine_conventions/DVL",
         [still | {"velocity_reference": reference, "range": 1.85, "beams": [beam | {"range": r} for r in good]} for reference in (2, 1)],
         pings(A50, good, None), "velocity_reference 2 is bottom, 1 is water", rig=a50)
    cone = {"radiation_type": 0, "field_of_view": 0.07, "min_range": 0.05, "max_range": 50.0, "variance": 0.0}
    ros2("dvl_beam_list", "/dvl/ranges", "coug_interfaces/DvlBeamList",
         [{"beams": [cone | {"header": m.header(0, f"beam_{n}"), "range": r} for n, r in enumerate([1.9375, math.inf, 2.0625, 2.03125])]}],
         pings(A50, [1.9375, None, 2.0625, 2.03125]), "one sensor_msgs/Range per beam; +Inf is lost", rig=a50)
    transducer = {"velocity": 0.1, "rssi": -30.0, "nsd": -90.0}
    stamp = other.header1(m, 0, "")["stamp"]
    ros1("ros1_dvl_transducers", "/dvl/report", "uri/TransducerReportStamped",
         [{"report": {"vx": 0.4, "altitude": 1.85, "velocity_valid": True, "status": 0, "time_of_validity": stamp, "transducers":
                      [transducer | {"id": n, "distance": r, "beam_valid": n != 2} for n, r in enumerate(good)]}}],
         pings(A50, [1.9375, 2.0, None, 2.03125]), "report.transducers; beam_valid is false where the distance looks good")

    def tracking(i, target, locked):
        sec, nsec = divmod(m.stamp_ns(i), 1_000_000_000)
        return {"header": {"stamp": {"sec": sec, "nsec": nsec}, "data": [{"key": "frame_id", "value": ["dvl_link"]}]}, "type": 1,
                "target": {"type": target, "range": {"mean": 1.85}},
                "beams": [{"id": n + 1, "range": {"mean": r, "variance": 0.01}, "locked": k} for n, (r, k) in enumerate(zip(good, locked))]}

    other.write_proto(m, "gz_dvl", "/dvl/velocity", "gz.msgs.DVLVelocityTracking",
                      [tracking(0, 1, [True] * 4), tracking(1, 1, [True, False, True, True]), tracking(2, 2, [True] * 4)], "dvl", "dvl_link",
                      pings(A50, good, [1.9375, None, 2.0625, 2.03125], None), "ids from 1; not locked; target 2 is water", definitions=PROTO)
    m.EXPECTED["gz_dvl.mcap"]["rig"] = a50

    def velocity(ranges, water=False):
        return {"dvl_velocity": {"sensor_id": 1, "fom": 0.002, "is_water_tracking": water, "transducers": [
            {"id": n, "distance": r, "beam_valid": r > 0} for n, r in enumerate(ranges)]}}

    other.write_proto(m, "blueye_dvl", "/blueye/dvl", "blueye.protocol.DvlVelocityTel",
                      [velocity([1.9375, 2.0, 2.0625]), velocity([1.875, 0.0, 2.0]), velocity([5.0, 5.0, 5.0], water=True)], "dvl", None,
                      pings(NUCLEUS, [1.9375, 2.0, 2.0625], [1.875, None, 2.0], None), "three beams are a Nucleus'; no stamp", definitions=PROTO)
    report = {"type": "velocity", "time": 106.3, "vx": 0.4, "fom": 0.002, "altitude": 1.85, "velocity_valid": True, "format": "json_v3.1"}
    beams = [{"id": n, "velocity": 0.1, "distance": r, "rssi": -30.0, "nsd": -90.0, "beam_valid": r > 0} for n, r in enumerate([1.9375, -1.0, 2.0625, 2.03125])]
    other.write_json(m, "json_waterlinked_stream", "/a50", "velocity", None,
                     [report | {"transducers": beams}, report | {"transducers": beams, "type": "velocity_water"},
                      {"type": "position_local", "x": 1.0, "y": 2.0, "z": 0.5}], "dvl", None, pings(A50, [1.9375, None, 2.0625, 2.03125], None, None),
                     "the instrument's own stream: velocity, velocity_water, position_local on one channel")

    # ---- arrays
    whoi = [[x, y, -z] for x, y, z in m.x_layout(*TELEDYNE)]

    def whoi_dvl(i, ranges):
        header = {"io_time": other.header1(m, i, "")["stamp"], "source_uuid": bytes(16)}
        return still | {"ds_header": header, "dvl_time": 0.0, "altitude": math.nan, "num_good_beams": 4, "range": ranges,
                        "beam_unit_vec": [m.vector(v) for v in whoi], "beam_quality": [100.0] * 4, "velocity_mode": 1}

    ros1("ros1_dvl_whoi", "/dvl", "ds_sensor_msgs/Dvl", [whoi_dvl(0, good), whoi_dvl(1, [1.875, 0.0, 0.2, 1.96875])],
         [m.ping(0, good, whoi), m.ping(1, [1.875, None, None, 1.96875], whoi)], "vectors along -z; 0 and below 0.25 m are no echo; altitude NaN")
    lq = {"errcode": "0", "bottomVelocityBeam": [0.1] * 4, "altitude": 1.86, "soundSpeed": 1500.0}
    ros1("ros1_dvl_linkquest", "/dvl_linkquest", "cola2_msgs/LinkquestDvl",
         [lq | {"dataGood": [1, 1, 0, 1], "altitudeBeam": [1.8125, -1.0, 1.9375, 1.84375]}],
         pings(LINKQUEST, [1.8125, None, None, 1.84375], vertical=True), "vertical; camel case; dataGood 0; -1")
    lq = {"errcode": "0", "bottomvelocitybeam": [0.1] * 4, "velocityinst": [0.0] * 3, "velocityinstflag": 1, "altitude": 1.86, "soundspeed": 1500.0}
    ros2("dvl_linkquest", "/dvl_linkquest", "cirs_girona_cala_viuda/LinkquestDvl",
         [lq | {"datagood": [1, 1, 1, 1], "altitudebeam": vertical}], pings(LINKQUEST, vertical, vertical=True), "vertical; lower case")
    ros1("ros1_dvl_nortek_df21", "/dvl/df21", "ds_sensor_msgs/NortekDF21",
         [{"velBeam": [0.1, -32.768, 0.1, 0.1], "distBeam": [1.8125, 1.875, 0.0, 1.84375], "fomBeam": [0.01, 0.01, 0.01, 10.0], "timeDiff1Beam": [0.0] * 4}],
         pings(NORTEK, [1.8125, None, None, None], vertical=True), "vertical; bad: velocity -32.768, distance 0, figure of merit 10")
    ros1("ros1_dvl_nortek_ethernet", "/nortek/bottom_track", "nortek_dvl/ButtomTrack",
         [{"dvl_time": 0.0, "speed": 0.4, "vertical_distance": [1.8125, 1.875, 0.0, 1.84375], "figure_of_merit": 0.01}],
         pings(NORTEK, [1.8125, 1.875, None, 1.84375], vertical=True), "vertical_distance")
    ros1("ros1_dvl_nucleus1000", "/nucleus1000dvl/bottomtrack", "sensors/Nucleus1000_bottomtrack",
         [{"beam_distance": [1.9375, 2.0, 2.0625], "data_valid": valid, "dvl_velocity_xyz": [0.4, 0.0, 0.0]} for valid in (True, False)],
         pings(NUCLEUS, [1.9375, 2.0, 2.0625], [None] * 3), "three beams; data_valid false")
    ros2("dvl_holoocean", "/holoocean/dvl_range", "holoocean_interfaces/DVLSensorRange", [{"range": good}], pings(A50, good),
         "four bare ranges: the rig file names the beams", rig=a50)
    ros2("dvl_rdi_pd0", "/dvl/pd0", "ds_sensor_msgs/RdiPD0",
         [{"range": [1.8125, 1.875, 0.0, 1.84375], "correlation": [100.0] * 4, "percent_good": [100.0] * 4, "config_beamangle": 30.0}],
         pings(TELEDYNE, [1.8125, 1.875, None, 1.84375], vertical=True), "vertical; the head's angle stands in config_beamangle; 0 is lost")
    ros2("dvl_five_beams", "/dvl/profile", "five_beam/Profile", [{"beam_ranges": good + [1.875], "altitude": 1.875}],
         pings(NORTEK, good + [1.875], extra=1), "the fifth beam looks along the axis", rig={"beams": "nortek-25"})

    # ---- one field per beam
    ros2("dvl_nortek333", "/dvl/bottom_track", "nortek_dvl333/BottomTrack",
         [{f"vel_beam{n}": -32.768 if n == 3 else 0.1 for n in range(4)} | {f"dist_beam{n}": v for n, v in enumerate(vertical)}
          | {f"fom_beam{n}": 10.0 if n == 1 else 0.01 for n in range(4)} | {"status": 0}],
         pings(NORTEK, [1.8125, None, 1.9375, None], vertical=True), "dist_beam0 to 3, vertical")
    ros2("dvl_nucleus", "/nucleus/bottom_track", "interfaces/BottomTrack",
         [{"posix_time": 0} | {f"beam_{n}_distance_valid": n != 2 for n in (1, 2, 3)} | {f"distance_beam_{n}": 1.875 + n / 16 for n in (1, 2, 3)}],
         pings(NUCLEUS, [1.9375, None, 2.0625]), "distance_beam_1 to 3 with flags; system_timestamp and no header", stamped="system")
    ros1("ros1_dvl_navquest", "/navquest", "navquest_dvl/Altitudes",
         [{f"Altitude{n}": vertical[n - 1] for n in (1, 2, 3, 4)} | {f"Beam{n}Valid": n != 3 for n in (1, 2, 3, 4)}],
         pings(LINKQUEST, [1.8125, 1.875, None, 1.84375], vertical=True), "Altitude1 to 4, Beam1Valid to 4")
    ros2("dvl_numbered_flags", "/dvl", "osu_dvl/Dvl",
         [{f"b{n}_dist": vertical[n - 1] for n in (1, 2, 3, 4)} | {f"b{n}_dist_valid": n != 4 for n in (1, 2, 3, 4)}],
         pings(NORTEK, [1.8125, 1.875, 1.9375, None], vertical=True), "b1_dist with b1_dist_valid")

    # ---- points
    points = [[r * v for v in d] for r, d in zip(good, directions(A50))]
    ros2("dvl_ranges3d", "/dvl/ranges", "ds_sensor_msgs/Ranges3D",
         [{"soundspeed_correction_type": 0, "ranges": [
             {"range": {"header": m.header(0, "dvl_link"), "point": m.vector(p)}, "range_quality": 1.0, "range_validity": validity}
             for p, validity in zip(points, (3, 2, 1, 3))]}],
         pings(A50, [1.9375, 2.0, None, 2.03125]), "hits as points; validity 1 is low")

    # ---- one message per beam
    def distance(orientation, centimetres, quality):
        return {"header": {"system_id": 255, "component_id": 0, "sequence": 1}, "message": {
            "type": "DISTANCE_SENSOR", "time_boot_ms": 1000, "min_distance": 5, "max_distance": 5000, "current_distance": centimetres,
            "orientation": {"type": f"MAV_SENSOR_ROTATION_{orientation}"}, "covariance": 255, "signal_quality": quality}}

    azimuths = {"YAW_135": 135.0, "YAW_225": -135.0, "YAW_315": -45.0}
    readings = [m.ping(i, [r], m.x_layout(janus, [azimuths[o]])) for i, (o, r) in enumerate([("YAW_135", 1.94), ("YAW_225", None), ("YAW_315", 2.06)])]
    other.write_json(m, "mavlink_distance_per_beam", "/mavlink/DISTANCE_SENSOR", "mavlink", None,
                     [distance("YAW_135", 194, 100), distance("YAW_225", 200, 1), distance("YAW_315", 206, 0)], "dvl", None, readings,
                     "centimetres, one message per beam, its azimuth by the orientation; quality 1 is invalid, 0 unknown")
    other.write_json(m, "mavlink_distance_down", "/mavlink/DISTANCE_SENSOR", "mavlink", None,
                     [distance("PITCH_270", 187, 100), distance("PITCH_270", 5000, 100)], "altitude", None, [1.87, None], "down; max_distance")

    # ---- no beams
    ping1d = {"transmit_duration": 100, "ping_number": 1, "scan_start": 0, "scan_length": 10000}
    ros2("ping1d", "/ping1d", "ping_msgs/Ping1D", [ping1d | {"distance": 1812, "confidence": 95}, ping1d | {"distance": 700, "confidence": 20}],
         [1.812, None], "millimetres; a confidence of 20 % is none", kind="altitude")
    ros2("nucleus_altimeter", "/nucleus/altimeter", "interfaces/Altimeter",
         [{"altimeter_distance_valid": v, "altimeter_distance": 1.8125, "altimeter_quality": 80} for v in (True, False)], [1.8125, None],
         kind="altitude", stamped="system")
    ros2("navsts", "/navigator/navigation", "cola2_msgs/NavSts", [{"latitude_of_origin": 41.8, "depth": 18.5, "altitude": a} for a in (1.8125, -1.0)],
         [1.8125, None], "altitude among other things", kind="altitude")
    ros1("ros1_dvl_altitude_only", "/rti/dvl", "rti_dvl/DVL", [still | {"altitude": a, "time": 0.0} for a in (1.8125, -32665.0)], [1.8125, None],
         "no ranges; -32665 is lost", kind="altitude")
    ros1("ros1_dvl_name_clash", "/dvl", "gso/Dvl", [still | {"quality": m.vector([1.0] * 3), "avg_altitude": 1.8125, "temperature": 8.0}], [1.8125],
         "the other ds_sensor_msgs/Dvl: avg_altitude and no ranges", kind="altitude")
    other.write_proto(m, "blueye_altitude", "/blueye/altitude", "blueye.protocol.AltitudeTel",
                      [{"altitude": {"value": 1.8125, "is_valid": v}} for v in (True, False)], "altitude", None, [1.8125, None], definitions=PROTO)

    # ---- anything else
    ros2("dvl_by_path", "/acme/sounder", "acme_msgs/Sounder",
         [{"cells": [{"depth_mm": d, "ok": ok} for d, ok in ((1812, True), (65535, True), (1937, True), (1843, False))]}],
         pings(NORTEK, [1.812, None, 1.937, None], vertical=True), "a shape that nobody knows: the rig file says where its ranges are",
         rig={"topic": "/acme/sounder", "path": "cells.depth_mm", "valid_path": "cells.ok", "unit_m": 0.001, "bad_values": [65535.0],
              "ranges": "vertical", "beams": "nortek-25"})
