"""unwater against a bare transcode and against the same method in NumPy/OpenCV, side by side in one run; prints Markdown.

    pip install -r benches/requirements.txt
    python benches/compare.py [--frames N] [--size WxH] [--kind jpeg|jpeg420] [--threads N] [--rounds R] [--numpy-frames N] [--large-frames N]
                              [--unwater PATH] [--long-log PATH] [--keep DIR] [--json FILE]

Builds the release binaries unless both are given, makes the logs, and lets the parties run in turn, round by round. CPU seconds are user
and system time of the process, memory is its peak resident size, both as the kernel tells when it ends; the table has medians over the rounds.
docs/benchmarks.md says what the rows mean.
"""
import argparse
import datetime
import json
import os
import platform
import re
import resource
import shlex
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
QUALITY = 92
TRUE_ATTENUATION_PER_M = (0.45, 0.14, 0.10)  # of the dive that long_log renders
MOST_OFF = 0.10  # from which on an attenuation says that the method is another
LARGE_SIZE = (4000, 3000)


# --- The bare transcode, in a process of its own ---


def pictures(log, topic_end):
    """The JPEGs of a log on the first topic that ends so."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with open(log, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topic = next(c.topic for c in reader.get_summary().channels.values() if c.topic.endswith(topic_end))
        for *_, said in reader.iter_decoded_messages(topics=[topic]):
            yield bytes(said.data)


def transcode(log, threads, sampling):
    """Every JPEG decoded and encoded again by libjpeg-turbo; the clock starts when all lie in memory. Prints wall and CPU seconds."""
    import simplejpeg

    def work(jpeg):
        return len(simplejpeg.encode_jpeg(simplejpeg.decode_jpeg(jpeg, "RGB"), QUALITY, "RGB", sampling))

    jpegs = list(pictures(log, "image_raw/compressed"))
    work(jpegs[0])
    used, began = cpu_s(resource.getrusage(resource.RUSAGE_SELF)), time.perf_counter()
    with ThreadPoolExecutor(threads) as pool:
        written = sum(pool.map(work, jpegs))
    wall = time.perf_counter() - began
    print(json.dumps({"wall_s": wall, "cpu_s": cpu_s(resource.getrusage(resource.RUSAGE_SELF)) - used, "bytes": written}))


def cpu_s(usage):
    return usage.ru_utime + usage.ru_stime


# --- Parties ---


class Party:
    """One command, run once a round. `output` is removed after each run."""

    def __init__(self, name, frames, pixels, command, output=None, reports_itself=False):
        self.name, self.command, self.output, self.reports_itself = name, [str(w) for w in command], output, reports_itself
        self.megapixels = frames * pixels / 1e6
        self.frames, self.runs, self.said = frames, [], ""

    def run(self):
        os.sync()  # what others wrote is not on this one's clock
        with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as complaints:
            began = time.perf_counter()
            process = subprocess.Popen(self.command, stdout=said, stderr=complaints, env=dict(os.environ, OPENBLAS_NUM_THREADS="1"))
            _, status, usage = os.wait4(process.pid, 0)
            wall = time.perf_counter() - began
            process.returncode = os.waitstatus_to_exitcode(status)
            for file in (said, complaints):
                file.seek(0)
            self.said = said.read().decode()
            if process.returncode not in (0, 3):
                sys.exit(f"{shlex.join(self.command)} ended with {process.returncode}:\n{complaints.read().decode()[-2000:]}")
        run = {"wall_s": wall, "cpu_s": cpu_s(usage), "peak_mb": usage.ru_maxrss * 1024 / 1e6}
        if self.reports_itself:
            run = dict(json.loads(self.said), peak_mb=None)
        self.runs.append(run)
        if self.output:
            Path(self.output).unlink(missing_ok=True)

    def median(self, key):
        values = [r[key] for r in self.runs if r[key] is not None]
        return statistics.median(values) if values else float("nan")

    def attenuation(self):
        """What it printed, without standard deviations; `None` where it estimates none."""
        line = re.search(r"^attenuation (.*) per metre", self.said, re.MULTILINE)
        return [float(band.split("±")[0]) for band in line[1].split("/")] if line else None


class Bench:
    """Logs and parties of one run."""

    def __init__(self, options, folder):
        self.options, self.folder, self.parties, self.made = options, folder, {}, {}
        self.width, self.height = (int(n) for n in options.size.lower().split("x"))

    def log(self, name, frames, size=None, kind=None, distinct=24):
        kind = kind or self.options.kind
        width, height = size or (self.width, self.height)
        path = self.folder / f"{name}-{kind}-{frames}x{width}x{height}.mcap"
        if not path.exists():
            note(f"making {path.name}")
            subprocess.run([str(w) for w in (self.options.long_log, path, frames, width, height, kind, distinct)], check=True)
        self.made[name] = path, frames, width * height
        return path

    def model(self, name):
        """A model for pass two alone, estimated off the clock."""
        log = self.made[name][0]
        path = log.with_suffix(".model.json")
        subprocess.run([str(w) for w in (self.options.unwater, "estimate", log, "-o", path, "--force", "-q")], check=True, stdout=subprocess.DEVNULL)
        return path

    def unwater(self, name, log, *words, threads=None):
        path, frames, pixels = self.made[log]
        output = self.folder / f"{len(self.parties)}.mcap"
        command = [self.options.unwater, "correct", path, "-o", output, "--force", "-j", threads or self.options.threads, *words]
        self.parties[name] = Party(name, frames, pixels, command, output)

    def python(self, name, log, script, *words, output=None, reports_itself=False):
        _, frames, pixels = self.made[log]
        self.parties[name] = Party(name, frames, pixels, [sys.executable, HERE / script, *words], output, reports_itself)

    def run(self):
        """All rounds. What others took of the machine meanwhile stays in `others_share`."""
        before, began = busy_s(), time.perf_counter()
        own = cpu_s(resource.getrusage(resource.RUSAGE_CHILDREN))
        for round_ in range(self.options.rounds):
            for party in self.parties.values():
                note(f"round {round_ + 1}: {party.name}")
                party.run()
        own = cpu_s(resource.getrusage(resource.RUSAGE_CHILDREN)) - own
        self.others_share = (busy_s() - before - own) / (time.perf_counter() - began) / os.cpu_count()

    def over(self, a, b, key):
        return self.parties[a].median(key) / self.parties[b].median(key)


def busy_s():
    """CPU seconds that all processes of the machine used so far."""
    user, nice, system = (int(n) for n in open("/proc/stat").readline().split()[1:4])
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def note(text):
    print(text, file=sys.stderr, flush=True)


# --- What is compared ---


def set_up(bench):
    """Makes the logs and the parties. The names are those of the table."""
    import simplejpeg

    options, threads = bench.options, bench.options.threads
    few = max(options.frames // 4, 24)
    log = bench.log("jpeg", options.frames)
    bench.log("jpeg-long", 4 * options.frames)
    bench.log("bayer16", few, kind="bayer16")
    bench.log("jpeg-few", few)
    small = bench.log("numpy", options.numpy_frames or 24)
    model, bayer_model = bench.model("jpeg"), bench.model("bayer16")
    quality = ("--jpeg-quality", QUALITY)

    first = bench.folder / "sampling.mcap"
    correct_one = (options.unwater, "correct", small, "-o", first, "--model", model, "--force", "-q")
    subprocess.run([str(w) for w in correct_one], check=True, stdout=subprocess.DEVNULL)
    bench.sampling = simplejpeg.decode_jpeg_header(next(pictures(first, "image_corrected/compressed")))[3]
    first.unlink()

    bench.python("transcode", "jpeg", "compare.py", "--transcode", log, threads, bench.sampling, reports_itself=True)
    bench.python("transcode, 1 thread", "jpeg", "compare.py", "--transcode", log, 1, bench.sampling, reports_itself=True)
    bench.unwater("pass two", "jpeg", "--model", model, *quality)
    bench.unwater("both passes", "jpeg", *quality)
    bench.unwater("both passes, 1 thread", "jpeg", *quality, threads=1)
    bench.unwater("both passes, 4 × the frames", "jpeg-long", *quality)
    bench.unwater("bayer16 to JPEG, pass two", "bayer16", "--model", bayer_model, *quality)
    bench.unwater("bayer16 to JPEG, pass two, --drop-raw", "bayer16", "--model", bayer_model, "--drop-raw", *quality)
    bench.unwater("JPEG to PNG, pass two", "jpeg-few", "--model", model, "--image-format", "png")
    bench.unwater("JPEG to raw, pass two", "jpeg-few", "--model", model, "--image-format", "raw")
    if options.numpy_frames:
        output = bench.folder / "numpy.out.mcap"
        bench.python("NumPy/OpenCV", "numpy", "numpy_method.py", small, output, "--threads", threads, "--quality", QUALITY, output=output)
        bench.unwater("both passes, NumPy's log", "numpy", *quality)
        bench.unwater("pass two, NumPy's log", "numpy", "--model", model, *quality)
    if options.large_frames:
        bench.log("large", options.large_frames, LARGE_SIZE, distinct=12)
        bench.unwater("12 megapixels, both passes, 2 threads", "large", *quality, threads=2)


def ratios(bench):
    """Rows of quantity, value by wall clock, value by CPU time, must, aim."""
    p, o = bench.parties, bench.options

    def times(a, b):
        return [f"{bench.over(a, b, key):.2f} ×" for key in ("wall_s", "cpu_s")]

    def per_core(name):
        return ["", f"{p[name].megapixels / p[name].median('cpu_s'):.0f} Mpx/s"]

    rows = [
        (f"pass two, JPEG to JPEG, over the bare transcode, {o.threads} threads", *times("pass two", "transcode"), "≤ 2.0 ×", "≤ 1.3 ×"),
        (f"both passes, {o.frames} frames, over the bare transcode", *times("both passes", "transcode"), "≤ 4 × (1 000 frames)", "≤ 2.5 ×"),
        (f"both passes, {4 * o.frames} frames over {o.frames}", *times("both passes, 4 × the frames", "both passes"), "≤ 4.2 × (4 000 over 1 000)", "≤ 3.7 ×"),
        (f"speed-up of both passes from 1 to {o.threads} threads", times("both passes, 1 thread", "both passes")[0], "", "≥ 1.7 (2 threads)", "≥ 1.9"),
        (f"speed-up of the bare transcode from 1 to {o.threads} threads", times("transcode, 1 thread", "transcode")[0], "", "", ""),
        ("bayer16 to 8-bit JPEG, pass two, per core", *per_core("bayer16 to JPEG, pass two"), "25 Mpx/s", "60 Mpx/s"),
        ("the same, `--drop-raw`", *per_core("bayer16 to JPEG, pass two, --drop-raw"), "25 Mpx/s", "60 Mpx/s"),
        ("JPEG to PNG, pass two, per core", *per_core("JPEG to PNG, pass two"), "", ""),
        ("JPEG to raw, pass two, per core", *per_core("JPEG to raw, pass two"), "", ""),
        ("peak memory, 4 × the frames over once", f"{bench.over('both passes, 4 × the frames', 'both passes', 'peak_mb'):.2f} ×", "", "≤ 1.05 × (10 GB over 1 GB)", ""),
    ]
    if "NumPy/OpenCV" in p:
        rows.append((f"NumPy/OpenCV, {o.numpy_frames} frames, end to end, over both passes", *times("NumPy/OpenCV", "both passes, NumPy's log"), "≥ 10 ×", "≥ 25 ×"))
        share = [float(n) for n in re.search(r"pass two\s+([\d.]+) s wall, ([\d.]+) s CPU", p["NumPy/OpenCV"].said).groups()]
        ours = [p["pass two, NumPy's log"].median(k) for k in ("wall_s", "cpu_s")]
        rows.append(("its pass two alone, over ours", *(f"{a / b:.2f} ×" for a, b in zip(share, ours)), "", ""))
    if o.large_frames:
        rows.append(("peak memory, 12-megapixel frames, 2 threads", f"{p['12 megapixels, both passes, 2 threads'].median('peak_mb'):.0f} MB", "", "512 MB", "300 MB"))
    return rows


def table(head, rows):
    return "\n".join("| " + " | ".join(str(c) for c in row) + " |" for row in [head, ["---"] * len(head), *rows])


def said_of(command):
    done = subprocess.run(command, capture_output=True, text=True, cwd=HERE)
    return done.stdout.strip() if done.returncode == 0 else "?"


def machine():
    model = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), platform.machine())
    return f"{os.cpu_count()} cores, {model}"


def report(bench):
    commit = said_of(["git", "log", "-1", "--format=`%h %s`"]) + (" (with changes)" if said_of(["git", "status", "--porcelain", "-uno"]) else "")
    command = "python benches/compare.py " + " ".join(re.sub(r"^/.*/", "…/", w) for w in sys.argv[1:])
    if bench.options.given:
        day = datetime.datetime.fromtimestamp(bench.options.unwater.stat().st_mtime)
        commit += f"; the program was given, built {day:%Y-%m-%d %H:%M}, and may be of another commit"
    rounds = bench.options.rounds
    lines = [
        f"### {datetime.date.today()}\n",
        f"Commit {commit}.",
        f"{machine()}; other processes took {100 * bench.others_share:.0f} % of it meanwhile"
        + (" (**too much for wall clocks to mean anything**)." if bench.others_share > 0.05 else "."),
        f"`{command.strip()}`; JPEGs of {bench.width}×{bench.height} at quality {QUALITY}, {':'.join(bench.sampling)} in and out;",
        f"medians of {rounds} rounds.\n" if rounds > 1 else "one round.\n",
        table(("quantity", "by wall clock", "by CPU time", "must", "aim"), ratios(bench)),
        "",
        table(
            ("party", "frames", "wall s", "CPU s", "Mpx per CPU s", "peak MB", "attenuation 1/m"),
            [
                (p.name, p.frames, f"{p.median('wall_s'):.2f}", f"{p.median('cpu_s'):.2f}", f"{p.megapixels / p.median('cpu_s'):.1f}",
                 "" if p.reports_itself else f"{p.median('peak_mb'):.0f}", " / ".join(f"{a:.3f}" for a in p.attenuation() or []))
                for p in bench.parties.values()
            ],
        ),
    ]
    return "\n".join(lines)


def check_room(options, pixels, folder):
    """Ends with a sentence where the disk is too small: logs, and the longest with its output."""
    needed = pixels * options.frames * (0.5 + 4 * 1.1 + 2 * 0.25) / 1e9 + 1
    free = shutil.disk_usage(folder).free / 1e9
    if free < needed:
        sys.exit(f"about {needed:.0f} GB are needed in {folder} and {free:.0f} are free: lower --frames, or name a larger disk by --keep")


def off(party):
    """How far an attenuation is off, as a share of the truth, at worst."""
    return max(abs(a / t - 1) for a, t in zip(party.attenuation() or [9.0], TRUE_ATTENUATION_PER_M))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--size", default="1344x1008")
    parser.add_argument("--kind", choices=["jpeg", "jpeg420"], default="jpeg", help="chroma of the JPEGs: 4:4:4 or 4:2:0")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--numpy-frames", type=int, default=24, help="0 leaves it out")
    parser.add_argument("--large-frames", type=int, default=24, help="frames of 12 megapixels, for peak memory; 0 leaves them out")
    parser.add_argument("--unwater", type=Path), parser.add_argument("--long-log", type=Path)
    parser.add_argument("--keep", type=Path, help="where logs lie and stay; else a folder that is removed")
    parser.add_argument("--json", type=Path, help="all runs of all parties")
    options = parser.parse_args()
    options.given = bool(options.unwater)
    if not (options.unwater and options.long_log):
        subprocess.run(["cargo", "build", "--release", "--bins", "--example", "long_log"], cwd=HERE.parent, check=True)
        target = Path(json.loads(said_of(["cargo", "metadata", "--no-deps", "--format-version", "1"]))["target_directory"]) / "release"
        options.unwater, options.long_log = options.unwater or target / "unwater", options.long_log or target / "examples" / "long_log"
    folder = options.keep or Path(tempfile.mkdtemp(prefix="unwater-compare-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        bench = Bench(options, folder)
        check_room(options, bench.width * bench.height, folder)
        set_up(bench)
        bench.run()
        print(report(bench))
        if options.json:
            options.json.write_text(json.dumps({p.name: {"frames": p.frames, "runs": p.runs} for p in bench.parties.values()}, indent=1))
        for name, party in bench.parties.items():
            if party.attenuation() and off(party) > MOST_OFF:
                sys.exit(f"{name}: attenuation {party.attenuation()} is far from the truth {TRUE_ATTENUATION_PER_M}: not the same method")
    finally:
        if not options.keep:
            shutil.rmtree(folder)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--transcode"]:
        transcode(sys.argv[2], int(sys.argv[3]), sys.argv[4])
    else:
        main()
