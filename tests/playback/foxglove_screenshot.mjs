// A picture of a log in Foxglove Studio 1.48, the last of its line that a package registry holds (`@foxglove/studio-base`, MPL-2.0), in a
// headless Chromium, with a layout that `unwater layout --foxglove` wrote.
//
//   node foxglove_screenshot.mjs LOG.mcap LAYOUT.json OUT.png [SECONDS from the start; the middle where not given]
//
// Needs Chromium (CHROMIUM=/path, default /usr/bin/chromium). The browser reaches this script's own server alone. Fails where a
// panel of pictures or of 3-D is all but of one colour, or a plot has no value.
import { createServer } from "node:http";
import { createReadStream, existsSync, mkdtempSync, rmSync, statSync } from "node:fs";
import { open, readFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { dirname, extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import { FileHandleReadable } from "@mcap/nodejs";
import { McapIndexedReader } from "@mcap/core";
import { chromium } from "playwright-core";

const [log, layoutFile, out, seconds] = process.argv.slice(2);
// In 1.48 the panel that is called Image today was an experiment; the pictures' panel was ImageViewPanel. All else is as it was written.
const layout = (await readFile(layoutFile, "utf8")).replaceAll('"Image!', '"ImageViewPanel!');
const old = JSON.parse(layout);
for (const [id, config] of Object.entries(old.configById)) {
  if (id.startsWith("ImageViewPanel!")) old.configById[id] = { cameraTopic: config.imageMode.imageTopic, foxglovePanelTitle: config.foxglovePanelTitle, mode: "fit", enabledMarkerTopics: [], synchronize: false, transformMarkers: false };
}
const modules = join(dirname(fileURLToPath(import.meta.url)), "node_modules");
const studio = join(modules, "@foxglove/studio-base/assets");

// The least that an app around the library must bring: settings, and a store with one layout in it.
const PAGE = `<!doctype html><meta charset="utf-8"><title>unwater</title>
<style>html, body, #root { height: 100%; margin: 0; display: flex; flex: 1 1 100%; overflow: hidden; outline: none }</style><div id="root"></div>
<script src="/react/umd/react.production.min.js"></script><script src="/react-dom/umd/react-dom.production.min.js"></script>
<script>window.react = React; window["react-dom"] = ReactDOM; window.global = window;</script>
<script src="/studio/index.js"></script>
<script type="module">
const layout = { id: "unwater", name: "unwater", permission: "CREATOR_WRITE", baseline: { data: ${JSON.stringify(old).replaceAll("<", "\\u003c")}, savedAt: new Date().toISOString() } };
const settings = new Map([["colorScheme", "dark"], ["timezone", "UTC"], ["hideSignInPrompt", true], ["ui.open-dialog-startup", false]]);
const store = { list: async () => [layout], get: async () => layout, put: async (_, l) => l, delete: async () => {}, importLayouts: async () => {} };
const configuration = { get: (k) => settings.get(k), set: async (k, v) => void settings.set(k, v), addChangeListener() {}, removeChangeListener() {} };
localStorage.setItem("studio.profile-data", JSON.stringify({ currentLayoutId: "unwater" }));
await window.initI18n?.();
ReactDOM.render(React.createElement(window.App, {
  deepLinks: [location.href], appConfiguration: configuration, layoutStorage: store, extensionLoaders: [], enableGlobalCss: true,
  dataSources: [new window.RemoteDataSourceFactory()],
}), document.getElementById("root"));
</script>`;

const TYPES = { ".js": "text/javascript", ".wasm": "application/wasm", ".css": "text/css", ".svg": "image/svg+xml", ".woff2": "font/woff2" };
const size = statSync(log).size;
const server = createServer((request, response) => {
  const path = decodeURIComponent(new URL(request.url, "http://x").pathname);
  const head = { "Access-Control-Allow-Origin": "*", "Access-Control-Expose-Headers": "Content-Length, Content-Range, Accept-Ranges", "Accept-Ranges": "bytes" };
  if (path === "/") return response.writeHead(200, { "Content-Type": "text/html" }).end(PAGE);
  if (path === "/log.mcap") {
    const range = /^bytes=(\d+)-(\d*)$/.exec(request.headers.range ?? "");
    const from = range ? Number(range[1]) : 0;
    const to = range?.[2] ? Math.min(Number(range[2]), size - 1) : size - 1;
    response.writeHead(range ? 206 : 200, { ...head, "Content-Length": to - from + 1, ...(range ? { "Content-Range": `bytes ${from}-${to}/${size}` } : {}) });
    return request.method === "HEAD" ? response.end() : createReadStream(log, { start: from, end: to }).pipe(response);
  }
  const [, first, ...rest] = path.split("/");
  const root = { react: join(modules, "react"), "react-dom": join(modules, "react-dom") }[first] ?? studio;
  const file = join(root, normalize("/" + (root === studio && first !== "studio" ? [first, ...rest] : rest).join("/")));
  if (!existsSync(file) || !statSync(file).isFile()) return response.writeHead(404).end();
  response.writeHead(200, { "Content-Type": TYPES[extname(file)] ?? "application/octet-stream" });
  return createReadStream(file).pipe(response);
});
await new Promise((done) => server.listen(0, "127.0.0.1", done));
const base = `http://127.0.0.1:${server.address().port}`;

const file = await open(log, "r");
const { statistics } = await McapIndexedReader.Initialize({ readable: new FileHandleReadable(file), decompressHandlers: {} });
await file.close();
const [begin, end] = [statistics.messageStartTime, statistics.messageEndTime];
const at = seconds == undefined ? (begin + end) / 2n : begin + BigInt(Math.round(Number(seconds) * 1e9));

const profile = mkdtempSync(join(tmpdir(), "playback-"));
const browser = await chromium.launchPersistentContext(profile, {
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", headless: true, viewport: { width: 1920, height: 1080 },
  args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"],
});
const faults = [];
try {
  await browser.route("**/*", (route) => (/^(http:\/\/127\.0\.0\.1:|blob:|data:)/.test(route.request().url()) ? route.continue() : route.abort()));
  const page = browser.pages()[0] ?? (await browser.newPage());
  page.on("pageerror", (error) => console.log(`page: ${error.message.split("\n")[0]}`));
  page.on("console", (message) => process.env.VERBOSE && console.log(`console: ${message.text().slice(0, 300)}`));
  const url = new URL(base);
  url.searchParams.set("ds", "remote-file");
  url.searchParams.set("ds.url", `${base}/log.mcap`);
  url.searchParams.set("time", new Date(Number(at / 1000000n)).toISOString());
  await page.goto(url.href, { waitUntil: "domcontentloaded", timeout: 120000 });
  await page.waitForSelector('[data-testid^="panel-mouseenter-container"], .mosaic-window', { timeout: 180000 }).catch(() => faults.push("no panel came up"));
  // Software drawing is slow: look again for a while before a panel is called empty.
  const colours = async (png) => page.evaluate(async (data) => {
    const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const count = new Map();
    for (const p of new Uint32Array(context.getImageData(0, 0, bitmap.width, bitmap.height).data.buffer)) count.set(p, (count.get(p) ?? 0) + 1);
    return { colours: count.size, share: 1 - Math.max(...count.values()) / (bitmap.width * bitmap.height) };
  }, png.toString("base64"));
  for (const [id, config] of Object.entries(old.configById)) {
    const type = id.split("!")[0];
    if (!["ImageViewPanel", "3D", "Plot", "RosOut"].includes(type)) continue;
    const panel = page.locator(`[data-testid="panel-mouseenter-container ${id}"]`).first();
    let why = "no such panel";
    for (let i = 0; i < 20 && why; i++) {
      await page.waitForTimeout(i ? 2000 : 500);
      if (!(await panel.count())) continue;
      const text = await panel.innerText();
      if (type === "ImageViewPanel" || type === "3D") {
        if (!(await panel.locator("canvas").count())) { why = "no canvas"; continue; }
        // While pictures come in, the canvas may be another one by now.
        const picture = await panel.locator("canvas").first().screenshot({ timeout: 10000 }).catch(() => undefined);
        if (!picture) { why = "its canvas does not hold still"; continue; }
        const seen = await colours(picture);
        why = seen.colours > 64 && seen.share > 0.05 ? "" : `only ${seen.colours} colours, ${Math.round(100 * seen.share)} % not background`;
      } else if (type === "Plot") {
        why = config.paths.every(({ label }) => new RegExp(`${label}\\s+-?[\\d.]+`).test(text)) ? "" : `no value: ${text.replaceAll("\n", " ")}`;
      } else {
        why = /attenuation/.test(text) ? "" : `no line: ${text.replaceAll("\n", " ")}`;
      }
    }
    console.log(`${id} ${config.foxglovePanelTitle ?? ""}: ${why || "ok"}`);
    if (why) faults.push(`${id}: ${why}`);
  }
  // Room for the panels: fold the side bar, close the hint.
  await page.locator('[data-testid="CloseIcon"]').first().click({ timeout: 3000 }).catch(() => {});
  await page.mouse.click(26, 26);
  await page.waitForTimeout(6000);
  await page.mouse.move(960, 5);
  await page.waitForTimeout(1500);
  await page.screenshot({ path: out });
} finally {
  await browser.close();
  server.close();
  server.closeAllConnections();
  rmSync(profile, { recursive: true, force: true });
}
for (const f of faults) console.error(`Foxglove: ${f}`);
process.exitCode = faults.length ? 1 : 0;
