#!/usr/bin/env python3
"""Opens a corrected dive log in rerun, laid out: raw beside corrected, the seafloor in 3-D, plots and the beam pattern below.

    python THIS.py [LOG.mcap]              start the viewer
    python THIS.py [LOG.mcap] --save FILE  write the blueprint alone (.rbl)
    python THIS.py [LOG.mcap] --url URL    send log and blueprint to a viewer that runs (rerun+http://…/proxy)

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
    """The name of the struct that rerun makes of a message, where it does not plot it by itself."""
    names = set()
    for chunk in ck.McapReader(log, include_topic_regex=[f"^{topic}$"]).stream():
        for f in chunk.to_record_batch().schema:
            names.add((f.metadata or {}).get(b"rerun:component", b"").decode())
    return None if "Scalars:scalars" in names else next((n for n in sorted(names) if n.endswith(":message")), None)


def plot(log, topic, title, lines):
    """One view of a topic's numbers; `lines` are name and colour of each."""
    names, colours = [n for n, _ in lines], [tuple(bytes.fromhex(c[1:])) for _, c in lines]
    series = rr.SeriesLines(names=names, colors=colours, widths=[2.0] * len(lines))
    struct = field(log, topic)
    if struct:
        # A protobuf message: its numbers are a field, not yet a plot.
        series = series.visualizer(mappings=[VisualizerComponentMapping(
            target="Scalars:scalars", source_kind=ComponentSourceKind.SourceComponent, source_component=struct, selector=".data[]")])
    return rrb.TimeSeriesView(origin=topic, name=title, overrides={topic: series}, plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop))


def scene(camera):
    """The corrected picture on the seafloor, the strobe, its beam and the camera, in the seafloor's frame: z up."""
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
        eye_controls=rrb.EyeControls3D(position=(-2.2, -3.4, 3.0), look_target=(0, 0, 0.9), eye_up=(0, 0, 1)),
    )


def tab(log, camera):
    pictures = [rrb.Spatial2DView(origin=camera[k], name=k) for k in ("raw", "corrected") if camera[k]]
    top = pictures + ([scene(camera)] if camera["cloud"] else [])
    plots = []
    if camera["attenuation"]:
        plots.append(plot(log, camera["attenuation"], "attenuation [1/m]", camera["bands"]))
    heights = [plot(log, camera[k], title, [(name, colour)]) for k, title, name, colour in (
        ("altitude", "camera altitude [m]", "altitude", "#3e84f7"), ("residual", "seafloor residual [m]", "residual", "#e5484d")) if camera[k]]
    if heights:
        plots.append(rrb.Vertical(*heights))
    rest = []
    if camera["beam_pattern"]:
        rest.append(rrb.Spatial2DView(origin=camera["beam_pattern"], name="beam pattern"))
    if camera["log"]:
        rest.append(rrb.TextLogView(origin=camera["log"], name="log", columns=rrb.TextLogColumns(timeline_columns=[], text_log_columns=["loglevel", "body"])))
    rows = [rrb.Horizontal(*row) for row in (top, plots + rest) if row]
    return rrb.Vertical(*rows, name=camera["name"], row_shares=[62, 38][: len(rows)])


def blueprint(log):
    tabs = [tab(log, camera) for camera in VIEWS["cameras"]]
    root = tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs)
    return rrb.Blueprint(root, rrb.TimePanel(state="collapsed"), auto_views=False, auto_layout=False, collapse_panels=True)


def show(log, client):
    """The blueprint first, so that the viewer does not lay out every topic before."""
    blueprint(log).connect_grpc(pathlib.Path(log).stem, url=client.url)
    time.sleep(0.5)
    client.open(log)


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("log", nargs="?", default=VIEWS["log"])
    args.add_argument("--save", metavar="FILE")
    args.add_argument("--url")
    args = args.parse_args()
    log = str(pathlib.Path(args.log).resolve())
    if not pathlib.Path(log).is_file():
        sys.exit(f"{log} is not there; give the log: {sys.argv[0]} LOG.mcap")
    if args.save:
        return blueprint(log).save(pathlib.Path(log).stem, args.save)
    if args.url:
        return show(log, ex.ViewerClient.connect(args.url))
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    viewer = subprocess.Popen([sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"])
    for _ in range(60):
        try:
            client = ex.ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
            break
        except Exception:  # it is not up yet
            if viewer.poll() is not None:
                sys.exit("rerun's viewer did not start")
            time.sleep(0.5)
    else:
        sys.exit("rerun's viewer does not answer")
    show(log, client)
    viewer.wait()


if __name__ == "__main__":
    main()
