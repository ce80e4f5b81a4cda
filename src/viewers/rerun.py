#!/usr/bin/env python3
"""Opens a corrected dive log in rerun: raw beside corrected images, the seafloor in 3-D, plots and
the beam pattern below.

    python THIS.py [LOG.mcap]              start the viewer
    python THIS.py [LOG.mcap] --save FILE  write only the blueprint (.rbl)
    python THIS.py [LOG.mcap] --url URL    send log and blueprint to a running viewer
                                           (rerun+http://…/proxy)

Needs `pip install rerun-sdk==0.41.0`. Written by `unwater layout --rerun`.
"""

import argparse
import json
import pathlib
import socket
import subprocess
import sys
import time

import rerun as rr
import rerun.blueprint as rrb
import rerun.chunk as ck
import rerun.experimental as ex
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

VIEWS = json.loads('''@VIEWS@''')


def field(log, topic):
    """The struct that rerun makes of a topic's messages; None where rerun plots them by itself."""
    names = set()
    for chunk in ck.McapReader(log, include_topic_regex=[f"^{topic}$"]).stream():
        for f in chunk.to_record_batch().schema:
            names.add((f.metadata or {}).get(b"rerun:component", b"").decode())
    if "Scalars:scalars" in names:
        return None
    return next((n for n in sorted(names) if n.endswith(":message")), None)


def plot(log, topic, title, lines):
    """A view of a topic's numbers; `lines` has the name and the colour of each."""
    names = [n for n, _ in lines]
    colours = [tuple(bytes.fromhex(c[1:])) for _, c in lines]
    series = rr.SeriesLines(names=names, colors=colours, widths=[2.0] * len(lines))
    struct = field(log, topic)
    if struct:
        # A protobuf message: select the field with the numbers.
        series = series.visualizer(mappings=[VisualizerComponentMapping(
            target="Scalars:scalars", source_kind=ComponentSourceKind.SourceComponent,
            source_component=struct, selector=".data[]")])
    legend = rrb.PlotLegend(rrb.Corner2D.RightTop)
    return rrb.TimeSeriesView(
        origin=topic, name=title, overrides={topic: series}, plot_legend=legend)


def scene(camera):
    """Corrected image on the seafloor, strobe, beam and camera, in the seafloor's frame (z up)."""
    overrides = {camera["cloud"]: rr.Points3D.from_fields(radii=rr.Radius.ui_points(4.0))}
    if camera["strobe_beam"]:
        overrides[camera["strobe_beam"]] = rr.Points3D.from_fields(radii=rr.Radius.ui_points(2.5))
    if camera["strobe"]:
        overrides[camera["strobe"]] = rr.TransformAxes3D(0.3)
    shown = [camera[k] for k in ("cloud", "strobe", "strobe_beam", "camera_info") if camera[k]]
    frame = camera["seafloor_frame"]
    return rrb.Spatial3DView(
        origin="/", contents=shown, name="seafloor", overrides=overrides,
        spatial_information=rrb.SpatialInformation(frame) if frame else None,
        eye_controls=rrb.EyeControls3D(
            position=(-2.2, -3.4, 3.0), look_target=(0, 0, 0.9), eye_up=(0, 0, 1)),
    )


def tab(log, camera):
    names = [name for name in ("raw", "corrected") if camera[name]]
    images = [rrb.Spatial2DView(origin=camera[name], name=name) for name in names]
    top = images + ([scene(camera)] if camera["cloud"] else [])
    plots = []
    if camera["attenuation"]:
        plots.append(plot(log, camera["attenuation"], "attenuation [1/m]", camera["bands"]))
    geometry = [plot(log, camera[name], title, [(name, colour)]) for name, title, colour in (
        ("altitude", "camera altitude [m]", "#3e84f7"),
        ("residual", "seafloor residual [m]", "#e5484d")) if camera[name]]
    if geometry:
        plots.append(rrb.Vertical(*geometry))
    rest = []
    if camera["beam_pattern"]:
        rest.append(rrb.Spatial2DView(origin=camera["beam_pattern"], name="beam pattern"))
    if camera["log"]:
        columns = rrb.TextLogColumns(timeline_columns=[], text_log_columns=["loglevel", "body"])
        rest.append(rrb.TextLogView(origin=camera["log"], name="log", columns=columns))
    rows = [rrb.Horizontal(*row) for row in (top, plots + rest) if row]
    return rrb.Vertical(*rows, name=camera["name"], row_shares=[62, 38][: len(rows)])


def blueprint(log):
    tabs = [tab(log, camera) for camera in VIEWS["cameras"]]
    root = tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs)
    time_panel = rrb.TimePanel(state="collapsed")
    return rrb.Blueprint(
        root, time_panel, auto_views=False, auto_layout=False, collapse_panels=True)


def show(log, client):
    """Sends the blueprint first, so that the viewer does not arrange all topics itself."""
    blueprint(log).connect_grpc(pathlib.Path(log).stem, url=client.url)
    time.sleep(0.5)
    client.open(log)


def main():
    raw = argparse.RawDescriptionHelpFormatter
    args = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    args.add_argument("log", nargs="?", default=VIEWS["log"])
    args.add_argument("--save", metavar="FILE")
    args.add_argument("--url")
    args = args.parse_args()
    log = str(pathlib.Path(args.log).resolve())
    if not pathlib.Path(log).is_file():
        sys.exit(f"{log} does not exist; give the log: {sys.argv[0]} LOG.mcap")
    if args.save:
        return blueprint(log).save(pathlib.Path(log).stem, args.save)
    if args.url:
        return show(log, ex.ViewerClient.connect(args.url))
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    address = ["--bind", "127.0.0.1", "--port", str(port)]
    viewer = subprocess.Popen(
        [sys.executable, "-m", "rerun", *address, "--hide-welcome-screen"])
    for _ in range(60):
        try:
            client = ex.ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
            break
        except Exception:  # not ready yet
            if viewer.poll() is not None:
                sys.exit("rerun's viewer did not start")
            time.sleep(0.5)
    else:
        sys.exit("rerun's viewer does not respond")
    show(log, client)
    viewer.wait()


if __name__ == "__main__":
    main()
