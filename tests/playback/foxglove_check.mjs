// What Foxglove and Lichtblick make of a log, by the libraries they decode with and the rules by which their panels choose topics.
//
//   node foxglove_check.mjs LOG.mcap [--layout FILE.json] TOPIC=KIND...
//
// KIND is `image`, `plot:.path`, `3d`, `log`. Every message of every topic must decode. With a layout, its panels must be known ones, each
// in its tree once, and the topics and paths they name must be of the panels' kinds; the 3-D panel's frames must be joined by transforms.
import { open, readFile } from "node:fs/promises";
import { FileHandleReadable } from "@mcap/nodejs";
import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers } from "@mcap/support";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor/index.js";

const KINDS = {
  image: ["sensor_msgs/msg/CompressedImage", "foxglove.CompressedImage", "sensor_msgs/msg/Image", "foxglove.RawImage"],
  "3d": ["sensor_msgs/msg/PointCloud2", "foxglove.PointCloud", "geometry_msgs/msg/PoseStamped", "foxglove.PoseInFrame",
    "tf2_msgs/msg/TFMessage", "foxglove.FrameTransform", "sensor_msgs/msg/CameraInfo", "foxglove.CameraCalibration"],
  log: ["rcl_interfaces/msg/Log", "foxglove.Log"],
};
// What the Image panel draws of bare pixels, as they are meant to look.
const RAW = { rgb8: 3, bgr8: 3, "8UC3": 3, rgba8: 4, bgra8: 4, mono8: 1, "8UC1": 1, yuyv: 2, uyvy: 2, yuv422: 2, yuv422_yuy2: 2,
  bayer_rggb8: 1, bayer_bggr8: 1, bayer_gbrg8: 1, bayer_grbg8: 1 };

function decoder(channel, schema) {
  const text = new TextDecoder();
  if (channel.messageEncoding === "cdr" && schema?.encoding === "ros2msg") {
    const reader = new MessageReader(parse(text.decode(schema.data), { ros2: true }));
    return (data) => reader.readMessage(data);
  }
  if (channel.messageEncoding === "protobuf" && schema?.encoding === "protobuf") {
    const type = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(schema.data)).lookupType(schema.name);
    return (data) => type.toObject(type.decode(data), { longs: Number, defaults: true, enums: Number });
  }
  if (channel.messageEncoding === "json") return (data) => JSON.parse(text.decode(data));
  return undefined; // ROS 1 and IDL: not what unwater writes for these viewers
}

/** The value at a message path, as `.data[0]`. */
const at = (message, path) => path.match(/[^.[\]]+/g).reduce((value, key) => value?.[key], message);

function imageFault(message) {
  const head = Buffer.from(message.data.buffer, message.data.byteOffset, Math.min(4, message.data.byteLength)).toString("latin1");
  if (message.encoding != undefined) {
    const step = RAW[message.encoding] && message.width * RAW[message.encoding];
    if (!step) return `the encoding ${message.encoding} is not drawn`;
    return message.step < step || message.data.length < message.step * message.height ? "too few pixels" : undefined;
  }
  const is = head.startsWith("\xff\xd8\xff") ? "jpeg" : head === "\x89PNG" ? "png" : "no picture";
  return is === message.format || (is !== "no picture" && message.header) ? undefined : `${message.format}, but ${is}`;
}

const [path, ...rest] = process.argv.slice(2);
const file = await open(path, "r");
const reader = await McapIndexedReader.Initialize({ readable: new FileHandleReadable(file), decompressHandlers: await loadDecompressHandlers() });
const topics = new Map();
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  topics.set(channel.id, { topic: channel.topic, schema: schema?.name ?? "", decode: decoder(channel, schema), messages: [], count: 0, faults: new Set() });
}
const parents = new Map(); // frame -> frames it is joined to
const join = (a, b) => { for (const [x, y] of [[a, b], [b, a]]) parents.set(x, (parents.get(x) ?? new Set()).add(y)); };
for await (const message of reader.readMessages()) {
  const t = topics.get(message.channelId);
  t.count++;
  if (!t.decode) continue;
  try {
    const said = t.decode(message.data);
    if (KINDS.image.includes(t.schema)) {
      const why = imageFault(said);
      if (why) t.faults.add(why);
      t.messages.push({});
      continue;
    }
    for (const tf of said.transforms ?? []) join(tf.header.frame_id, tf.child_frame_id);
    if (t.schema === "foxglove.FrameTransform") join(said.parent_frame_id ?? said.parentFrameId, said.child_frame_id ?? said.childFrameId);
    t.messages.push(t.schema.endsWith("PointCloud2") || t.schema.endsWith("PointCloud") ? { header: said.header, frame_id: said.frame_id ?? said.frameId, points: said.data.length } : said);
  } catch (error) {
    t.faults.add(`does not decode: ${error.message}`);
  }
}
await file.close();
const byTopic = new Map([...topics.values()].map((t) => [t.topic, t]));
for (const name of [...byTopic.keys()].sort()) {
  const t = byTopic.get(name);
  console.log(name, t.schema, t.count, t.decode ? [...t.faults].join("; ") : "not read here");
}

