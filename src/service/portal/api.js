// Requests to the service: with the tab's key, errors as the service words them, and another try where waiting helps.
import { askForKey, authorization, forget, key } from "./keys.js";
import { words } from "./words.js";

/** Where the service is: this file lies at portal/<version>/api.js below it. */
export const site = new URL("../../", import.meta.url);
const TRIES = 4;

/** An error of the service (RFC 9457), or of the way to it (status 0). */
export class Problem extends Error {
  constructor(status, told) {
    super(told.detail ?? told.title);
    Object.assign(this, { status, title: told.title, detail: told.detail, code: told.code, at: told.at, remedy: told.remedy });
  }
}

/** The address of a path of the service, or of a link in one of its answers. */
export function address(path) {
  return new URL(path.startsWith("/") ? path : `./${path}`, site).href;
}

/**
 * The answer to a request that succeeded; its body is unread. `json` is sent as JSON. `mayRepeat`: a request that changes nothing, as all
 * without a method; `onwait(problem, seconds)` is told before it is repeated.
 */
export async function ask(path, { json, headers, mayRepeat = false, onwait = null, ...more } = {}) {
  const body = json === undefined ? {} : { body: JSON.stringify(json), method: "POST" };
  const type = json === undefined ? {} : { "Content-Type": "application/json" };
  for (let tried = 1; ; tried += 1) {
    const had = key();
    const request = { ...body, ...more, headers: { ...type, ...headers, ...authorization() } };
    const answer = await fetch(address(path), request).catch((error) => {
      if (error.name === "AbortError") throw error;
      throw new Problem(0, words.away);
    });
    if (answer.ok || answer.status === 304) return answer;
    const found = await problemOf(answer);
    if (answer.status === 401) {
      if (had === key()) {
        if (had) forget();
        if (!(await askForKey(had !== null))) throw found;
      }
      continue;
    }
    const isSafe = mayRepeat || !request.method || request.method === "GET" || answer.status === 429;
    if (!(isSafe && [429, 503].includes(answer.status) && tried < TRIES)) throw found;
    const wait = Math.min(Math.max(Number(answer.headers.get("Retry-After")), 1), 10);
    onwait?.(found, wait);
    await sleep(1000 * wait, request.signal);
  }
}

/** What a request answers, as JSON; null for an answer without a body. */
export async function json(path, options) {
  const answer = await ask(path, options);
  return answer.status === 204 ? null : answer.json();
}

/** What the service says is wrong. */
export async function problemOf(answer) {
  const told = await answer.json().catch(() => ({}));
  return new Problem(answer.status, { title: words.problem.title, detail: words.problem.status(answer.status), ...told });
}

export function sleep(ms, signal) {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, ms);
    signal?.addEventListener("abort", () => { clearTimeout(timer); resolve(); });
  });
}

/** Follows the progress of a job by its stream of events until it has ended: `onevent(name, data)`. Broken streams are begun again. */
export async function follow(path, signal, onevent, onlost) {
  let last = null;
  while (!signal.aborted) {
    try {
      const answer = await ask(path, { signal, headers: { Accept: "text/event-stream", ...(last ? { "Last-Event-ID": last } : {}) } });
      if (answer.status === 204) return;
      onlost(false);
      for await (const { event, id, data } of events(answer.body)) {
        last = id ?? last;
        onevent(event, JSON.parse(data));
        if (event !== "progress") return;
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error.status && ![0, 503].includes(error.status)) throw error;
      onlost(true);
    }
    await sleep(1500, signal);
  }
}

/** The events of a stream, one after another (WHATWG HTML, 9.2.6). EventSource cannot send a key. */
async function* events(body) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      text += value.replaceAll("\r\n", "\n");
      for (let end = text.indexOf("\n\n"); end >= 0; end = text.indexOf("\n\n")) {
        const event = parsed(text.slice(0, end));
        text = text.slice(end + 2);
        if (event.data) yield event;
      }
    }
  } finally {
    reader.cancel().catch(() => {});
  }
}

function parsed(block) {
  const found = { event: "message", data: "" };
  for (const line of block.split("\n")) {
    const [, name, value] = /^(\w+): ?(.*)$/.exec(line) ?? [];
    if (name === "data") found.data += value;
    else if (name) found[name] = value;
  }
  return found;
}

/** Gives a file of the service to the browser's downloads. Without a key the browser fetches it itself, however long it is;
 * not where the file is the answer to a `request` of its own. */
export async function save(path, filename, onprogress, request = null) {
  if (!key() && !request) return follows(address(path), filename);
  const answer = await ask(path, request ?? {});
  const length = Number(answer.headers.get("Content-Length")) || null;
  let come = 0;
  const counted = new TransformStream({
    transform: (chunk, out) => {
      come += chunk.byteLength;
      onprogress?.(come, length);
      out.enqueue(chunk);
    },
  });
  const blob = await new Response(answer.body.pipeThrough(counted)).blob();
  const url = URL.createObjectURL(blob);
  follows(url, filename);
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

function follows(url, filename) {
  const link = document.createElement("a");
  link.href = url;
  link.download = filename;
  document.body.append(link);
  link.click();
  link.remove();
}
