// Files on their way to the service, by tus 1.0: progress, and going on after a lost link or a reload.
import { address, ask, problemOf, Problem, sleep } from "./api.js";
import { askForKey, authorization, forget, key } from "./keys.js";
import { keep, kept, release } from "./kept.js";
import { words } from "./words.js";

const TUS = { "Tus-Resumable": "1.0.0" };
/** One request carries this much: what has come of a broken one is kept as well, so it may be large. */
const PIECE_BYTES = 16 * 2 ** 20;
const LONGEST_PAUSE_MS = 15_000;
/** Problems that another try may solve. */
const PASSING = [0, 408, 409, 423, 429, 500, 502, 503, 504];

/** A file on its way. `state`: waiting, sending, lost, paused, reading, taken, refused, cancelled. */
export class Transfer {
  constructor(file, declared = {}, url = null) {
    Object.assign(this, { file, declared, url, state: "waiting", sent: 0, raySets: [], leftOut: [], problem: null, rate: null });
    this.listeners = new Set();
    this.stop = null;
  }

  onchange(listener) {
    this.listeners.add(listener);
  }

  become(state, more) {
    Object.assign(this, { state, ...more });
    for (const listener of this.listeners) listener(this);
  }

  /** Sends until the file is a ray set, is refused, is paused or is cancelled. */
  async run() {
    const stop = new AbortController();
    this.stop = stop;
    for (let pause = 1000; !stop.signal.aborted;) {
      try {
        await this.begin();
        await this.send(stop.signal, () => { pause = 1000; });
        if (!stop.signal.aborted) await this.end(stop.signal);
        return;
      } catch (error) {
        if (stop.signal.aborted) return;
        if (!(error instanceof Problem) || !PASSING.includes(error.status)) return this.give(error);
        this.become("lost", { problem: error });
        await Promise.race([sleep(pause, stop.signal), online()]);
        pause = Math.min(2 * pause, LONGEST_PAUSE_MS);
      }
    }
  }

  async begin() {
    if (this.url) {
      const answer = await ask(this.url, { method: "HEAD", headers: TUS }).catch((error) => {
        // Refused or expired: what is known of it says why.
        if ([404, 410].includes(error.status)) return null;
        throw error;
      });
      if (!answer) {
        const known = await ask(this.url).then((found) => found.json()).catch(() => null);
        if (known?.problem) throw new Problem(422, known.problem);
        this.url = null;
      } else {
        this.sent = Number(answer.headers.get("Upload-Offset"));
        return;
      }
    }
    const metadata = Object.entries({ filename: this.file.name, ...this.declared }).filter(([, value]) => value);
    const answer = await ask("v1/uploads", {
      method: "POST",
      headers: { ...TUS, "Upload-Length": this.file.size, "Upload-Metadata": metadata.map(([name, value]) => `${name} ${base64(value)}`).join(",") },
    });
    this.url = new URL(answer.headers.get("Location"), address("v1/uploads")).pathname;
    this.sent = 0;
    await keep({ url: this.url, file: this.file, declared: this.declared });
  }

  async send(signal, onadvance) {
    while (this.sent < this.file.size && !signal.aborted) {
      const piece = this.file.slice(this.sent, this.sent + PIECE_BYTES);
      const began = { at: performance.now(), sent: this.sent };
      this.become("sending", { problem: null });
      this.sent = await patch(this.url, this.sent, piece, signal, (bytes) => {
        const seconds = (performance.now() - began.at) / 1000;
        this.become("sending", { sent: began.sent + bytes, rate: seconds > 0.2 ? bytes / seconds : this.rate });
      });
      onadvance();
    }
  }

  /** The bytes are there: what did they become? */
  async end(signal) {
    this.become("reading", { sent: this.file.size });
    for (let pause = 150; !signal.aborted; pause = Math.min(2 * pause, 2000)) {
      const upload = await (await ask(this.url)).json();
      if (upload.state === "taken") {
        await release(this.url);
        this.become("taken", { raySets: upload.ray_sets, leftOut: upload.left_out });
        return;
      }
      if (upload.state === "refused") throw new Problem(422, upload.problem);
      await sleep(pause, signal);
    }
  }

  async give(error) {
    if (this.url) await release(this.url);
    this.become("refused", { problem: error });
  }

  pause() {
    this.stop?.abort();
    this.become("paused");
  }

  async cancel() {
    this.stop?.abort();
    const url = this.url;
    this.become("cancelled");
    if (url) {
      await release(url);
      await ask(url, { method: "DELETE", headers: TUS }).catch(() => {});
    }
  }
}

/** Transfers that a reload interrupted. */
export async function interrupted() {
  return (await kept()).map(({ url, file, declared }) => new Transfer(file, declared, url));
}

/** Sends a piece; the new offset. XMLHttpRequest alone tells how much of a body has left. */
async function patch(url, offset, piece, signal, onprogress) {
  const had = key();
  const answer = await new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PATCH", address(url));
    const headers = { ...TUS, ...authorization(), "Upload-Offset": offset, "Content-Type": "application/offset+octet-stream" };
    for (const [name, value] of Object.entries(headers)) request.setRequestHeader(name, value);
    request.upload.onprogress = (event) => onprogress(event.loaded);
    request.onload = () => resolve(request);
    request.onerror = () => reject(new Problem(0, words.away));
    request.onabort = () => reject(new DOMException("stopped", "AbortError"));
    signal.addEventListener("abort", () => request.abort());
    request.send(piece);
  });
  if (answer.status === 204) return Number(answer.getResponseHeader("Upload-Offset"));
  if (answer.status === 401) {
    if (had && had === key()) forget();
    if (key() || (await askForKey(had !== null))) return offset;
  }
  throw await problemOf(new Response(answer.responseText, { status: answer.status }));
}

function online() {
  return new Promise((resolve) => addEventListener("online", resolve, { once: true }));
}

function base64(text) {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}
