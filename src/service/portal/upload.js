// Files on their way to the service, by tus 1.0: progress, and going on after a lost link or a reload.
import { address, ask, problemOf, Problem, sleep } from "./api.js";
import { askForKey, authorization, forget, key } from "./keys.js";
import { isKept, keep, kept, release } from "./kept.js";
import { words } from "./words.js";

const TUS = { "Tus-Resumable": "1.0.0" };
/** One request carries this much: what has come of a broken one is kept as well, so it may be large. */
const PIECE_BYTES = 16 * 2 ** 20;
const LONGEST_PAUSE_MS = 15_000;
/** Problems that another try may solve. */
const PASSING = [0, 408, 409, 423, 429, 500, 502, 503, 504];

/** The service has no such upload: it was deleted, it expired, or it is that of another key. */
const UNKNOWN = [404, 410];
/** The key may not be the one that the upload was begun with: another may come. */
const NOT_ALLOWED = [401, 403];

/**
 * A file on its way. `state`: waiting, sending, lost, paused, reading, taken, refused, cancelled; unknown, where the service has no
 * upload at the file's address any more; elsewhere, where another tab has seen to it.
 */
export class Transfer {
  constructor(file, declared = {}, url = null) {
    Object.assign(this, { file, declared, url, state: "waiting", sent: 0, raySets: [], leftOut: [], problem: null, rate: null });
    // Of a new upload the offset is known, and the browser does not keep it yet.
    Object.assign(this, { isNew: false, isFromBefore: url !== null });
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
    const { signal } = stop;
    this.become("waiting", { problem: null });
    if (!this.url && !(await this.insist(signal, () => this.create()))) return;
    if (this.state === "cancelled") await this.drop();
    else await alone(this.url, signal, () => this.goOn(signal));
  }

  /** Sends what the service does not have yet. No other tab does. */
  async goOn(signal) {
    if (this.isFromBefore && !(await isKept(this.url))) return this.become("elsewhere");
    return this.insist(signal, async (onadvance) => {
      await this.find();
      await this.send(signal, onadvance);
      if (!signal.aborted) await this.end(signal);
    });
  }

  /** Acts, again and again where another try may help; whether it came to its end. */
  async insist(signal, act) {
    for (let pause = 1000; !signal.aborted;) {
      try {
        await act(() => { pause = 1000; });
        return true;
      } catch (failed) {
        const error = this.url && UNKNOWN.includes(failed.status) ? await this.told(failed) : failed;
        if (signal.aborted) return false;
        if (this.url && UNKNOWN.includes(error.status)) return this.miss();
        if (!(error instanceof Problem) || !PASSING.includes(error.status)) return this.give(error);
        this.become("lost", { problem: error });
        await Promise.race([sleep(pause, signal), online()]);
        pause = Math.min(2 * pause, LONGEST_PAUSE_MS);
      }
    }
    return false;
  }

  /** Begins a new upload: only for a file that a person has just chosen, or chosen to send again. */
  async create() {
    const metadata = Object.entries({ filename: this.file.name, ...this.declared }).filter(([, value]) => value);
    const answer = await ask("v1/uploads", {
      method: "POST",
      headers: { ...TUS, "Upload-Length": this.file.size, "Upload-Metadata": metadata.map(([name, value]) => `${name} ${base64(value)}`).join(",") },
    });
    const url = new URL(answer.headers.get("Location"), address("v1/uploads")).pathname;
    Object.assign(this, { url, sent: 0, isNew: true });
  }

  /** How much of the file the service has. */
  async find() {
    if (this.isNew) {
      this.isNew = false;
      await keep({ url: this.url, file: this.file, declared: this.declared });
      return;
    }
    const answer = await ask(this.url, { method: "HEAD", headers: TUS });
    this.sent = Number(answer.headers.get("Upload-Offset"));
  }

  /** Why the service does not take the upload any more: its record has the problem of a refused one; `failed` where it tells nothing. */
  async told(failed) {
    const { problem } = await ask(this.url).then((found) => found.json()).catch((error) => ({ problem: error }));
    if (!problem) return failed;
    return problem instanceof Problem ? problem : new Problem(422, problem);
  }

  /** The upload is gone. A new one is begun by nobody but a person. */
  async miss() {
    await release(this.url);
    this.become("unknown");
    return false;
  }

  /** Sends the whole file to a new upload. */
  sendAgain() {
    Object.assign(this, { url: null, sent: 0, isFromBefore: false });
    return this.run();
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
    if (this.url && !NOT_ALLOWED.includes(error.status)) await release(this.url);
    this.become("refused", { problem: error });
    return false;
  }

  pause() {
    this.stop?.abort();
    this.become("paused");
  }

  async cancel() {
    this.stop?.abort();
    this.become("cancelled");
    if (this.url) await this.drop();
  }

  async drop() {
    await release(this.url);
    await ask(this.url, { method: "DELETE", headers: TUS }).catch(() => {});
  }
}

/** Transfers that a reload interrupted. */
export async function interrupted() {
  return (await kept()).map(({ url, file, declared }) => new Transfer(file, declared, url));
}

/** Acts while no other tab sends to `url`; the browser frees a tab's locks with the tab. Pages without a secure origin have none. */
async function alone(url, signal, act) {
  if (!navigator.locks) return act();
  return navigator.locks.request(`lampwright upload ${url}`, { signal }, act).catch((error) => {
    if (!signal.aborted) throw error;
  });
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
