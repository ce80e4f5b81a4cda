"""A picture of a log in rerun's own viewer, without a screen, as the script that `unwater layout --rerun` wrote lays it out.

    rerun_screenshot.py LOG.mcap LAYOUT.py OUT.png [SECONDS from the start; the middle where not given]

Draws by software (lavapipe, of Debian's mesa-vulkan-drivers). Fails where a view reports an error.
"""

import contextlib
import importlib.util
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time

import numpy as np
import rerun.chunk as ck
import rerun.experimental as ex

log, script, out, *seconds = sys.argv[1:]
spec = importlib.util.spec_from_file_location("layout", script)
layout = importlib.util.module_from_spec(spec)
spec.loader.exec_module(layout)


def patiently(act, tries=120, wait_s=0.5):
    """What `act` gives, once it does."""
    for left in reversed(range(tries)):
        try:
            value = act()
            if value:
                return value
        except Exception:
            if not left:
                raise
        time.sleep(wait_s)
    sys.exit("the viewer does not answer")


def loaded(client):
    state = client.get_state()
    return state.recordings and not state.loading


os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.mkdtemp(prefix="playback"))
with socket.socket() as s:
    s.bind(("127.0.0.1", 0))
    port = s.getsockname()[1]
# Logs go nowhere: of the sample log the viewer says at length that it draws no mosaics of 16 bits.
command = [sys.executable, "-m", "rerun", "--headless", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen", "--window-size", "1920x1080"]
viewer = subprocess.Popen(command, env={**os.environ, "RUST_LOG": "off"}, start_new_session=True)
try:
    client = patiently(lambda: ex.ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy"))
    patiently(lambda: client.get_state() is not None)
    layout.show(log, client)
    patiently(lambda: loaded(client))
    begin, end = ck.McapReader(log).time_bounds()
    at = begin + int(float(seconds[0]) * 1e9) if seconds else (begin + end) // 2
    client.set_time("message_log_time", timestamp=np.datetime64(at, "ns"), play_state="paused")
    time.sleep(15)  # until its notes about the raw pictures are gone
    pathlib.Path(out).write_bytes(patiently(client.take_screenshot, tries=6, wait_s=2))
    faults = [f"{view.origin}: {r.summary}" for view in client.get_state().views for r in view.reports if r.severity == "error"]
finally:
    # The Python module starts the viewer as its child: both are ended, by their own group.
    with contextlib.suppress(ProcessLookupError):
        os.killpg(viewer.pid, signal.SIGTERM)
    viewer.wait()
sys.exit("\n".join(f"rerun: {f}" for f in faults) or 0)
