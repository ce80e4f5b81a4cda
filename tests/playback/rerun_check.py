"""What rerun makes of a log, by the importer that its viewer runs.

    rerun_check.py LOG.mcap [--layout SCRIPT.py] TOPIC=KIND...

KIND is `image` (every message a picture that decodes), `plot` (numbers that are plotted by themselves), `numbers:.path`
(numbers that a plot can be told to take), `3d` (points or poses), `colours` (points with a colour each), `text`. With a layout,
its blueprint is built, and every topic it names must be there. Prints one line per topic, fails where one is not what it should be.
"""

import importlib.util
import io
import logging
import math
import sys
import tempfile

import pyarrow as pa
import rerun.chunk as ck
from PIL import Image

SCENE = {"Points3D:positions", "InstancePoses3D:translations", "Transform3D:translation"}
MEDIA = {"JPEG": "image/jpeg", "PNG": "image/png"}


def leaves(kind, path=""):
    """Paths of a struct's numbers."""
    if pa.types.is_struct(kind):
        for f in kind:
            yield from leaves(f.type, f"{path}.{f.name}")
    elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        yield from leaves(kind.value_type, path + "[]")
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
        yield path


def read(log):
    """topic -> rows of each component, paths of numbers, and what is wrong."""
    topics = {}
    for chunk in ck.McapReader(log).stream():
        topic = topics.setdefault(str(chunk.entity_path), {"rows": {}, "numbers": set(), "wrong": set()})
        batch = chunk.to_record_batch()
        columns = {(f.metadata or {}).get(b"rerun:component", b"").decode(): (f, batch.column(i)) for i, f in enumerate(batch.schema)}
        for name, (field, column) in columns.items():
            name = name.removeprefix("rerun.archetypes.").removeprefix("rerun.components.")
            if not name or name.startswith(("McapChannel", "McapSchema")):
                continue
            values = [v.as_py() for v in column if v.is_valid]
            topic["rows"][name] = topic["rows"].get(name, 0) + sum(v not in ([], None) for v in values)
            if name.endswith("EncodedImage:blob"):
                said = [v.as_py() for v in columns["EncodedImage:media_type"][1]] if "EncodedImage:media_type" in columns else [None] * len(values)
                for blob, media in zip(values, said):
                    try:
                        picture = Image.open(io.BytesIO(bytes(blob[0])))
                        picture.load()
                        if media and media[0] not in (None, MEDIA.get(picture.format)):
                            topic["wrong"].add(f"a {picture.format} that calls itself {media[0]}: the view stays blank")
                    except Exception as error:
                        topic["wrong"].add(f"a picture that does not decode: {error}")
            elif name == "Scalars:scalars":
                if not all(v and all(math.isfinite(x) for x in v) for v in values):
                    topic["wrong"].add("a number that is not finite")
            elif name == "Points3D:colors" or name == "Points3D:positions":
                topic.setdefault(name, []).extend(len(v) for v in values)
            elif name.endswith(":message"):
                topic["numbers"] |= set(leaves(field.type.value_type))
    return topics


def fault(topics, topic, kind):
    """Why a topic is not of that kind; `None` where it is."""
    if topic not in topics:
        return "is not there"
    t = topics[topic]
    rows = lambda *names: sum(t["rows"].get(n, 0) for n in names)
    kind, _, path = kind.partition(":")
    is_so = {
        "image": lambda: rows("EncodedImage:blob", "Image:buffer"),
        "plot": lambda: rows("Scalars:scalars"),
        "numbers": lambda: path in t["numbers"],
        "3d": lambda: rows(*SCENE),
        "colours": lambda: t.get("Points3D:colors") and t["Points3D:colors"] == t.get("Points3D:positions"),
        "text": lambda: rows("TextLog:text"),
    }[kind]()
    if not is_so:
        return f"is no {kind}{path and ' at ' + path}; it has {', '.join(sorted(t['rows']))} and the numbers {' '.join(sorted(t['numbers']))}"
    return "; ".join(sorted(t["wrong"])) or None


def layout_faults(topics, log, script):
    spec = importlib.util.spec_from_file_location("layout", script)
    layout = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(layout)
    with tempfile.NamedTemporaryFile(suffix=".rbl") as file:
        layout.blueprint(log).save("check", file.name)
        if len(file.read()) < 1000:
            yield "the blueprint is empty"
    plot = lambda topic: "plot" if topic in topics and "Scalars:scalars" in topics[topic]["rows"] else "numbers:.data[]"
    kinds = {"raw": "image", "corrected": "image", "beam_pattern": "image", "cloud": "colours", "strobe": "3d", "strobe_beam": "3d", "log": "text"}
    for camera in layout.VIEWS["cameras"]:
        for key in ("raw", "corrected", "beam_pattern", "cloud", "strobe", "strobe_beam", "attenuation", "altitude", "residual", "log"):
            why = "is not named" if not camera[key] else fault(topics, camera[key], kinds.get(key) or plot(camera[key]))
            if why:
                yield f"layout, {camera['name']}, {key}: {camera[key]} {why}"


def main():
    logging.disable(logging.WARNING)
    log, *rest = sys.argv[1:]
    topics = read(log)
    for name in sorted(topics):
        print(name, {k: n for k, n in topics[name]["rows"].items() if n}, *sorted(topics[name]["wrong"]))
    faults = []
    if rest and rest[0] == "--layout":
        faults += layout_faults(topics, log, rest[1])
        rest = rest[2:]
    for wanted in rest:
        topic, _, kind = wanted.partition("=")
        why = fault(topics, topic, kind)
        faults += [f"{topic} {why}"] if why else []
    sys.exit("\n".join(f"rerun: {f}" for f in faults) or 0)


main()
