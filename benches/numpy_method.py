"""The method of docs/method.md as one writes it with NumPy, SciPy and OpenCV: what compare.py measures unwater against.

    python benches/numpy_method.py IN.mcap OUT.mcap [--threads N] [--quality Q]

For logs as examples/long_log.rs makes them: JPEG frames, a DVL with beam vectors, an IMU, mounts in /tf_static. No relief, backscatter,
drift, search for the strobe or error bars, which unwater does or tries as well. Frames are worked on by a pool of threads (what costs
here runs outside of Python's lock). Space is the body's; lengths are metres, angles radians, light is a share of full scale.
"""
import argparse
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import cv2
import numpy as np
import scipy.sparse as sp
import simplejpeg
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2._dynamic import serialize_dynamic
from mcap_ros2.decoder import DecoderFactory
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation, Slerp

DETECTION_SIDE_PX, KEYPOINTS, RATIO, NEIGHBOURS, RANSAC_PX, LEAST_INLIERS = 800, 600, 0.8, 4, 2.0, 12
FOOTPRINT_PX = 2.5  # of the reduced picture, in the farther of two views
BLURS_PX = FOOTPRINT_PX * np.array([1.0, 1.4, 2.0, 2.8])
DARK, CLIPPED = 0.002, 0.96
GRID, REACH = 41, np.radians(70.0)
SMOOTHNESS, REWEIGHTINGS = 1.5, 6
PING_WINDOW_S = 0.7
HIGHLIGHT_QUANTILE, HIGHLIGHT_LEVEL, SHOULDER_FROM = 0.995, 0.75, 0.75

codes = np.arange(256) / 255
LIGHT_OF_CODE = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4).astype(np.float32)
shown = np.arange(1 << 16) / (1 << 14)  # light up to 4
shown = np.where(shown > SHOULDER_FROM, 1 - (1 - SHOULDER_FROM) * np.exp(-(shown - SHOULDER_FROM) / (1 - SHOULDER_FROM)), shown)
CODE_OF_LIGHT = np.uint8(255 * np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055) + 0.5)


def messages(path, topics=None):
    """Schema, channel, raw message and decoded message, in the order of log time."""
    with open(path, "rb") as file:
        yield from make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=topics)


def in_order(pool, work, items, ahead):
    """Results of `work` in the order of the items; no more than `ahead` of them under way."""
    waiting = deque()
    for item in items:
        waiting.append(pool.submit(work, *item))
        if len(waiting) >= ahead:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def seconds(header):
    return header.stamp.sec + header.stamp.nanosec * 1e-9


def read_facts(path):
    """Mounts, camera, pings, attitude, and the topic of the pictures."""
    with open(path, "rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    facts = SimpleNamespace(picture_topic=next(c.topic for c in channels if c.topic.endswith("/compressed")))
    mounts, pings, attitude = {}, [], []
    for schema, channel, _, said in messages(path, [c.topic for c in channels if c.topic != facts.picture_topic]):
        if channel.topic == "/tf_static":
            for t in said.transforms:
                q, p = t.transform.rotation, t.transform.translation
                mounts[t.child_frame_id] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), np.array([p.x, p.y, p.z])
        elif schema.name.endswith("CameraInfo"):
            facts.k, facts.size, facts.camera_frame = [float(k) for k in said.k], (said.width, said.height), said.header.frame_id
        elif schema.name.endswith("Dvl"):
            beams = np.array([[b.x, b.y, b.z] for b in said.beam_unit_vec]) * np.array(said.range)[:, None]
            pings.append((seconds(said.header), beams[np.array(said.range) > 0]))
            dvl_frame = said.header.frame_id
        elif schema.name.endswith("Imu"):
            o = said.orientation
            attitude.append((seconds(said.header), [o.x, o.y, o.z, o.w]))
    facts.camera, facts.strobe = mounts[facts.camera_frame], next(m for name, m in mounts.items() if "strobe" in name)
    turn, at = mounts[dvl_frame]
    facts.ping_times = np.array([t for t, _ in pings])
    facts.hits = [hits @ turn.T + at for _, hits in pings]
    times = np.array([t for t, _ in attitude])
    slerp = Slerp(times, Rotation.from_quat([q for _, q in attitude]))
    facts.world_from_body = lambda t: slerp(np.clip(t, times[0], times[-1])).as_matrix()
    return facts


