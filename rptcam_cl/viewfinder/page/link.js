/** Messages over a transport: questions with answers, listeners by type, and what only the last of counts. */

/** A binary message: its header and the bytes behind it. */
export function parted(buffer) {
  const view = buffer instanceof ArrayBuffer ? new DataView(buffer) : new DataView(buffer.buffer, buffer.byteOffset, buffer.byteLength);
  const length = view.getUint32(0, true);
  const at = view.byteOffset + 4;
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(view.buffer, at, length)));
  return { header, bytes: new Uint8Array(view.buffer, at + length, view.byteLength - 4 - length) };
}

const LOOK = 1000; // [ms] between looks whether the other side is still there
const QUIET = 3000; // [ms] without a word from it, after which it is asked
const SILENT = 9000; // [ms] without an answer, after which it is taken for gone

export class Link {
  constructor(transport) {
    this.transport = transport;
    this.listeners = new Map();
    this.last = {}; // the last message of each type
    this.waiting = new Map(); // answers by the number of their question
    this.soonest = new Map(); // messages of which only the last counts
    this.number = 0;
    this.heardAt = this.pingedAt = 0;
    this.looking = setInterval(() => this.look(), LOOK);
    transport.onmessage = (data) => this.receive(data);
    transport.onstate = (state, words) => this.stateChanged(state, words);
  }

  /** Call a function with every message of a type; "frame" also has the bytes. */
  on(type, listener) {
    if (!this.listeners.has(type)) this.listeners.set(type, []);
    this.listeners.get(type).push(listener);
  }

  emit(type, message, bytes = null) {
    this.last[type] = message;
    for (const listener of this.listeners.get(type) ?? []) listener(message, bytes);
  }

  stateChanged(state, words) {
    if (state !== "open") {
      for (const { reject } of this.waiting.values()) reject(new Error("The connection was lost."));
      this.waiting.clear();
    }
    this.emit("link", { state, words });
  }

  get isOpen() {
    return this.last.link?.state === "open";
  }

  /** Ask whether the other side is there when it has been quiet, and tell the transport when it does not answer. */
  look() {
    const now = performance.now();
    if (!this.isOpen) return;
    if (this.pingedAt > this.heardAt) {
      if (now - this.pingedAt > SILENT) this.transport.silent();
    } else if (now - this.heardAt > QUIET) {
      this.pingedAt = now;
      this.transport.send(JSON.stringify({ type: "ping", id: 0 }));
    }
  }

  /** End; the transport is closed by whoever opened it. */
  close() {
    clearInterval(this.looking);
  }

  receive(data) {
    this.heardAt = performance.now();
    if (typeof data !== "string") {
      const { header, bytes } = parted(data);
      this.emit(header.type, header, bytes);
      this.answered(header, bytes);
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "hello") this.stateChanged("open", "Connected");
    if (message.type === "error" && this.waiting.has(message.id)) message.asked = true;
    this.emit(message.type, message);
    this.answered(message, null);
  }

  answered(message, bytes) {
    const question = this.waiting.get(message.id);
    if (!question || message.type === "frame") return;
    this.waiting.delete(message.id);
    if (message.type === "error") question.reject(Object.assign(new Error(message.message), { where: message.where }));
    else question.resolve({ ...message, bytes });
  }

  /** Send a message; return its number. */
  tell(type, keys = {}) {
    this.number += 1;
    this.transport.send(JSON.stringify({ type, id: this.number, ...keys }));
    this.emit("told", { type, id: this.number, ...keys });
    return this.number;
  }

  /** Send a message; return a promise of its answer, broken by an error. */
  ask(type, keys = {}) {
    if (!this.isOpen) return Promise.reject(new Error("There is no connection."));
    const id = this.tell(type, keys);
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  /** Send at most one message of a name for each picture of the screen: the first at once, of those after it the last. */
  soon(name, type, keys, merged = (_, later) => later) {
    const before = this.soonest.get(name);
    if (before === undefined) {
      this.tell(type, keys);
      this.soonest.set(name, null);
    } else {
      this.soonest.set(name, { type, keys: before ? merged(before.keys, keys) : keys });
    }
    if (!this.due) this.due = requestAnimationFrame(() => this.flush());
  }

  /** Send what waits. */
  flush() {
    cancelAnimationFrame(this.due);
    this.due = null;
    const messages = [...this.soonest.values()].filter((each) => each !== null);
    this.soonest.clear();
    for (const { type, keys } of messages) this.tell(type, keys);
  }
}
