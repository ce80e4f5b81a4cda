// Opens pages of `unwater report` in headless Chromium and says what is wrong with them.
//
//     NODE_PATH=… node tests/report_page.cjs [--shots FOLDER] PAGE.html...
//
// Needs playwright-core and Chromium (CHROMIUM names it, /usr/bin/chromium where unset). `--probe` only says whether both are there.
"use strict";
const path = require("path");
const { pathToFileURL } = require("url");
const { chromium } = require("playwright-core");

const FIGURES = ["before-after", "channel-means", "pairs", "beam-pattern", "stages", "track-altitude", "track-residual"];
const WIDTHS = [400, 1600];

const ensure = (holds, sentence) => { if (!holds) throw new Error(sentence); };

async function check(browser, file, shots) {
  const name = path.basename(file, ".html");
  const page = await browser.newPage({ viewport: { width: 1200, height: 900 } });
  const said = [];
  page.on("console", (m) => { if (m.type() !== "log") said.push(`${m.type()}: ${m.text()}`); });
  page.on("pageerror", (e) => said.push(`error: ${e.message}`));
  page.on("request", (r) => { if (!/^(file|data):/.test(r.url())) said.push(`asked the network: ${r.url()}`); });
  await page.goto(pathToFileURL(path.resolve(file)).href);

  const figures = await page.$$eval("[data-figure]", (all) => all.map((f) => ({
    id: f.dataset.figure,
    missing: f.classList.contains("missing") ? f.textContent : null,
    drawn: f.querySelectorAll("svg .m, img").length,
    broken: [...f.querySelectorAll("img")].filter((i) => !i.complete || !i.naturalWidth).length,
  })));
  for (const id of FIGURES) ensure(figures.some((f) => f.id === id), `no figure ${id}`);
  for (const f of figures) {
    ensure(f.missing ? f.missing.length > 40 : f.drawn > 0 && f.broken === 0, `figure ${f.id}: ${JSON.stringify(f)}`);
  }

  // The knobs, by keyboard alone.
  const wipe = await page.$(".wipe-at");
  if (wipe) {
    const at = () => page.$eval(".frame.now .before", (i) => getComputedStyle(i).clipPath);
    const before = await at();
    await wipe.focus();
    await page.keyboard.press("ArrowRight");
    await page.keyboard.press("ArrowRight");
    ensure((await at()) !== before, "the slider moves nothing");
    ensure((await wipe.evaluate((w) => w.value)) === "52", "the slider does not move by arrow keys");
  }
  const which = await page.$(".which-frame");
  if (which) {
    const shown = () => page.$eval(".frame.now .which", (p) => p.textContent);
    const before = await shown();
    await which.focus();
    await page.keyboard.press("ArrowRight");
    ensure((await shown()) !== before, "the other frame does not come");
    ensure((await page.$$eval(".frames .frame", (f) => f.filter((e) => e.offsetHeight > 0).length)) <= (await page.$$(".wipe-at, .which-frame")).length, "two frames at once");
  }
  let read = 0;
  for (const plot of await page.$$("svg.plot")) {
    await plot.focus();
    await page.keyboard.press("ArrowRight");
    const text = await plot.evaluate((p) => p.closest("figure").querySelector(".read").textContent);
    ensure(/[0-9]/.test(text), "arrow keys read no value of a plot");
    read += 1;
  }

  const shot = (what) => shots && page.screenshot({ path: path.join(shots, `${name}.${what}.png`), fullPage: true });
  for (const width of WIDTHS) {
    await page.setViewportSize({ width, height: 900 });
    const [wide, room] = await page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]);
    ensure(wide <= room, `${wide - room} px too wide at ${width} px`);
    await shot(String(width));
  }
  await page.setViewportSize({ width: 1100, height: 900 });
  await page.emulateMedia({ colorScheme: "light" });
  const light = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  await shot("light");
  await page.emulateMedia({ colorScheme: "dark" });
  const dark = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  ensure(light !== dark, "dark is as light as light");
  await shot("dark");
  await page.emulateMedia({ media: "print", colorScheme: "light" });
  const hidden = await page.$$eval(".knobs", (k) => k.every((e) => getComputedStyle(e).display === "none"));
  ensure(hidden, "knobs on paper");
  if (shots) await page.pdf({ path: path.join(shots, `${name}.pdf`), format: "A4", margin: { top: "15mm", bottom: "15mm", left: "15mm", right: "15mm" } });
  ensure(said.length === 0, said.join("; "));
  await page.close();
  const missing = figures.filter((f) => f.missing).map((f) => f.id);
  console.log(`${name}: ${figures.length - missing.length} figures, ${read} plots read${missing.length ? `; not shown: ${missing.join(", ")}` : ""}`);
}

async function main() {
  const args = process.argv.slice(2);
  const executablePath = process.env.CHROMIUM || "/usr/bin/chromium";
  const flags = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];
  const browser = await chromium.launch({ executablePath, headless: true, args: flags });
  try {
    if (args[0] === "--probe") return;
    const shots = args[0] === "--shots" ? args.splice(0, 2)[1] : null;
    for (const file of args) {
      await check(browser, file, shots).catch((e) => { throw new Error(`${file}: ${e.message}`); });
    }
  } finally {
    await browser.close();
  }
}

main().catch((e) => { console.error(e.message); process.exit(1); });