function fault(topic, kind) {
  const t = byTopic.get(topic);
  if (!t) return "is not there";
  if (!t.decode || t.count === 0) return "holds no message that is read";
  if (t.faults.size) return [...t.faults].join("; ");
  const [word, ...field] = kind.split(":");
  if (word !== "plot") return KINDS[word].includes(t.schema) ? undefined : `is a ${t.schema}, no ${word}`;
  const numbers = t.messages.map((m) => at(m, field.join(":")));
  return numbers.every((n) => Number.isFinite(Number(n)) && n !== undefined) ? undefined : `has no finite number at ${field} in every message`;
}

const faults = [];
const claim = (what, topic, kind) => { const why = fault(topic, kind); if (why) faults.push(`${what}${topic} ${why}`); };

function checkLayout(layout) {
  const seen = [];
  const walk = (node) => {
    if (typeof node === "string") return seen.push(node);
    if (!["row", "column"].includes(node?.direction) || !(node.splitPercentage > 0 && node.splitPercentage < 100)) faults.push(`layout: a split ${JSON.stringify(node)}`);
    else [node.first, node.second].forEach(walk);
  };
  walk(layout.layout);
  for (let i = 0; i < seen.length; i++) for (const tab of layout.configById[seen[i]]?.tabs ?? []) walk(tab.layout);
  if (seen.sort().join() !== Object.keys(layout.configById).sort().join()) faults.push("layout: panels and tree do not agree");
  for (const key of ["globalVariables", "userNodes", "playbackConfig"]) if (typeof layout[key] !== "object") faults.push(`layout: no ${key}`);
  const count = {};
  for (const [id, config] of Object.entries(layout.configById)) {
    const type = id.split("!")[0];
    count[type] = (count[type] ?? 0) + 1;
    const what = `layout, ${id}: `;
    if (type === "Image") claim(what, config.imageMode.imageTopic, "image");
    else if (type === "RosOut") claim(what, config.topicToRender, "log");
    else if (type === "Plot") for (const { value, enabled, timestampMethod } of config.paths) {
      const [, topic, field] = value.match(/^([^.[]+)(.*)$/);
      claim(what, topic, `plot:${field}`);
      if (enabled !== true || timestampMethod !== "receiveTime") faults.push(`${what}${value} is not enabled`);
    } else if (type === "3D") {
      const joined = new Set([config.followTf]);
      for (const frame of joined) for (const next of parents.get(frame) ?? []) joined.add(next);
      for (const topic of Object.keys(config.topics)) {
        claim(what, topic, "3d");
        const first = byTopic.get(topic)?.messages[0];
        const frame = first?.header?.frame_id ?? first?.frame_id ?? first?.frameId;
        if (!joined.has(frame)) faults.push(`${what}${topic} is in ${frame}, which no transform joins to ${config.followTf}`);
      }
    } else if (type !== "Tab") faults.push(`${what}no such panel`);
  }
  for (const [type, least] of [["Image", 3], ["Plot", 3], ["3D", 1], ["RosOut", 1]]) if (!(count[type] >= least)) faults.push(`layout: ${count[type] ?? 0} panels ${type}`);
}

if (rest[0] === "--layout") {
  checkLayout(JSON.parse(await readFile(rest[1], "utf8")));
  rest.splice(0, 2);
}
for (const wanted of rest) {
  const [topic, ...kind] = wanted.split("=");
  claim("", topic, kind.join("="));
}
for (const f of faults) console.error(`Foxglove: ${f}`);
process.exitCode = faults.length ? 1 : 0;