def plane_under(facts, stamp):
    """n·x = d with n pointing into the floor: least squares through the hits around the frame, turned by the attitude, the height linear in time."""
    first, last = np.searchsorted(facts.ping_times, (stamp - PING_WINDOW_S, stamp + PING_WINDOW_S))
    now = facts.world_from_body(stamp)
    hits = np.vstack([facts.hits[i] @ (now.T @ facts.world_from_body(facts.ping_times[i])).T for i in range(first, last)])
    later = np.concatenate([np.full(len(facts.hits[i]), facts.ping_times[i] - stamp) for i in range(first, last)])
    a, b, c, _ = np.linalg.lstsq(np.c_[hits[:, :2], np.ones(len(hits)), later], hits[:, 2], rcond=None)[0]
    size = np.sqrt(a * a + b * b + 1)
    return np.array([a, b, -1.0]) / size, -c / size


def rays(facts, width, height, u, v):
    """Unit vectors in the body along which a picture of this size looks through its pixels."""
    sx, sy = width / facts.size[0], height / facts.size[1]
    fx, cx, fy, cy = facts.k[0] * sx, (facts.k[2] + 0.5) * sx - 0.5, facts.k[4] * sy, (facts.k[5] + 0.5) * sy - 0.5
    r = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], -1)
    return (r / np.linalg.norm(r, axis=-1, keepdims=True)) @ facts.camera[0].T.astype(r.dtype)


def light_path(facts, plane, r):
    """ℓ_a, ℓ_s, θ, φ, cos γ along rays."""
    normal, distance = plane[0].astype(r.dtype), plane[1]
    turn, strobe = facts.strobe
    camera = facts.camera[1]
    camera_leg = r.dtype.type(distance - plane[0] @ camera) / (r @ normal)
    way = camera_leg[..., None] * (r @ turn.astype(r.dtype)) + (turn.T @ (camera - strobe)).astype(r.dtype)
    strobe_leg = np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2 + way[..., 2] ** 2)
    cos_incidence = way @ (turn.T @ plane[0]).astype(r.dtype) / strobe_leg
    return strobe_leg, camera_leg, np.arctan2(way[..., 1], way[..., 2]), np.arctan2(way[..., 0], way[..., 2]), cos_incidence


def look(facts, jpeg, stamp):
    """Pass one's share of a frame: keypoints, their descriptors, light paths, and colours under several blurs."""
    light = cv2.LUT(simplejpeg.decode_jpeg(jpeg, "RGB"), LIGHT_OF_CODE)
    scale = DETECTION_SIDE_PX / max(light.shape)
    light = cv2.resize(light, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    grey = np.log(np.maximum(light.mean(-1), 1e-4))
    low, high = np.percentile(grey[::4, ::4], (0.5, 99.5))
    found, descriptors = cv2.SIFT_create(KEYPOINTS).detectAndCompute(np.uint8(np.clip((grey - low) / (high - low), 0, 1) * 255), None)
    xy = np.array([k.pt for k in found], np.float32)
    clipped = (light.max(-1) > CLIPPED).astype(np.float32)
    layers = np.dstack([light, clipped])
    colors = np.stack([cv2.remap(cv2.GaussianBlur(layers, (0, 0), s), xy[:, None], None, cv2.INTER_LINEAR)[:, 0] for s in BLURS_PX], 1)
    margin = 2.5 * BLURS_PX[-1]
    inside = ((xy > margin) & (xy < np.array(light.shape[1::-1]) - margin)).all(1)
    usable = inside & (colors[:, :, 3] < 0.02).all(1) & (colors[:, :, :3] > DARK).all((1, 2))
    path = np.stack(light_path(facts, plane_under(facts, stamp), rays(facts, *light.shape[1::-1], *xy.T.astype(float))), -1)
    descriptors = np.sqrt(descriptors / descriptors.sum(1, keepdims=True))  # RootSIFT: unit length
    return SimpleNamespace(xy=xy[usable], descriptors=descriptors[usable], path=path[usable], log_colors=np.log(colors[usable, :, :3]))


def match(a, b):
    """Indices of keypoints that see the same point."""
    alike = a.descriptors @ b.descriptors.T
    best = alike.argmax(1)
    rows = np.arange(len(best))
    nearest = 2 - 2 * alike[rows, best]
    alike[rows, best] = -1
    i = np.flatnonzero(nearest < RATIO**2 * (2 - 2 * alike.max(1)))
    if len(i) < LEAST_INLIERS:
        return i[:0], i[:0]
    _, inlier = cv2.findHomography(a.xy[i], b.xy[best[i]], cv2.RANSAC, RANSAC_PX)
    i = i[inlier.ravel() > 0] if inlier is not None and inlier.sum() >= LEAST_INLIERS else i[:0]
    return i, best[i]


def color_under(log_colors, wider):
    """Log colours under a Gaussian `wider` than the footprint, between those of two blurs."""
    level = np.interp(np.log(wider), np.log(BLURS_PX / FOOTPRINT_PX), np.arange(len(BLURS_PX)))
    lower = np.minimum(level.astype(int), len(BLURS_PX) - 2)
    rows, share = np.arange(len(level)), (level - lower)[:, None]
    return (1 - share) * log_colors[rows, lower] + share * log_colors[rows, lower + 1]


def pairs(pool, frames, ahead):
    """Light paths and log colours of points seen in two frames."""
    both = ((frames[i], frames[j]) for i in range(len(frames)) for j in range(i + 1, min(i + 1 + NEIGHBOURS, len(frames))))

    def work(a, b):
        i, j = match(a, b)
        path_a, path_b = a.path[i], b.path[j]
        farther = np.maximum(path_a[:, 1], path_b[:, 1])  # the same metres of floor in both views
        return path_a, path_b, color_under(a.log_colors[i], farther / path_a[:, 1]), color_under(b.log_colors[j], farther / path_b[:, 1])

    return [np.concatenate(part) for part in zip(*in_order(pool, work, both, ahead))]


def bilinear(path):
    """Cells of the beam's grid around each direction, and their weights."""
    x, y = ((v + REACH) / (2 * REACH) * (GRID - 1) for v in (path[:, 2], path[:, 3]))
    i, j = (np.clip(v.astype(int), 0, GRID - 2) for v in (x, y))
    fx, fy = x - i, y - j
    cells = np.stack([i * GRID + j, (i + 1) * GRID + j, i * GRID + j + 1, (i + 1) * GRID + j + 1], 1)
    return cells, np.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], 1)


