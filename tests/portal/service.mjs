// The service as the portal's cases meet it: the binary on a free port of loopback, with a data folder of its own.
import { execFileSync, spawn } from "node:child_process";
import { closeSync, mkdtempSync, openSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

const ROOT = fileURLToPath(new URL("../../", import.meta.url));
const BINARY = process.env.LAMPWRIGHT ?? join(ROOT, "target/debug/lampwright");
const START_MS = 120_000;

export class Service {
  /** Starts one; with `keys` it asks for them, and `key` has one. */
  static async start({ keys = false, flags = [], data, port = 0, sample = false } = {}) {
    const service = new Service();
    service.folder = data ?? mkdtempSync(join(tmpdir(), "portal-"));
    if (keys) service.key = execFileSync(BINARY, ["keys", "create", "--tenant", "lab", "--data", service.folder], { stdio: ["ignore", "pipe", "ignore"] }).toString().trim();
    service.logFile = join(service.folder, "log");
    const log = openSync(service.logFile, "a");
    const environment = Object.fromEntries(Object.entries(process.env).filter(([name]) => !name.startsWith("LAMPWRIGHT_")));
    const words = ["serve", "--listen", `127.0.0.1:${port}`, "--data", service.folder, ...(sample ? [] : ["--no-sample"]), ...(keys ? ["--auth", "on"] : []), ...flags];
    service.process = spawn(BINARY, words, { stdio: ["ignore", "pipe", log], env: environment });
    closeSync(log);
    service.url = await new Promise((resolve, reject) => {
      const late = setTimeout(() => reject(new Error(`the service did not start: ${service.log()}`)), START_MS);
      let said = "";
      service.process.stdout.on("data", (bytes) => {
        said += bytes;
        const found = / is at (http:\S+)/.exec(said);
        if (found) {
          clearTimeout(late);
          resolve(found[1]);
        }
      });
      service.process.on("exit", () => reject(new Error(`the service ended: ${service.log()}`)));
    });
    return service;
  }

  log() {
    return readFileSync(this.logFile, "utf8");
  }

  async ask(path, options = {}) {
    const answer = await fetch(new URL(path, this.url), { ...options, headers: { ...options.headers, ...(this.key ? { Authorization: `Bearer ${this.key}` } : {}) } });
    if (!answer.ok) throw new Error(`${path}: ${answer.status} ${await answer.text()}`);
    return answer.status === 204 ? null : answer.json();
  }

  /** Kills it, as a machine that fails would. */
  async kill() {
    if (this.process.exitCode !== null || this.process.signalCode !== null) return;
    this.process.removeAllListeners("exit");
    await new Promise((resolve) => {
      this.process.on("exit", resolve);
      this.process.kill("SIGKILL");
    });
  }

  async stop() {
    await this.kill();
    rmSync(this.folder, { recursive: true, force: true });
  }
}

/** A ray file of a known source. */
export function sample(name, rays) {
  const folder = mkdtempSync(join(tmpdir(), "portal-rays-"));
  const path = join(folder, `${name}.tm25ray`);
  execFileSync(BINARY, ["sample", name, "--rays", String(rays), "-o", path]);
  const bytes = readFileSync(path);
  rmSync(folder, { recursive: true });
  return { name: `${name}.tm25ray`, mimeType: "application/octet-stream", buffer: bytes };
}

/** A text that says nothing of itself: columns without names, neither unit nor W or lm. A Lambertian square of side 1 and flux 1, of one wavelength. */
export function bareText(rays, nm = 450) {
  let state = 1;
  // Park and Miller's generator: the same file each time.
  const random = () => {
    state = (state * 48271) % 2147483647;
    return state / 2147483647;
  };
  const lines = Array.from({ length: rays }, () => {
    const [share, turn] = [random(), 2 * Math.PI * random()];
    const across = Math.sqrt(share);
    const direction = [across * Math.cos(turn), across * Math.sin(turn), Math.sqrt(1 - share)];
    return [random() - 0.5, random() - 0.5, 0, ...direction].map((value) => value.toFixed(7)).concat((1 / rays).toExponential(9), nm).join(" ");
  });
  return { name: "bare.txt", mimeType: "text/plain", buffer: Buffer.from(`${lines.join("\n")}\n`) };
}