def known(path):
    """What of the log light needs no estimate: spreading and incidence."""
    return -2 * np.log(path[:, 0]) + np.log(path[:, 4])


def solve(path_a, path_b, color_a, color_b):
    """α per band and log BP: least squares with Cauchy weights over differences of matched points; reflectance falls out of them."""
    n, cells = len(path_a), GRID * GRID
    y = (color_a - color_b - (known(path_a) - known(path_b))[:, None]).T.ravel()
    (cell_a, weight_a), (cell_b, weight_b) = bilinear(path_a), bilinear(path_b)
    beam = sp.csr_matrix((np.c_[weight_a, -weight_b].ravel(), np.c_[cell_a, cell_b].ravel(), np.arange(n + 1) * 8), (n, cells))
    longer = path_a[:, :2].sum(1) - path_b[:, :2].sum(1)
    water = sp.kron(sp.identity(3), -longer[:, None])
    second = sp.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(GRID - 2, GRID))
    smooth = SMOOTHNESS * sp.vstack([sp.kron(second, sp.identity(GRID)), sp.kron(sp.identity(GRID), second)])
    equations = sp.hstack([sp.vstack([beam] * 3), water]).tocsr()
    # What no pair tells is smooth, and the beam's level, which differences do not hold, is zero.
    tied = sp.block_diag([smooth.T @ smooth, sp.csr_matrix((3, 3))]) + 1e-6 * sp.identity(cells + 3)
    weights = np.ones(3 * n)
    for _ in range(REWEIGHTINGS):
        root = np.sqrt(weights)
        weighted = sp.diags(root) @ equations
        # Normal equations: fifteen times as fast as lsmr to the same digits.
        x = spsolve((weighted.T @ weighted + tied).tocsc(), weighted.T @ (root * y), permc_spec="MMD_AT_PLUS_A")
        misfit = y - equations @ x
        spread = 1.4826 * np.median(np.abs(misfit))
        weights = 1 / (1 + (misfit / (2 * spread)) ** 2) ** 2
    return x[cells:], (x[:cells] - x[:cells].max()).reshape(GRID, GRID).astype(np.float32), spread


def exposure(alpha, beam, path, color):
    """One factor per band for the whole log: the median is grey, the highlights are near white."""
    cells, weights = bilinear(path)
    water = known(path)[:, None] + (beam.ravel()[cells] * weights).sum(1)[:, None] - path[:, :2].sum(1)[:, None] * alpha
    corrected = color - water
    medians = np.median(corrected, 0)
    balance = np.exp(medians.mean() - medians)
    return balance * HIGHLIGHT_LEVEL / np.exp(np.quantile((corrected + np.log(balance)).max(1), HIGHLIGHT_QUANTILE))


def correct(facts, model, all_rays, jpeg, stamp):
    """Pass two's share of a frame: a JPEG divided by what the water and the strobe did."""
    alpha, beam, gain, quality = model
    codes = simplejpeg.decode_jpeg(jpeg, "RGB")
    sampling = simplejpeg.decode_jpeg_header(jpeg)[3]
    strobe_leg, camera_leg, theta, phi, cos_incidence = light_path(facts, plane_under(facts, stamp), all_rays)
    to_cells = np.float32((GRID - 1) / (2 * REACH))
    log_beam = cv2.remap(beam, (phi + np.float32(REACH)) * to_cells, (theta + np.float32(REACH)) * to_cells, cv2.INTER_LINEAR)
    common = strobe_leg**2 / cos_incidence * np.exp(-log_beam)
    length = strobe_leg + camera_leg
    light = cv2.LUT(codes, LIGHT_OF_CODE)
    for band in range(3):
        light[..., band] *= common * np.exp(np.float32(alpha[band]) * length) * np.float32(gain[band] * (1 << 14))
    shown = CODE_OF_LIGHT[np.minimum(light, (1 << 16) - 1).astype(np.uint16)]
    return simplejpeg.encode_jpeg(shown, quality, "RGB", sampling)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("input"), parser.add_argument("output")
    parser.add_argument("--threads", type=int, default=1), parser.add_argument("--quality", type=int, default=92)
    options = parser.parse_args()
    cv2.setNumThreads(1)  # the pool has the cores
    ahead = 2 * options.threads
    facts = read_facts(options.input)
    with ThreadPoolExecutor(options.threads) as pool:
        pictures = ((facts, said.data, seconds(said.header)) for *_, said in messages(options.input, [facts.picture_topic]))
        path_a, path_b, color_a, color_b = pairs(pool, list(in_order(pool, look, pictures, ahead)), ahead)
        alpha, beam, spread = solve(path_a, path_b, color_a, color_b)
        model = alpha, beam, exposure(alpha, beam, path_a, color_a), options.quality
        print(f"attenuation  {alpha[0]:.4f} / {alpha[1]:.4f} / {alpha[2]:.4f} per metre ({len(path_a)} pairs, residual {spread:.4f})")
        wall, cpu = time.perf_counter(), time.process_time()
        v, u = np.mgrid[: facts.size[1], : facts.size[0]].astype(np.float32)
        write(pool, options, facts, model, rays(facts, *facts.size, u, v), ahead)
        print(f"pass two     {time.perf_counter() - wall:.3f} s wall, {time.process_time() - cpu:.3f} s CPU")


def write(pool, options, facts, model, all_rays, ahead):
    """The log again, each picture followed by its corrected one."""
    with open(options.output, "wb") as file:
        writer = Writer(file, chunk_size=4 << 20, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        ids = {}

        def add(schema, topic, message, data):
            if topic not in ids:
                ids[topic] = writer.register_channel(topic, "cdr", writer.register_schema(schema.name, schema.encoding, schema.data))
            writer.add_message(ids[topic], message.log_time, data, message.publish_time, message.sequence)

        def work(schema, channel, message, said):
            if channel.topic != facts.picture_topic:
                return schema, channel, message, said, None
            return schema, channel, message, said, correct(facts, model, all_rays, said.data, seconds(said.header))

        encode = None
        # Messages between two pictures count as well, hence so many.
        for schema, channel, message, said, jpeg in in_order(pool, work, messages(options.input), 40 * ahead):
            add(schema, channel.topic, message, message.data)
            if jpeg is not None:
                encode = encode or serialize_dynamic(schema.name, schema.data.decode())[schema.name]
                stamp, frame_id = said.header.stamp, said.header.frame_id
                header = {"stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec}, "frame_id": frame_id}
                topic = channel.topic.replace("image_raw", "image_corrected")
                add(schema, topic, message, encode({"header": header, "format": "jpeg", "data": jpeg}))
        writer.finish()


if __name__ == "__main__":
    main()
